"""Did the skill reach its goal? One rule per skill, from perceived scenes and the hand's own measurements.

Each rule gives a score in [0, 1] and a sentence; it raises :class:`InconclusiveError` if the evidence decides nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import numpy as np

from gvla2.episode.evidence import difference
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.scene import PartJoint, Scene, SceneObject
from gvla2.skills.mechanisms import CLOSED, hinged, opening_angle, shines
from gvla2_plugins.geometric.case import Case, InconclusiveError, Score, level_gap, outside_footprint

DONE, LIKELY, DOUBTFUL, MISSED = 1.0, 0.85, 0.4, 0.0
"""Scores: seen to be done; inferred, since something was not seen again; undecided; seen to be missed."""

IN_IT = 0.012  # metres that a holder reaches above an object's foot: perceived heights err by less
GROWN = 1.2  # ratio of an object's height after to before above which it is implausible
CLEARED = 0.9  # share of a holder's height that an object must rise to be out of it
LEAST_GROWN = 0.4  # least rise of a container where an object lies in it, as a share of the object's height
UNLIKE = 0.35  # look difference above which it is hardly the same object
FEWEST = 10  # points for a reliable height
UPRIGHT = 1.45  # radians: a lid open by less would fall shut
DRAWN = 0.10  # metres: least opening of a drawer, a hand fits in
SHARE_SHUT, SHARE_DRAWN, SHARE_PUSHED = 0.5, 0.7, 0.5  # of the planned way
ON_TOP = 0.02  # metres: largest gap of a lid on its box, a cap on its bottle, a ring at the foot
ALMOST = 0.85  # share of the target below which it is a clear miss: angles and distances err by less
OVER = 0.02  # metres beside a button where the tool may press it
CLOSE = 2 / 3  # of an object's width beside its target, below which it may touch it
TILTED = 0.17  # radians: a known object that leans by more than 10 degrees does not stand on what is flat
FLAT = 0.3  # height of what is flat as a share of its width
ASTRAY = 0.06  # metres: an object this far beside the line of a pull is a different one


def completion(case: Case) -> Score:
    """The finding of the plan's skill; unknown for a skill without a rule."""
    rule = RULES.get(case.evidence.plan.skill)
    if rule is None:
        return Score(None, f"There is no rule for the skill '{case.evidence.plan.skill}'.")
    try:
        found = rule(case)
    except InconclusiveError as error:
        return Score(None, str(error))
    if (found.score or 0.0) >= 0.5 and (meant := _meant_another(case)):
        return Score(DOUBTFUL, f"{found.reason} But the sentence says {meant}, and what was handled is not.")
    return found


def _meant_another(case: Case) -> str:
    """A named colour that some object has, but no handled one; "" for none.

    If a handled object has one of the named colours, another may be a landmark's. A colour in a handled object's name
    is no colour: a black bowl may be seen silver.
    """
    objects = [o for o in map(case.seen, case.evidence.plan.roles.values()) if o is not None]
    ids = {o.parent for o in objects}.union(*(case.before.family(o.id) for o in objects))
    family = [o for o in case.before.objects if o.id in ids]
    handled = {o.colour for o in family}.union(*(o.label.split() for o in family if o.named_by))
    named = set(re.findall(r"\w+", case.evidence.instruction.casefold()))
    named &= {o.colour for o in case.before.objects} - {""}
    return "" if named & handled else min(named, default="")


def _beside(off: float, width: float, reason: str) -> Score:
    """The score of an object ``width`` metres wide that lies ``off`` metres beside its target."""
    return Score(DOUBTFUL if off < CLOSE * width else MISSED, reason)


def _short(came: float, wanted: float, reason: str) -> Score:
    """The score of an object or a lid that came ``came`` of the ``wanted`` metres or radians."""
    done = DONE if came >= wanted else DOUBTFUL if came > ALMOST * wanted else MISSED
    return Score(done, reason)


