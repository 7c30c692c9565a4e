"""Rules for placing and pushing objects and for mechanisms: lids, drawers, caps, rings, objects drawn out."""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import numpy as np

from gvla2.episode.evidence import difference
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.mechanisms import CLOSED, hinged, opening_angle
from gvla2_plugins.geometric.case import (
    Case,
    InconclusiveError,
    Score,
    goal_now,
    outside_footprint,
    something_at,
)

LEAST_GROWN = 0.4
"""Least rise of a container where an object lies in it, as a share of the object's height."""
DOUBTFUL = 0.35
"""Look difference above which it is hardly the same object."""
FEWEST = 10
"""Least points for a reliable height."""


def place(case: Case) -> Score:
    """Everything is at its target: one object, or several in sequence."""
    several = [name for name in case.evidence.plan.roles if name.startswith("theme_")]
    if not several:
        return placed(case, case.handled(), case.role("goal"))
    scores, unknown = [], None
    for name in sorted(several):
        try:
            theme = case.handled(name)
            found = placed(case, theme, case.role(name.replace("theme", "goal")) or _under(case, theme))
        except InconclusiveError as error:
            unknown = unknown or error
            continue
        if (found.score or 0.0) < 0.5:
            return found  # one clear failure decides; else one unknown makes the whole unknown
        scores.append(found.score or 0.0)
    if unknown is not None:
        raise unknown
    return Score(min(scores), f"All {len(scores)} objects are at their targets.")


def placed(case: Case, theme: SceneObject, goal: SceneObject | None) -> Score:
    """The theme rests on the goal, in it, or beside it if so planned, and the hand released it."""
    if goal is None:
        raise InconclusiveError("The plan does not say where to put it.")
    if case.last_held:
        return Score(0.1, "The hand still holds something at the end.")
    case.perceived()
    later = case.later(theme)
    if later is None:
        return _taken_in(case, theme, goal)
    reach, slack = float(later.extents[:2].max()), max(0.015, 0.2 * float(later.extents[2]))
    beside = _meant_beside(case, theme, goal, reach)
    if beside is not None:
        off = float(np.linalg.norm((later.centre - beside)[:2]))
        if off > max(0.03, 0.5 * reach):
            return Score(0.1, f"{theme.label} lies {100 * off:.1f} cm from its target.")
        if later.bottom > case.before.table_height + slack:
            return Score(0.2, f"{theme.label} does not rest on the table.")
        return Score(1.0, f"{theme.label} rests beside {goal.label}, as planned.")
    found = inside(case, later, goal, reach)
    if (found.score or 0.0) < 0.5 and difference(theme, later) > DOUBTFUL:
        with suppress(InconclusiveError):
            return _taken_in(case, theme, goal)  # its match may be a piece of the container
    now = goal_now(case, goal)
    if found.score == 1.0 and not now.bottom - slack <= later.bottom <= now.top + slack:
        return Score(0.2, f"{theme.label} is over {goal.label}, but does not rest there.")
    return found


def _taken_in(case: Case, theme: SceneObject, goal: SceneObject) -> Score:
    """An object seen as one with its container, as for equal colours: it is gone from its place, and where the hand
    released it, the goal is higher than before by most of the object's height.
    """
    spot, after = _let_go(case, theme), case.perceived()
    unknown = InconclusiveError(f"{theme.label} was not seen again.")
    if spot is None or outside_footprint(spot, goal_now(case, goal)) > 0.0 or goal.shape == "region":
        raise unknown
    if something_at(theme, after, case.config.same_place):
        return Score(0.2, f"Something is still where {theme.label} was.")
    about = 0.5 * float(theme.extents[:2].max())
    was = _height(case.before, spot, about, frozenset({theme.id}))
    grown = _height(after, spot, about, frozenset()) - max(was, goal.bottom)
    if grown >= LEAST_GROWN * (theme.top - theme.bottom):
        return Score(
            0.85, f"{theme.label} is gone from its place, and {goal.label} is higher where it was put."
        )
    raise unknown


def _height(scene: Scene, spot: FloatArray, about: float, but: frozenset[str]) -> float:
    """The highest seen point within ``about`` metres of a spot (3,), without strays, else the table's height."""
    seen = np.concatenate([np.zeros((0, 3)), *(o.points for o in scene.obstacles(but))])
    near = seen[np.linalg.norm(seen[:, :2] - spot[:2], axis=1) < about]
    return float(np.quantile(near[:, 2], 0.9)) if len(near) >= FEWEST else scene.table_height


