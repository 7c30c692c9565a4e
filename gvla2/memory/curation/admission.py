"""What may enter the bank, and in which state at best: by verdict, origin and text.

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
    """A weighed lesson: its ``state`` in the bank at best, or None when it is not stored; ``note`` says why.

    ``trust`` is that of its one origin, ``screened`` whether its text lowers it by a level: both, with the record's
    other origins, give its final trust (:func:`gvla2.memory.curation.trust.trust_of`). Its dedup ``key`` and unit
    ``vector`` (D,) are added on storing.
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

    Verified lessons may become active; uncertain or unjudged ones are provisional. A failed episode teaches
    constraints, never recipes. ``origin`` is its source (None: an episode of ours); ``trust`` is given instead for a
    record that is judged again. A lesson that is not believed stays provisional whatever its verdict, and so does a
    model's lesson without evidence (``ungrounded`` says why). ``options.admission`` False is the ablation that admits
    all lessons of ours; ``options.failures`` False learns nothing from failures.
    """
    options = options or BankOptions()
    if not lesson.content.strip():
        return Weighed(lesson, None, "A lesson without words was left out.")
    failed = verdict.outcome == "verified_fail"
    if not options.failures and (failed or lesson.type == "failure_avoidance"):
        return Weighed(lesson, None, "Learning from failures is switched off.")
    if failed and lesson.type != "failure_avoidance":
        why = "A recipe from a failed episode was left out: failures only teach constraints."
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
        note = suspicious or "it comes from outside, and no second source has confirmed it yet"
        if trust is None:  # with other sources it may be believed after all
            state = "active"
    return Weighed(lesson, state, note, level, bool(suspicious))


def credible(verdict: Verdict) -> tuple[Verdict, str]:
    """The verdict as far as it is valid, and a note on what was wrong with it.

    Scores outside [0, 1] make it unavailable. An outcome that contradicts its own score R (a success of R <= .35, a
    failure of R >= .70) is uncertain.
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
