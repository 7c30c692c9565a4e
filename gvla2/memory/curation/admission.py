"""What may enter the bank, and in which state: by verdict, by what the text looks like, and by who sends how much.

Decisions on plain data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite

from gvla2.memory.contracts import Lesson, LifecycleState, Trust, Verdict
from gvla2.memory.curation.likeness import words_of
from gvla2.memory.curation.trust import Origin
from gvla2.memory.screening.instructions import effect_reads_like_instructions, reads_like_instructions

QUARANTINED = "quarantined: "
"""How the note of a record begins that no verdict can make active."""
ECHO = 0.9
OURS = Origin(True, "")
_FAILED, _SUCCEEDED = 0.35, 0.70


@dataclass(frozen=True)
class Decision:
    """What becomes of a lesson: its ``state`` in the bank, or None when it is not stored; ``note`` says why."""

    state: LifecycleState | None
    note: str = ""
    trust: Trust = "own"


def admit(
    lesson: Lesson,
    verdict: Verdict,
    *,
    origin: Origin = OURS,
    query: str = "",
    admission: bool = True,
    failures: bool = True,
    grounds: str = "",
) -> Decision:
    """Decide on one lesson.

    Verified lessons become active. What was uncertain, or could not be judged, is provisional at most, and so is
    text that reads like instructions to a machine, or that only repeats the ``query`` it would then be found by. A
    failed episode teaches constraints, never recipes. ``admission`` False is the ablation that lets everything but
    quarantined text in as active; ``failures`` False the one that learns nothing from failures.
    """
    if not lesson.content.strip():
        return Decision(None, "A lesson without words was left out.")
    failed = verdict.outcome == "verified_fail"
    if not failures and (failed or lesson.type == "failure_avoidance"):
        return Decision(None, "Learning from failures is switched off.")
    if failed and lesson.type != "failure_avoidance":
        return Decision(
            None, "A recipe from a failed episode was left out: failures teach constraints alone."
        )
    if reads_like_instructions(lesson.content) or effect_reads_like_instructions(lesson.effect):
        return Decision("provisional", f"{QUARANTINED}the text reads like instructions", "screened")
    trust: Trust = "own" if origin.own else "foreign"
    if grounds:
        return Decision("provisional", grounds, trust)
    if not lesson.effect and query and repeats(lesson.content, query):
        return Decision("provisional", f"{QUARANTINED}the text only repeats the task", trust)
    if not admission or failed or verdict.outcome == "verified_success":
        return Decision("active", "", trust)
    why = "could not be judged" if verdict.outcome == "unavailable" else "is uncertain"
    return Decision("provisional", f"the outcome {why}", trust)


def repeats(content: str, query: str) -> bool:
    """Whether a text says hardly more than the task that it would be found by."""
    said, asked = words_of(content), words_of(query)
    return len(said & asked) >= ECHO * len(said | asked) and len(said) > 2


def believed(verdict: Verdict) -> tuple[Verdict, str]:
    """The verdict as far as it can be one, and a note on what was wrong with it.

    Scores that are no numbers in [0, 1] are no judgement: unavailable. An outcome that its own score R refutes (a
    success of R <= .35, a failure of R >= .70) is uncertain.
    """
    if verdict.outcome == "unavailable":
        return verdict, ""
    who = f"The verifier '{verdict.verifier or 'unnamed'}'"
    scores = (verdict.quality, verdict.confidence, *verdict.criteria.values())
    if not all(isfinite(score) and -1e-6 <= score <= 1 + 1e-6 for score in scores):
        note = f"{who} gave scores that are not in [0, 1]: its verdict counts as unavailable."
        return Verdict.unavailable(note, verdict.verifier), note
    refuted = {"verified_success": verdict.quality <= _FAILED, "verified_fail": verdict.quality >= _SUCCEEDED}
    if refuted.get(verdict.outcome):
        note = (
            f"{who} said {verdict.outcome} with R = {verdict.quality:.2f}: its verdict counts as uncertain."
        )
        return replace(verdict, outcome="uncertain"), note
    return verdict, ""