def inside(case: Case, obj: SceneObject, goal: SceneObject, reach: float) -> Score:
    """The object's centre in the goal's footprint; half a width outside, it only touches the goal."""
    outside = outside_footprint(obj.centre, goal_now(case, goal))
    if outside <= case.config.margin:
        return Score(1.0, f"{obj.label} lies on or in {goal.label}.")
    score = max(0.0, 0.45 * (1 - outside / reach))
    return Score(score, f"{obj.label} lies {100 * outside:.1f} cm outside {goal.label}.")


def _meant_beside(case: Case, theme: SceneObject, goal: SceneObject, reach: float) -> FloatArray | None:
    """(3,) the planned release point if it is clearly beside the goal; None if it is on or in it."""
    spot = _let_go(case, theme)
    return spot if spot is not None and outside_footprint(spot, goal) > 0.5 * reach else None


def _let_go(case: Case, theme: SceneObject) -> FloatArray | None:
    """(3,) the planned release point of the theme, or of any carried object if the plan does not name it."""
    carried = [w for w in case.planned if w.carries]
    own = [w for w in carried if w.carries == theme.id] or carried
    return np.asarray(own[-1].xyz, dtype=np.float64) if own else None


def _under(case: Case, theme: SceneObject) -> SceneObject | None:
    """The object under the planned release: the smallest footprint there except the theme's."""
    spot = _let_go(case, theme)
    if spot is None:
        return None
    around = [o for o in case.before.objects if o.id != theme.id and outside_footprint(spot, o) == 0.0]
    return min(around, key=lambda o: float(np.prod(o.extents[:2])), default=None)


UPRIGHT = 1.45
"""A lid that stays open by more than this was opened, radians: below upright it would fall shut."""
DRAWN = 0.10
"""Least opening of a drawer, metres: a hand fits in."""
SHARE_SHUT, SHARE_DRAWN, SHARE_PUSHED = 0.5, 0.7, 0.5
"""Shares of the planned way that count as shut, drawn out, and pushed."""
ON_TOP = 0.02
"""Largest gap of a lid on its box, a cap on its bottle, a ring at the foot, metres."""
ALMOST = 0.85
"""Share of the target below which it is a clear miss: the accuracy of perceived angles and distances."""
ASTRAY = 0.06
"""An object this far beside the line of a pull is a different one, metres."""


def opened(case: Case) -> Score:
    """The lid stands upright, or leans away from the box; or the box shows its inside."""
    lid, body, later, box = _lid(case)
    if later is not None:
        angle = opening_angle(later, box or body)
        travel = f"{lid.label} is open by {np.degrees(angle):.0f}°"
        return (
            Score(1.0, f"{travel}.") if angle >= UPRIGHT else Score(_short(angle, UPRIGHT), f"{travel} only.")
        )
    if body is None or box is None or body.opening > 0.0:
        raise InconclusiveError(f"{lid.label} was not seen again.")
    if box.opening > 0.5 * float(body.extents[:2].min()):
        return Score(0.8, f"{lid.label} was not seen again, but {body.label} shows its inside.")
    return Score(0.3, f"{lid.label} was not seen again, and {body.label} shows no inside.")


def closed(case: Case) -> Score:
    """The lid lies flat over the box; or the box no longer shows its inside."""
    lid, body, later, box = _lid(case)
    under = box or body
    if later is None:
        if body is None or box is None or body.opening == 0.0:
            raise InconclusiveError(f"{lid.label} was not seen again.")
        shown = box.opening > 0.0
        score, how = (0.1, "still") if shown else (0.8, "no longer")
        return Score(score, f"{lid.label} was not seen again, and {body.label} {how} shows its inside.")
    was, angle = opening_angle(lid, body), opening_angle(later, under)
    if angle >= CLOSED:
        score = _short(was - angle, max(was, CLOSED))
        return Score(score, f"{lid.label} is still open by {np.degrees(angle):.0f}°.")
    if under is None:
        return Score(0.7, f"{lid.label} lies flat.")
    off = float(np.linalg.norm((later.centre - under.centre)[:2]))
    if off > 0.25 * float(under.extents[:2].min()) or later.bottom < under.centre[2]:
        return Score(0.1, f"{lid.label} lies flat, but not on {under.label}.")
    if box is not None and later.bottom > box.top + ON_TOP:
        return Score(0.3, f"{lid.label} does not lie on {under.label}.")
    return Score(1.0, f"{lid.label} lies flat on {under.label}.")


