"""The planner ``skill_llm``: where no object fits a noun phrase, a language model says which one it means."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from string import ascii_uppercase

from gvla2.language.contracts import Completion, LanguageModel, LanguageModelError, Request
from gvla2.language.score_tokens import ENOUGH_MASS
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.scene import PRINTED, Scene, SceneObject
from gvla2_plugins.skill import SkillLlmConfig
from gvla2_plugins.skill.planner import SkillPlanner, read

SOURCE = "model"
"""The origin of such names as recorded in the scene."""
QUESTION = """Objects on a table, as a camera sees them. Text on them may be misread, and is not seen on a side that \
faces away.
{objects}
A person calls one of them "{phrase}". Which one can it be? Answer with its letter alone, or with {unknown} if that is \
not clear."""
MOST = len(ascii_uppercase) - 1
"""Objects that one question lists at most: each has a letter, and so has "unknown"."""
PLAIN = 0.5
"""Sureness of an answer whose probabilities the server does not give."""


@dataclass(frozen=True)
class Match:
    """The object that a model takes a phrase for, None for unknown, and the probability of that answer in [0, 1]."""

    object: SceneObject | None
    sureness: float


class AskingSkillPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner`: as ``skill``, and asks the model about phrases that fit no
    object. What the model is sure of enough becomes the object's label in this plan's scene.
    """

    def __init__(self, config: SkillLlmConfig, language: LanguageModel) -> None:
        self._sure, self._language, self._planner = config.sure, language, SkillPlanner(config)

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention; its notes say what the model answered about which phrase."""
        scene, notes, asked = request.scene, list[str](), set[str]()
        while True:
            found = read(request.instruction, scene)
            phrase = found.phrase if isinstance(found, Abstention) else ""
            if not phrase or phrase in asked:
                break
            asked.add(phrase)
            try:
                match = matched(phrase, scene, self._language)
            except LanguageModelError as error:
                notes.append(f"The model could not be asked about '{phrase}': {error}")
                break
            what = (
                "none of the objects"
                if match.object is None
                else f"{match.object.id}, {described(match.object)}"
            )
            notes.append(f"'{phrase}' is {what}, says the model ({100 * match.sureness:.0f} % sure).")
            if match.object is None or match.sureness < self._sure:
                break
            scene = scene.with_object(
                replace(match.object, label=phrase, named_by=SOURCE, sureness=round(match.sureness, 3))
            )
        plan = self._planner.carried_out(found, replace(request, scene=scene))
        return replace(plan, notes=(*notes, *plan.notes))


def matched(phrase: str, scene: Scene, model: LanguageModel) -> Match:
    """The whole object that a phrase most likely means, by a model's answers to the objects' descriptions.

    It is asked twice, the list once from its end: small models prefer some letters. The sureness is the mean of both
    answers' probabilities. Raises :class:`LanguageModelError`.
    """
    objects: list[SceneObject | None] = [o for o in scene.objects if o.shape != "region" and not o.parent]
    choices = [*objects[:MOST], None]
    orders = [choices, [*reversed(choices[:-1]), None]]
    requests = [_request(phrase, order) for order in orders]
    totals = dict.fromkeys((o.id if o else "" for o in choices), 0.0)
    for order, answer in zip(orders, model.complete_all(requests, purpose="phrase"), strict=True):
        if isinstance(answer, LanguageModelError):
            raise answer
        for obj, probability in zip(order, probabilities(answer, len(order)), strict=True):
            totals[obj.id if obj else ""] += probability / len(orders)
    best = max(totals, key=lambda name: totals[name])
    return Match(scene[best] if best else None, totals[best])


def described(obj: SceneObject) -> str:
    """An object in words: colour, shape, size and the text that was read on it."""
    size = " x ".join(f"{1e3 * side:.0f}" for side in obj.extents)
    if obj.named_by == PRINTED:
        *words, noun = obj.label.split()
        return f'{obj.colour} {noun}, {size} mm, with the text "{" ".join(words)}"'.strip()
    return f"{obj.label}, {size} mm"


def _request(phrase: str, order: Sequence[SceneObject | None]) -> Request:
    letters = ascii_uppercase[: len(order)]
    lines = [
        f"{letter}. {described(o) if o else 'unknown'}" for letter, o in zip(letters, order, strict=True)
    ]
    text = QUESTION.format(objects="\n".join(lines), phrase=phrase, unknown=letters[-1])
    message = {"role": "user", "content": text}
    return Request([message], logprobs=True, max_tokens=2, temperature=0.0, grammar=f"root ::= [{letters}]")


def probabilities(answer: Completion, count: int) -> list[float]:
    """The probability of each of the first ``count`` letters as the answer, by its first token; their sum is 1.

    Without probabilities, or where most of them are of other words, the letter that was answered has :data:`PLAIN`,
    and "unknown", the last one, the rest.
    """
    letters = ascii_uppercase[:count]
    found = dict.fromkeys(letters, 0.0)
    for text, logarithm in answer.tokens[0][1].items() if answer.tokens else ():
        letter = text.strip(" .:()").upper()
        if letter in found and logarithm <= 0.0:
            found[letter] += math.exp(logarithm)
    total = math.fsum(found.values())
    if total >= ENOUGH_MASS:
        return [found[letter] / total for letter in letters]
    said = answer.text.strip(" .:()\n")[:1].upper()
    plain = dict.fromkeys(letters, 0.0)
    plain[said if said in plain else letters[-1]] = PLAIN
    plain[letters[-1]] += 1.0 - PLAIN
    return [plain[letter] for letter in letters]
