"""Did the skill reach its goal? One rule per skill, from perceived scenes and the hand's own measurements.

Each rule gives a score in [0, 1] and a sentence; it raises :class:`InconclusiveError` if the evidence decides nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from gvla2.planning.scene import SceneObject
from gvla2.skills.mechanisms import shines
from gvla2_plugins.geometric.case import (
    Case,
    InconclusiveError,
    Score,
    outside_footprint,
    something_at,
)
from gvla2_plugins.geometric.rules import (
    closed,
    drawn,
    inserted,
    opened,
    place,
    pulled,
    pushed,
    shut,
    twisted,
)

IN_IT = 0.012
"""A holder reaches higher than an object's foot by more than this, metres: perceived heights err by less."""
GROWN = 1.2
"""Ratio of an object's height after to before above which it is implausible."""
CLEARED = 0.9
"""Share of a holder's height that an object must rise to be out of it."""


def completion(case: Case) -> Score:
    """The finding of the plan's skill; unknown for a skill without a rule."""
    rule = _RULES.get(case.evidence.plan.skill)
    if rule is None:
        return Score(None, f"There is no rule for the skill '{case.evidence.plan.skill}'.")
    try:
        found = rule(case)
    except InconclusiveError as error:
        return Score(None, str(error))
    if (found.score or 0.0) >= 0.5 and (meant := _meant_another(case)):
        return Score(0.4, f"{found.reason} But the sentence says {meant}, and what was handled is not.")
    return found


def _meant_another(case: Case) -> str:
    """A named colour that some object has, but no handled one; "" for none.

    If a handled object has one of the named colours, another may be a landmark's.
    """
    handled: set[str] = set()
    for obj in filter(None, map(case.seen, case.evidence.plan.roles.values())):
        kin = (obj, case.seen(obj.parent), *case.before.parts_of(obj.id))
        handled |= {o.colour for o in kin if o is not None}
    named = set(re.findall(r"\w+", case.evidence.instruction.casefold()))
    named &= {o.colour for o in case.before.objects} - {""}
    return "" if named & handled else min(named, default="")


def _pick(case: Case) -> Score:
    """The theme is up and in the hand; or it is not visible, gone from its place, and the hand holds something."""
    theme = case.handled()
    if not case.holding:
        return Score(0.0, "The hand is empty at the end.")
    after, later = case.perceived(), case.later(theme)
    if later is None:
        if something_at(theme, after, case.config.same_place):
            return Score(0.2, f"Something still stands where {theme.label} stood.")
        if case.last_held is False:
            return Score(0.2, f"{theme.label} is gone from its place, but the hand felt nothing.")
        return Score(
            0.85, f"{theme.label} is gone from its place and the hand is held open by what it holds."
        )
    risen = _rise(theme, later)
    # A sentence may ask for less than a clear lift.
    enough = min(case.config.risen, 0.5 * case.evidence.plan.parameters.get("lift_height", np.inf))
    holder = _holder(case, theme)
    if risen >= enough and holder is not None and not _out_of(case, later, holder):
        return Score(0.4, f"{theme.label} rose by {100 * risen:.1f} cm: it may still be in {holder.label}.")
    if risen >= enough:
        return Score(1.0, f"{theme.label} rose by {100 * risen:.1f} cm and the hand holds something.")
    if case.in_hand(later):
        return Score(0.45, f"{theme.label} is in the hand, but rose by {100 * risen:.1f} cm only.")
    moved = float(np.linalg.norm(later.centre - theme.centre))
    return Score(
        max(0.0, 0.3 * risen / enough),
        f"{theme.label} was found {100 * moved:.1f} cm from its old place, raised by {100 * risen:.1f} cm only.",
    )


def _rise(theme: SceneObject, later: SceneObject) -> float:
    """How far the object's underside rose; its top's rise instead if its height seems to have grown.

    Then the underside was hidden in one of the scenes, in a stand say, and was guessed.
    """
    before, after = float(theme.extents[2]), float(later.extents[2])
    if after > GROWN * before:
        return later.top - theme.top
    return later.bottom - theme.bottom


def _holder(case: Case, theme: SceneObject) -> SceneObject | None:
    """The holder that the theme stood in: around the theme's foot, and lower than its top."""
    own = {theme.id, theme.parent, *(p.id for p in case.before.parts_of(theme.id))}
    return next(
        (
            o
            for o in case.before.obstacles(frozenset(own - {""}))
            if theme.bottom + IN_IT < o.top < theme.top
            and o.bottom < theme.bottom + IN_IT
            and outside_footprint(theme.centre, o) == 0.0
        ),
        None,
    )


def _out_of(case: Case, later: SceneObject, holder: SceneObject) -> bool:
    """Whether the hand, holding it, rose by most of the holder's height; or it is no longer over it.

    An object's depth in the holder is not visible: it is assumed to stand on its floor.
    """
    if outside_footprint(later.centre, holder) > 0.5 * float(later.extents[:2].max()):
        return True
    held = [r.reached[2] for r in case.evidence.report.waypoints if r.held]
    return bool(held) and held[-1] - held[0] >= CLEARED * (holder.top - holder.bottom)


def _press(case: Case) -> Score:
    """The tool went at least half of the planned press below the button's top, and felt it."""
    button = case.handled("part", "theme", "goal")
    plan, reports = case.evidence.plan, case.evidence.report.waypoints
    near = [r for r in reports if outside_footprint(np.asarray(r.target), button) <= 0.02]
    if not near:
        return Score(0.0, f"The tool never came over {button.label}.")
    lowest = min(near, key=lambda r: r.target[2])
    planned = plan.parameters.get("press_depth", button.top - lowest.target[2])
    if planned <= 0:
        return Score(0.0, f"The plan does not go below the top of {button.label}.")
    # The tool's shortfall is what is missing of the planned depth.
    depth = planned - max(lowest.reached[2] - lowest.target[2], 0.0)
    aside = float(np.linalg.norm(np.subtract(lowest.reached[:2], lowest.target[:2])))
    travel = f"The tool went {1e3 * depth:.1f} of {1e3 * planned:.1f} mm into {button.label}"
    if aside > max(0.02, 0.5 * float(button.extents[:2].max())):
        return Score(0.0, f"The tool missed {button.label} by {100 * aside:.1f} cm.")
    if depth < 0.5 * planned:
        return Score(max(0.0, 0.6 * depth / planned), f"{travel}: not far enough.")
    if not lowest.contacts:
        return Score(0.4, f"{travel}, but felt no contact.")
    if case.after is not None and shines(button, case.before, case.after) is False:
        return Score(0.1, f"{travel} and felt it, but the lamp stayed dark.")
    return Score(1.0, f"{travel} and felt it.")


_RULES: dict[str, Callable[[Case], Score]] = {
    "pick": _pick,
    "push": pushed,
    "place": place,
    "press": _press,
    "open": opened,
    "close": closed,
    "pull": pulled,
    "shut": shut,
    "twist": twisted,
    "insert": inserted,
    "draw": drawn,
}