def _lid(case: Case) -> tuple[SceneObject, SceneObject | None, SceneObject | None, SceneObject | None]:
    """Lid and box of the plan's theme before, and the same two afterwards."""
    theme = case.handled()
    case.perceived()
    lid, body = hinged(theme, case.before.objects)
    if lid is None:
        raise InconclusiveError(f"No lid was seen on {theme.label}.")
    return lid, body, case.later(lid), case.later(body) if body is not None else None


def _short(came: float, wanted: float) -> float:
    """The score of a shortfall: doubtful if small, else a miss."""
    share = max(0.0, came / wanted)
    return 0.4 if share > ALMOST else 0.1 * share


def _travelled(obj: SceneObject, along: float, planned: float, need: float) -> Score:
    """The score of an object that went ``along`` metres of the ``planned`` ones, and should have gone ``need``."""
    travel = f"{obj.label} went {100 * along:.1f} of {100 * planned:.1f} cm"
    return (
        Score(1.0, f"{travel}.")
        if along >= need
        else Score(_short(along, need), f"{travel}: not far enough.")
    )


def pulled(case: Case) -> Score:
    """The handle, or the front behind it, moved with the hand by at least a hand's width."""
    return _slid(case, DRAWN)


def shut(case: Case) -> Score:
    """The front moved with the hand for most of the planned way."""
    return _slid(case, None)


def _slid(case: Case, wanted: float | None) -> Score:
    """The slid object moved along the hand's way by ``wanted`` metres, or by a share of that way."""
    theme = case.handled()
    case.perceived()
    carried = [w.carries for w in case.planned if w.carries]
    way = case.way(carried[0]) if carried else _pushes(case)
    length = float(np.linalg.norm(way))
    if length < case.config.same_place:
        raise InconclusiveError("The plan does not say how far to slide.")
    # The theme, the held object, and their whole, except a common container.
    held = [obj for obj in map(case.seen, carried) if obj is not None]
    objects = [theme, *case.before.parts_of(theme.id), *held]
    fronts = [p for o in objects if o.parent and (p := case.seen(o.parent)) is not None and p.parent]
    moved = []
    for obj in (*objects, *fronts):
        if (later := case.later(obj)) is not None:
            shift = later.centre - obj.centre
            along = float(shift @ way) / length
            if float(np.linalg.norm(shift - along * way / length)) < ASTRAY:
                moved.append(along)
    if not moved:
        raise InconclusiveError(f"{theme.label} was not seen again.")
    return _travelled(theme, max(moved), length, SHARE_SHUT * length if wanted is None else wanted)


def _pushes(case: Case) -> FloatArray:
    """(3,) the planned way of the hand from before its first push to the end of its last."""
    pushes = [i for i, w in enumerate(case.planned) if i and w.stage.startswith("push")]
    if not pushes:
        return np.zeros(3)
    return np.subtract(case.planned[pushes[-1]].xyz, case.planned[pushes[0] - 1].xyz)


def pushed(case: Case) -> Score:
    """The theme's centre ended inside the goal's footprint; with a solid goal, it touches the goal."""
    theme, goal = case.handled(), case.role("goal")
    case.perceived()
    later = case.again(theme)
    if goal is None:
        return _shifted(case, theme, later)
    reach = float(later.extents[:2].max())
    if goal.shape == "region":
        return inside(case, later, goal, reach)
    gap = outside_footprint(later.centre, goal_now(case, goal)) - 0.5 * reach
    if gap <= 0.015:
        return Score(1.0, f"{theme.label} lies against {goal.label}.")
    score = max(0.0, 0.45 * (1 - gap / reach))
    return Score(score, f"{theme.label} stopped {100 * gap:.1f} cm from {goal.label}.")