def _pick(case: Case) -> Score:
    """The theme is up and in the hand; or it is not visible, gone from its place, and the hand holds something."""
    theme = case.handled()
    if not case.holding:
        return Score(MISSED, "The hand is empty at the end.")
    later = case.later(theme)
    if later is None:
        if case.still_there(theme):
            return Score(MISSED, f"Something still stands where {theme.label} stood.")
        gone = f"{theme.label} is gone from its place"
        if case.last_held is False:
            return Score(DOUBTFUL, f"{gone}, but the hand felt nothing.")
        return Score(LIKELY, f"{gone} and the hand is held open by what it holds.")
    # The top's rise, where the height seems to have grown: the underside was hidden in one scene, and guessed.
    grown = float(later.extents[2]) > GROWN * float(theme.extents[2])
    risen = later.top - theme.top if grown else later.bottom - theme.bottom
    rose = f"rose by {100 * risen:.1f} cm"
    # A sentence may ask for less than a clear lift.
    enough = min(case.config.risen, 0.5 * case.evidence.plan.parameters.get("lift_height", np.inf))
    if risen >= enough:
        holder = _holder(case, theme)
        if holder is not None and not _out_of(case, later, holder):
            return Score(DOUBTFUL, f"{theme.label} {rose}: it may still be in {holder.label}.")
        return Score(DONE, f"{theme.label} {rose} and the hand holds something.")
    reports = case.evidence.report.waypoints
    tool = transform_points(invert_rigid(later.world_from_object), reports[-1].reached) if reports else None
    if tool is not None and (np.abs(tool) <= 0.5 * later.extents + case.config.same_place).all():
        return Score(DOUBTFUL, f"{theme.label} is in the hand, but {rose} only.")
    score = DOUBTFUL if risen > 0.5 * enough else MISSED
    return Score(score, f"{theme.label} is not in the hand and {rose} only.")


def _holder(case: Case, theme: SceneObject) -> SceneObject | None:
    """The holder that the theme stood in: around the theme's foot, and lower than its top."""
    around = (
        o
        for o in case.before.obstacles(case.before.family(theme.id) | {theme.parent})
        if o.bottom < theme.bottom + IN_IT < o.top < theme.top and outside_footprint(theme.centre, o) == 0.0
    )
    return next(around, None)


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
    near = [r for r in case.evidence.report.waypoints if outside_footprint(r.target, button) <= OVER]
    lowest = min(near, key=lambda r: r.target[2], default=None)
    if lowest is None or outside_footprint(lowest.reached, button) > OVER:
        return Score(MISSED, f"The tool never came over {button.label}.")
    planned = case.evidence.plan.parameters.get("press_depth", button.top - lowest.target[2])
    # The tool's shortfall is what is missing of the planned depth.
    depth = planned - max(lowest.reached[2] - lowest.target[2], 0.0)
    travel = f"The tool went {1e3 * depth:.1f} of {1e3 * planned:.1f} mm into {button.label}"
    if planned <= 0 or depth < 0.5 * planned:
        return Score(DOUBTFUL if depth > 0.25 * planned > 0 else MISSED, f"{travel}: not far enough.")
    if not lowest.contacts:
        return Score(DOUBTFUL, f"{travel}, but felt no contact.")
    after = case.evidence.after
    if after is not None and shines(button, case.before, after) is False:
        return Score(MISSED, f"{travel} and felt it, but the lamp stayed dark.")
    return Score(DONE, f"{travel} and felt it.")


def _place(case: Case) -> Score:
    """Everything is at its target: one object, or several in sequence."""
    several = [name for name in case.evidence.plan.roles if name.startswith("theme_")]
    if not several:
        return _placed(case, case.handled(), case.role("goal"))
    worst, unknown = Score(DONE, f"All {len(several)} objects are at their targets."), None
    for name in sorted(several):
        try:
            theme = case.handled(name)
            found = _placed(case, theme, case.role(name.replace("theme", "goal")) or _under(case, theme))
            worst = min(worst, found, key=lambda one: one.score or 0.0)
        except InconclusiveError as error:
            unknown = error
    if unknown is not None and (worst.score or 0.0) >= 0.5:
        raise unknown  # one clear failure decides; else one unknown makes the whole unknown
    return worst


