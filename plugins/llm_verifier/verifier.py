"""The verifier that asks a language model: the paper's criteria, all asked at once, one verdict.

The episode is data in the prompt: nothing in it can act as markup or imitate the prompt's own.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError, did_you_mean
from gvla2.language import Completion, LanguageModel, LanguageModelError, Request
from gvla2.language.score_tokens import score_answer
from gvla2.memory.contracts import Evidence, Verdict
from gvla2.memory.rendering import neutralised

if TYPE_CHECKING:
    from gvla2_plugins.llm_verifier import LlmVerifierConfig

NAME = "llm"
LONGEST_REASON = 300


@dataclass(frozen=True)
class Criterion:
    """``name`` is the key in a verdict's criteria; ``question`` says what deserves the best score."""

    name: str
    question: str


ROBOT = (
    Criterion(
        "task_completion",
        "Is the state that the instruction asks for reached at the end? Judge by what was observed after the motion, "
        "not by what was planned. Tidy motion that misses the goal deserves the worst score.",
    ),
    Criterion(
        "spatial_consistency",
        "Do positions, sizes and distances agree with one another throughout: the perceived scene, the planned "
        "waypoints, the places reached, and the scene afterwards? Bystanders that moved count against it.",
    ),
    Criterion(
        "collision_safety",
        "Did the robot touch only what it was meant to touch, with clearance elsewhere? A collision, an emergency "
        "stop or an unplanned contact deserves a bad score even when the task was completed.",
    ),
    Criterion(
        "execution_validity",
        "Was the whole plan carried out as planned: every waypoint reached within its tolerance, the gripper opening "
        "and closing as asked, no abort, no missing stage?",
    ),
    Criterion(
        "generalizability",
        "Would the same approach work again with the objects elsewhere, a little larger or of another colour? Luck, "
        "repairs on the way and numbers that fit this one scene alone count against it.",
    ),
)

SOFTWARE = (
    Criterion(
        "root_cause",
        "Was the cause of the problem found and treated, rather than its symptom? Special cases, silenced errors and "
        "guesses without a look at the code count against it.",
    ),
    Criterion(
        "code_quality",
        "Is the change correct in the cases nearby, no larger than needed, readable, and in keeping with the code "
        "around it? Debris, broken interfaces and disabled checks count against it.",
    ),
    Criterion(
        "empirical_verification",
        "Was the result shown by running something: the failure reproduced before and gone after, tests run and "
        "passed? Claims without output in the transcript deserve a bad score.",
    ),
)

SETS: Mapping[str, tuple[Criterion, ...]] = {"robot": ROBOT, "software": SOFTWARE}


def criteria_set(name: str, questions: Mapping[str, str] | None = None) -> tuple[Criterion, ...]:
    """The set of that name; or the user's own ``questions`` (name to question) if given.

    Raises :class:`ConfigurationError` for an unknown set, or an empty name or question.
    """
    if questions:
        if not all(key.strip() and question.strip() for key, question in questions.items()):
            raise ConfigurationError("A criterion of your own needs a name and a question; one is empty.")
        return tuple(Criterion(key, question) for key, question in questions.items())
    if name not in SETS:
        hint = did_you_mean(name, SETS)
        raise ConfigurationError(f"No set of criteria is called '{name}'.{hint} Sets: {', '.join(SETS)}.")
    return SETS[name]


ORDERS = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()

_LONGEST_INSTRUCTION = 2_000
_LONGEST_FACTS = 4_000


def messages(evidence: Evidence, criterion: Criterion, longest: int) -> list[dict[str, str]]:
    """The conversation that asks for one criterion's score.

    The episode comes before the criterion: a server that caches prompt prefixes then reads it once.
    """
    facts = json.dumps(dict(evidence.facts), ensure_ascii=False, default=str, skipkeys=True)
    parts = [
        f"Instruction to the agent: {as_data(evidence.instruction, _LONGEST_INSTRUCTION)}",
        f"Observed facts: {as_data(facts, _LONGEST_FACTS)}" if evidence.facts else "",
        f"Transcript:\n{as_data(evidence.transcript, longest) or '(empty)'}",
    ]
    episode = "\n".join(filter(None, parts))
    question = f"Criterion: {criterion.name.replace('_', ' ')}. {criterion.question}"
    return [
        {"role": "system", "content": ORDERS},
        {"role": "user", "content": f"<episode>\n{episode}\n</episode>\n\n{question}"},
    ]


def as_data(text: str, longest: int) -> str:
    """``text`` without anything that a prompt or a chat template could treat as markup; line breaks stay.

    A long one keeps its head and tail: the end, with its outcome, is worth as much as the beginning.
    """
    if len(text) > longest:
        note = f"\n({len(text) - longest} characters left out)\n"
        room = max(longest - len(note), 0)
        text = text[: room // 2] + note + text[len(text) - (room - room // 2) :]
    lines = (neutralised(line, longest) for line in text.splitlines())
    return "\n".join(filter(None, lines))[:longest]


class LlmVerifier:
    """A language model's judgement of an episode's transcript (paper, eq. R_t).

    When any criterion could not be asked, or its answer was lost to reasoning, the verdict is ``unavailable``: a mean
    over the others would be for a different set of criteria, and a midpoint would be invented.
    """

    def __init__(self, config: LlmVerifierConfig, language: LanguageModel) -> None:
        if config.longest < 200:
            raise ConfigurationError(f"longest is {config.longest}; it must be at least 200.")
        self._criteria = criteria_set(config.criteria, config.questions)
        self._longest, self._language = config.longest, language

    def verify(self, evidence: Evidence) -> Verdict:
        """A verdict; ``unavailable`` without a transcript or facts, or when the model could not be asked."""
        if not evidence.transcript.strip() and not evidence.facts:
            return Verdict.unavailable("There is neither a transcript nor a fact to judge.", NAME)
        requests = [
            Request(messages(evidence, criterion, self._longest), logprobs=True, seed=0)
            for criterion in self._criteria
        ]
        answers = self._language.complete_all(requests, purpose="verify")
        given = [answer for answer in answers if isinstance(answer, Completion)]
        if problems := [problem for answer in answers if (problem := _problem(answer))]:
            asked = f"{len(problems)} of {len(self._criteria)} criteria could not be judged"
            return Verdict.unavailable(f"{asked}: {' '.join(dict.fromkeys(problems))}", NAME)
        return self._verdict(given)

    def _verdict(self, answers: Sequence[Completion]) -> Verdict:
        scores: dict[str, float] = {}
        reasons = []
        for criterion, answer in zip(self._criteria, answers, strict=True):
            found = score_answer(answer.text, answer.tokens)
            scores[criterion.name] = found.value
            tag = answer.text.lower().rfind("<score>")
            said = neutralised(answer.text[:tag] if tag >= 0 else answer.text, LONGEST_REASON)
            name = criterion.name.replace("_", " ")
            score = f"{name} {found.value:.2f} ({found.source}, mass {found.mass:.2f})"
            reasons.append(score + (f": {said}" if said else ""))
        return Verdict.from_criteria(scores, reasons, NAME)


def _problem(answer: Completion | LanguageModelError) -> str:
    """Why this is not an answer, "" if it is one."""
    if isinstance(answer, LanguageModelError):
        return str(answer)
    if answer.text.strip():
        return ""
    if answer.finish == "length" or answer.reasoning:
        return "The model spent all its tokens on reasoning and gave no answer: raise max_tokens."
    return "The model's answer was empty."
