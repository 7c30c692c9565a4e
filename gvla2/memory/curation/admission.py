"""What may enter the bank, and in which state at best: by verdict, by where it comes from, by what the text looks like.

Decisions on plain data.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import isfinite

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import Lesson, LifecycleState, Trust, Verdict
from gvla2.memory.curation.trust import Origin, believed, trust_of
from gvla2.memory.injection_patterns import screen, screened_effect

_FAILED, _SUCCEEDED = 0.35, 0.70


@dataclass(frozen=True)
class Weighed:
    """A lesson and what may become of it: its ``state`` in the bank at best, or None when it is not stored; ``note``
    says why.

    ``trust`` is what its one origin is worth, ``screened`` whether its text takes a level off: with both, whoever knows
    what else was said decides (:func:`gvla2.memory.curation.trust.trust_of`). Who stores it adds its dedup ``key`` and
    its unit ``vector`` (D,).
    """

    lesson: Lesson
    state: LifecycleState | None
    note: str = ""
    trust: Trust = "own"
    screened: bool = False
    key: str = ""
    vector: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))


def weigh(
    lesson: Lesson,
    verdict: Verdict,
    options: BankOptions | None = None,
    *,
    origin: Origin | None = None,
    trust: Trust | None = None,
    ungrounded: str = "",
) -> Weighed:
    """Decide on one lesson.

    Verified lessons may become active; what was uncertain, or could not be judged, is provisional. A failed episode
    teaches constraints, never recipes. ``origin`` is who says it (None: an episode of ours); ``trust`` is given instead
    for a record that is judged again. What is not believed stays provisional whatever its verdict, and so does what a
    model wrote without evidence (``ungrounded`` says why). ``options.admission`` False is the ablation that lets in all
    that is ours; ``options.failures`` False learns nothing from failures.
    """
    options = options or BankOptions()
    if not lesson.content.strip():
        return Weighed(lesson, None, "A lesson without words was left out.")
    failed = verdict.outcome == "verified_fail"
    if not options.failures and (failed or lesson.type == "failure_avoidance"):
        return Weighed(lesson, None, "Learning from failures is switched off.")
    if failed and lesson.type != "failure_avoidance":
        why = "A recipe from a failed episode was left out: failures teach constraints alone."
        return Weighed(lesson, None, why)
    suspicious = screen(lesson.content) or screened_effect(lesson.effect)
    who = Origin(True, "") if origin is None else origin
    level = trust_of([who], screened=bool(suspicious)) if trust is None else trust
    state: LifecycleState = "provisional"
    verified = failed or verdict.outcome == "verified_success"
    if ungrounded and not suspicious:
        note = ungrounded
    elif not verified and (options.admission or not believed(level)):
        lost = verdict.outcome == "unavailable"
        note = f"the outcome {'could not be judged' if lost else 'is uncertain'}"
    elif believed(level):
        state, note = "active", ""
    else:
        note = suspicious or "it comes from outside, and no second source has borne it out yet"
        if trust is None:  # with what others said of it, it may be believed after all
            state = "active"
    return Weighed(lesson, state, note, level, bool(suspicious))


def credible(verdict: Verdict) -> tuple[Verdict, str]:
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
        said = f"{verdict.outcome} with R = {verdict.quality:.2f}"
        return replace(verdict, outcome="uncertain"), f"{who} said {said}: its verdict counts as uncertain."
    return verdict, ""