def _placed(case: Case, theme: SceneObject, goal: SceneObject | None) -> Score:
    """The theme rests on the goal, in it, or beside it if so planned, and the hand released it."""
    if goal is None:
        raise InconclusiveError("The plan does not say where to put it.")
    if case.last_held:
        return Score(MISSED, "The hand still holds something at the end.")
    later, spot = case.later(theme), _let_go(case, theme)
    if later is None:
        return _taken_in(case, theme, goal)
    reach, slack = float(later.extents[:2].max()), max(0.015, 0.2 * float(later.extents[2]))
    if spot is not None and outside_footprint(spot, goal) > 0.5 * reach:  # planned beside the goal
        off = level_gap(later.centre, spot)
        if off > max(0.03, 0.5 * reach):
            return Score(MISSED, f"{theme.label} lies {100 * off:.1f} cm from its target.")
        if later.bottom > case.before.table_height + slack:
            return Score(DOUBTFUL, f"{theme.label} does not rest on the table.")
        return Score(DONE, f"{theme.label} rests beside {goal.label}, as planned.")
    found, now = _inside(case, later, goal), case.goal_now(goal)
    lean, flat = float(np.linalg.norm(later.righting)), now.extents[2] < FLAT * now.extents[:2].min()
    if found.score == DONE and flat and lean > TILTED:
        return Score(DOUBTFUL, f"{theme.label} leans by {np.degrees(lean):.0f}° on {goal.label}.")
    if found.score != DONE and difference(theme, later) > UNLIKE:
        with suppress(InconclusiveError):
            return _taken_in(case, theme, goal)  # its match may be a piece of the container
    if found.score == DONE and not now.bottom - slack <= later.bottom <= now.top + slack:
        return Score(DOUBTFUL, f"{theme.label} is over {goal.label}, but does not rest there.")
    return found


def _taken_in(case: Case, theme: SceneObject, goal: SceneObject) -> Score:
    """An object seen as one with its container, as for equal colours: it is gone from its place, and where the hand
    released it, the goal is higher than before by most of the object's height.
    """
    spot = _let_go(case, theme)
    if spot is not None and outside_footprint(spot, case.goal_now(goal)) == 0.0 and goal.shape != "region":
        if case.still_there(theme):
            return Score(MISSED, f"Something is still where {theme.label} was.")
        about = 0.5 * float(theme.extents[:2].max())
        was = _height(case.before, spot, about, frozenset({theme.id}))
        grown = _height(case.after, spot, about, frozenset()) - max(was, goal.bottom)
        if grown >= LEAST_GROWN * (theme.top - theme.bottom):
            return Score(LIKELY, f"{theme.label} is gone, and {goal.label} is higher where it was put.")
    raise InconclusiveError(f"{theme.label} was not seen again.")


def _height(scene: Scene, spot: FloatArray, about: float, but: frozenset[str]) -> float:
    """The highest seen point within ``about`` metres of a spot (3,), without strays, else the table's height."""
    seen = np.concatenate([np.zeros((0, 3)), *(o.points for o in scene.obstacles(but))])
    near = seen[np.linalg.norm(seen[:, :2] - spot[:2], axis=1) < about]
    return float(np.quantile(near[:, 2], 0.9)) if len(near) >= FEWEST else scene.table_height


def _inside(case: Case, obj: SceneObject, goal: SceneObject) -> Score:
    """The object's centre in the goal's footprint; some way outside, it only touches the goal."""
    outside = outside_footprint(obj.centre, case.goal_now(goal))
    if outside <= case.config.margin:
        return Score(DONE, f"{obj.label} lies on or in {goal.label}.")
    reason = f"{obj.label} lies {100 * outside:.1f} cm outside {goal.label}."
    return _beside(outside, float(obj.extents[:2].max()), reason)


def _let_go(case: Case, theme: SceneObject) -> FloatArray | None:
    """(3,) the planned release point of the theme, or of any carried object if the plan does not name it."""
    carried = [w for w in case.planned if w.carries]
    own = [w for w in carried if w.carries == theme.id] or carried
    return np.asarray(own[-1].xyz, dtype=np.float64) if own else None


def _under(case: Case, theme: SceneObject) -> SceneObject | None:
    """The object under the planned release: the smallest footprint there except the theme's."""
    if (spot := _let_go(case, theme)) is None:
        return None
    around = [o for o in case.before.objects if o.id != theme.id and outside_footprint(spot, o) == 0.0]
    return min(around, key=lambda o: float(np.prod(o.extents[:2])), default=None)