def _shifted(case: Case, theme: SceneObject, later: SceneObject) -> Score:
    """A push without a goal: the theme moved along with the hand's strokes, at least half of their length."""
    stroke = np.zeros(3)
    for before, after in pairwise(case.planned):
        if theme.id in after.allowed_contacts and after.stage.startswith("push"):
            stroke += np.subtract(after.xyz, before.xyz)
    length = float(np.linalg.norm(stroke))
    planned = length - case.evidence.plan.parameters.get("standoff", 0.0)
    if length < 1e-6 or planned <= case.config.same_place:
        raise InconclusiveError("The plan does not say how far to push.")
    along = float((later.centre - theme.centre) @ stroke) / length
    if along > 1.5 * planned:
        return Score(0.4, f"{theme.label} went {100 * along:.1f} instead of {100 * planned:.1f} cm.")
    return _travelled(theme, along, planned, SHARE_PUSHED * planned)


def twisted(case: Case) -> Score:
    """The cap is off: in the hand or somewhere else; on its goal, if the plan has one."""
    cap = case.handled()
    after, goal = case.perceived(), case.role("goal")
    if goal is not None:
        return placed(case, cap, goal)
    later, holding = case.later(cap), case.holding and case.last_held is not False
    if later is not None:
        aside = float(np.linalg.norm((later.centre - cap.centre)[:2]))
        raised = later.bottom - cap.bottom
        if abs(raised) < ON_TOP and aside < max(ON_TOP, 0.5 * float(cap.extents[:2].max())):
            return Score(0.0, f"{cap.label} is still where it was.")
        if raised > 0 and case.holding:
            return Score(1.0, f"{cap.label} came off and is in the hand, {100 * raised:.1f} cm higher.")
        return Score(0.9, f"{cap.label} is off: it lies {100 * max(aside, abs(raised)):.0f} cm away.")
    body = case.seen(cap.parent)
    if body is None or case.later(body) is None:
        raise InconclusiveError(f"{cap.label} was not seen again.")
    there = [o for o in after.obstacles() if o.bottom < cap.top and o.top > cap.centre[2]]
    if any(float(np.linalg.norm((o.centre - cap.centre)[:2])) < ON_TOP for o in there):
        return Score(0.3 if holding else 0.1, f"Something is still where {cap.label} was.")
    score = 0.85 if holding else 0.6
    return Score(score, f"{cap.label} is gone from {body.label}{', and the hand holds something' * holding}.")


def inserted(case: Case) -> Score:
    """The ring is around the post's foot: its middle within a hole's radius of the post's, low, and released."""
    ring, post = case.handled(), case.handled("goal")
    if case.last_held:
        return Score(0.1, "The hand still holds something at the end.")
    case.perceived()
    later, now = case.again(ring), case.later(post)
    at = post.centre
    if now is not None and float(np.linalg.norm((now.centre - post.centre)[:2])) < ASTRAY:
        at = now.centre
    off = float(np.linalg.norm((later.centre - at)[:2]))
    high = later.bottom - post.bottom
    hole = 0.5 * (ring.opening or 0.6 * float(ring.extents[:2].min()))
    if off > hole:
        score = max(0.0, 0.4 * (1 - off / (2 * hole)))
        return Score(score, f"{ring.label} lies {100 * off:.1f} cm beside the middle of {post.label}.")
    if high > max(ON_TOP, 0.25 * (post.top - post.bottom)):
        return Score(0.2, f"{ring.label} hangs on {post.label} {100 * high:.1f} cm above its foot.")
    return Score(1.0, f"{ring.label} lies around the foot of {post.label}.")


def drawn(case: Case) -> Score:
    """On its goal, if there is one; else out of its holder, in the hand or beside it."""
    theme = case.handled()
    if case.role("goal") is not None or any(w.stage == "release" for w in case.planned):
        return placed(case, theme, case.role("goal"))
    after, way = case.perceived(), case.way(theme.id)
    length, later = float(np.linalg.norm(way)), case.later(theme)
    if later is None and case.holding and not something_at(theme, after, case.config.same_place):
        return Score(0.8, f"{theme.label} is gone from its place and the hand holds something.")
    if later is None or length < case.config.same_place:
        raise InconclusiveError(f"{theme.label} was not seen again.")
    along = float((later.centre - theme.centre) @ way) / length
    return _travelled(theme, along, length, SHARE_DRAWN * length)