def _hinged(case: Case, *, closing: bool) -> Score:
    """The lid stands upright or leans away from the box, or lies flat over it when ``closing``; a lid that is not
    seen again is judged by whether the box shows its inside.
    """
    lid, body = hinged(case.handled(), case.before.objects)
    if lid is None:
        raise InconclusiveError("No lid was seen on it.")
    later, box = case.later(lid), case.later(body) if body is not None else None
    if later is None:
        if body is None or box is None or (body.opening > 0.0) != closing:
            raise InconclusiveError(f"{lid.label} was not seen again.")
        shown = box.opening > (0.0 if closing else 0.5 * float(body.extents[:2].min()))
        score = LIKELY if shown != closing else MISSED if closing else DOUBTFUL
        inside = f"{body.label} shows {'its' if shown else 'no'} inside."
        return Score(score, f"{lid.label} was not seen again, and {inside}")
    under = box or body
    angle = opening_angle(later, under)
    is_open = f"{lid.label} is open by {np.degrees(angle):.0f}°."
    if not closing:
        return _short(angle, UPRIGHT, is_open)
    if angle >= CLOSED:
        was = max(opening_angle(lid, body), CLOSED)
        return Score(DOUBTFUL if was - angle > ALMOST * was else MISSED, is_open)
    if under is None:
        return Score(LIKELY, f"{lid.label} lies flat.")
    aside = level_gap(later.centre, under.centre) > 0.25 * float(under.extents[:2].min())
    if aside or later.bottom < under.centre[2]:
        return Score(MISSED, f"{lid.label} lies flat, but not on {under.label}.")
    if box is not None and later.bottom > box.top + ON_TOP:
        return Score(DOUBTFUL, f"{lid.label} does not lie on {box.label}.")
    return Score(DONE, f"{lid.label} lies flat on {under.label}.")


def _moved(
    case: Case, objects: Sequence[SceneObject], way: FloatArray, share: float, need: float = 0.0
) -> Score:
    """How far one of some objects went along the hand's planned ``way`` (3,): by ``need`` metres, or a share of it."""
    length, label = float(np.linalg.norm(way)), objects[0].label
    if length < case.config.same_place:
        raise InconclusiveError("The plan does not say how far it is to move.")
    shifts = [later.centre - obj.centre for obj in objects if (later := case.later(obj)) is not None]
    along = [shift @ way / length for shift in shifts]
    off = [np.linalg.norm(shift - far * way / length) for shift, far in zip(shifts, along, strict=True)]
    straight = [float(far) for far, aside in zip(along, off, strict=True) if aside < ASTRAY]
    if not straight:
        raise InconclusiveError(f"{label} was not seen again.")
    reason = f"{label} went {100 * max(straight):.1f} of {100 * length:.1f} cm."
    if max(straight) > 1.5 * length:
        return Score(DOUBTFUL, reason)
    return _short(max(straight), need or share * length, reason)


def _slid(case: Case, need: float = 0.0) -> Score:
    """The handle, or its front, moved along the hand's way by ``need`` metres, or by a share of that way."""
    theme = case.handled()
    carried = [w.carries for w in case.planned if w.carries]
    # The theme, the held object, and their whole, except a common container.
    held = [obj for obj in map(case.seen, carried) if obj is not None]
    objects = [theme, *case.before.parts_of(theme.id), *held]
    fronts = [p for o in objects if o.parent and (p := case.seen(o.parent)) is not None and p.parent]
    way = case.carried(carried[0]) if carried else case.pushed()
    return _moved(case, [*objects, *fronts], way, SHARE_SHUT, need)


def _pushed(case: Case) -> Score:
    """The theme's centre ended inside the goal's footprint, or touches a solid goal; without one it moved as pushed."""
    theme, goal = case.handled(), case.role("goal")
    if goal is None:
        way = case.pushed(theme.id)
        standoff = case.evidence.plan.parameters.get("standoff", 0.0)
        way = way * max(0.0, 1.0 - standoff / max(float(np.linalg.norm(way)), 1e-6))
        return _moved(case, [theme], way, SHARE_PUSHED)
    later = case.again(theme)
    if goal.shape == "region":
        return _inside(case, later, goal)
    reach = float(later.extents[:2].max())
    gap = outside_footprint(later.centre, case.goal_now(goal)) - 0.5 * reach
    if gap <= 0.015:
        return Score(DONE, f"{theme.label} lies against {goal.label}.")
    return _beside(gap, reach, f"{theme.label} stopped {100 * gap:.1f} cm from {goal.label}.")


def _turned(case: Case, knob: SceneObject, joint: PartJoint) -> Score:
    """The knob turned by at least half of what was planned; round knobs show little of their turn."""
    later, planned = case.later(knob), case.evidence.plan.parameters.get("turn", 0.0)
    wanted = float(np.clip(planned, -joint.position, joint.reach - joint.position))
    came = later.joint.position - joint.position if later is not None and later.joint is not None else 0.0
    if wanted * came <= 0.0 or abs(came) < 0.5 * abs(wanted):
        raise InconclusiveError(f"It cannot be seen whether {knob.label} turned.")
    return Score(DONE, f"{knob.label} turned by {np.degrees(came):.0f}°.")


def _twisted(case: Case) -> Score:
    """The cap is off: in the hand or somewhere else; on its goal, if the plan has one."""
    cap, goal = case.handled(), case.role("goal")
    if goal is not None:
        return _placed(case, cap, goal)
    if cap.joint is not None:
        return _turned(case, cap, cap.joint)
    later, holding = case.later(cap), case.holding and case.last_held is not False
    if later is not None:
        aside, raised = level_gap(later.centre, cap.centre), later.bottom - cap.bottom
        if abs(raised) < ON_TOP and aside < max(ON_TOP, 0.5 * float(cap.extents[:2].max())):
            return Score(MISSED, f"{cap.label} is still where it was.")
        return Score(DONE, f"{cap.label} came off: it is {100 * max(aside, abs(raised)):.0f} cm away.")
    body = case.seen(cap.parent)
    if body is None or case.later(body) is None:
        raise InconclusiveError(f"{cap.label} was not seen again.")
    there = [o for o in case.after.obstacles() if o.bottom < cap.top and o.top > cap.centre[2]]
    if any(level_gap(o.centre, cap.centre) < ON_TOP for o in there):
        return Score(DOUBTFUL if holding else MISSED, f"Something is still where {cap.label} was.")
    return Score(
        LIKELY, f"{cap.label} is gone from {body.label}{', and the hand holds something' * holding}."
    )


def _inserted(case: Case) -> Score:
    """The ring is around the post's foot: its middle within a hole's radius of the post's, low, and released."""
    ring, post = case.handled(), case.handled("goal")
    if case.last_held:
        return Score(MISSED, "The hand still holds something at the end.")
    later, now = case.again(ring), case.later(post)
    seen_well = now is not None and level_gap(now.centre, post.centre) < ASTRAY
    off = level_gap(later.centre, now.centre if now is not None and seen_well else post.centre)
    high = later.bottom - post.bottom
    hole = 0.5 * (ring.opening or 0.6 * float(ring.extents[:2].min()))
    if off > hole:
        reason = f"{ring.label} lies {100 * off:.1f} cm beside the middle of {post.label}."
        return _beside(off, 2 * hole, reason)
    if high > max(ON_TOP, 0.25 * (post.top - post.bottom)):
        return Score(DOUBTFUL, f"{ring.label} hangs on {post.label} {100 * high:.1f} cm above its foot.")
    return Score(DONE, f"{ring.label} lies around the foot of {post.label}.")


def _drawn(case: Case) -> Score:
    """On its goal, if there is one; else out of its holder, in the hand or beside it."""
    theme, goal = case.handled(), case.role("goal")
    if goal is not None or any(w.stage == "release" for w in case.planned):
        return _placed(case, theme, goal)
    if case.later(theme) is None and case.holding and not case.still_there(theme):
        return Score(LIKELY, f"{theme.label} is gone from its place and the hand holds something.")
    return _moved(case, [theme], case.carried(theme.id), SHARE_DRAWN)


RULES: dict[str, Callable[[Case], Score]] = {
    "pick": _pick,
    "push": _pushed,
    "place": _place,
    "press": _press,
    "open": partial(_hinged, closing=False),
    "close": partial(_hinged, closing=True),
    "pull": partial(_slid, need=DRAWN),
    "shut": _slid,
    "twist": _twisted,
    "insert": _inserted,
    "draw": _drawn,
}
