"""Relations between perceived objects: on, in, beside, to a side, between, and which of several is the outermost.

Perceived boxes are off by a centimetre, and things stand askew on others or reach into them: what is not clear by that
much is left open, so that several objects remain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from gvla2.planning.scene import SIDES, TOUCHING, Scene, SceneObject

CLOSE, BESIDE = 0.012, 0.25
"""Heights that differ less may touch; objects next to one another are no further apart, edge to edge; metres."""
ASLANT = 0.2
"""A known object that leans by more does not stand by itself, radians; one that is seen from one side may seem to lean
by less."""
ASKEW = 0.35
"""What stands on the edge of something has its middle no further beyond it than this share of its own width."""
SQUARE = 0.5
"""What is squarely to a side of something is in a direction from it with this cosine to the side's."""
ASTRIDE, MIDWAY = 0.4, 0.15
"""What is between two others is less off their line than this share of its length; of several, those count that are
not further off than the nearest one by the second share."""
SIZE_SLACK, PLACE_SLACK, KNOWN_SLACK = 0.05, 0.015, 0.005
"""Differences of size (share) and place (metres) below perception's accuracy do not decide; recognised objects are
placed more accurately."""

Extreme = Literal[
    "left", "right", "front", "back", "near", "far", "table", "middle",
    "big", "small", "tall", "short", "top", "bottom",
]  # fmt: skip
"""Criteria that single one of several objects out. ``near`` and ``far`` are from the robot, the sides as the scene's
viewpoint has them; ``table`` is nearest to the middle of the workspace, ``middle`` to that of the objects, or in a
stack the one at middle height; ``big`` is by volume, ``tall`` by height, ``top`` by place."""


def holds(obj: SceneObject, relation: str, mark: SceneObject, scene: Scene) -> bool:
    """Whether an object is in a relation to another: "on", "in", "from" (it can be taken from there), "beside",
    "left_of", "right_of", "front_of" or "behind".
    """
    match relation:
        case "on":
            height, sunk = obj.bottom - mark.top, 0.5 * float(mark.extents[2]) if mark.opening else 0.0
            aside = float(mark.distances([*obj.centre[:2], mark.centre[2]]))
            askew = -0.5 * mark.extents[2] < height < 2 * CLOSE and aside < ASKEW * obj.extents[:2].min()
            return bool(askew or (_over(obj, mark) and height > -2 * CLOSE - sunk))
        case "in":
            return obj.parent == mark.id or (_over(obj, mark) and obj.bottom < mark.top - CLOSE)
        case "from":
            touches = bool((mark.distances(obj.corners()) <= TOUCHING).any())
            on = mark.joint is None and holds(obj, "on", mark, scene)  # what is above a drawer is not on it
            return touches or on or holds(obj, "in", mark, scene)
        case "beside":
            return _apart(obj, mark) < BESIDE
        case "left_of" | "right_of" | "front_of" | "behind":
            return float((obj.centre - mark.centre) @ scene.side(relation)) > CLOSE
    return True


def on_something_unseen(obj: SceneObject, scene: Scene) -> bool:
    """Whether an object stands above the table without anything that is seen to carry it."""
    above = obj.bottom > scene.table_height + CLOSE and not obj.parent
    others = [o for o in scene.objects if o.id != obj.id and o.shape != "region"]
    return above and not any(holds(obj, "on", o, scene) or holds(obj, "in", o, scene) for o in others)


def holds_any(obj: SceneObject, relation: str, marks: Sequence[SceneObject], scene: Scene) -> bool:
    """Whether an object is in the relation to any of the marks other than itself."""
    return any(holds(obj, relation, mark, scene) for mark in marks if mark is not obj)


def related(
    objects: Sequence[SceneObject], relation: str, marks: Sequence[SceneObject], scene: Scene
) -> list[SceneObject]:
    """Those in the relation to any of the marks: beside it the nearest, to a side those that are squarely there, if any
    are, and on what nothing stands on what leans on it.
    """
    there = [o for o in objects if holds_any(o, relation, marks, scene)]
    if relation == "on" and not there:
        return [o for o in objects if any(_leans(o, mark) for mark in marks)]
    if relation == "beside" and there:
        there = [o for o in there if not holds_any(o, "on", marks, scene)] or there
        gaps = [min(_apart(o, mark) for mark in marks) for o in there]
        slack = KNOWN_SLACK if all(o.known for o in (*there, *marks)) else PLACE_SLACK
        return [o for o, gap in zip(there, gaps, strict=True) if gap <= min(gaps) + slack]
    if relation in SIDES:
        way = scene.side(relation)
        return [
            o for o in there if any((o.centre - m.centre) @ way > SQUARE * _gap(o, m) for m in marks)
        ] or there
    return there


def between_two(objects: Sequence[SceneObject], one: SceneObject, other: SceneObject) -> list[SceneObject]:
    """Those between two others: near their line, and not clearly less near than another."""
    line = (other.centre - one.centre)[:2]
    length = max(float(np.linalg.norm(line)), 1e-9)

    def off(obj: SceneObject) -> float:
        to = (obj.centre - one.centre)[:2]
        along = float(to @ line) / length
        outside = obj in (one, other) or not 0.0 < along < length
        return float("inf") if outside else float(np.sqrt(max(float(to @ to) - along**2, 0.0))) / length

    least = min(map(off, objects), default=0.0)
    return [o for o in objects if off(o) < min(ASTRIDE, least + MIDWAY)]


def extreme(objects: Sequence[SceneObject], by: Extreme, scene: Scene) -> list[SceneObject]:
    """The most extreme of the objects by a criterion, and all that are not clearly less so."""
    if not objects:
        return []
    heights, sizes = np.array([o.centre[2] for o in objects]), np.array([o.extents for o in objects])
    places = np.array([o.centre[:2] for o in objects])
    low, high = scene.workspace.low, scene.workspace.high
    distances = np.linalg.norm(places - [low[0], 0.5 * (low[1] + high[1])], axis=1)
    left, back = places @ scene.side("left_of")[:2], places @ scene.side("behind")[:2]
    ranks = {
        "left": -left, "right": left, "back": -back, "front": back, "near": distances, "far": -distances,
        "table": np.linalg.norm(places - 0.5 * (low + high)[:2], axis=1),
        "middle": np.linalg.norm(places - places.mean(axis=0), axis=1),
        "big": -sizes.prod(axis=1), "small": sizes.prod(axis=1), "tall": -sizes[:, 2], "short": sizes[:, 2],
        "top": -heights, "bottom": heights,
    }[by]  # fmt: skip
    slack = PLACE_SLACK
    if by in ("big", "small", "tall", "short"):
        slack = SIZE_SLACK * float(np.abs(ranks.min()))
    elif by in ("top", "bottom"):
        slack = CLOSE
    elif by == "middle" and np.ptp(heights) > np.ptp(places, axis=0).max():
        ranks, slack = np.abs(heights - np.median(heights)), CLOSE
    return [o for o, rank in zip(objects, ranks, strict=True) if rank <= ranks.min() + slack]


def _gap(one: SceneObject, other: SceneObject) -> float:
    return float(np.linalg.norm((one.centre - other.centre)[:2]))


def _apart(one: SceneObject, other: SceneObject) -> float:
    """The level distance between the outlines of two objects, metres; 0 where they overlap."""
    pairs = ((one, other), (other, one))
    return min(float(b.distances(a.outline() * [1, 1, 0] + [0, 0, b.centre[2]]).min()) for a, b in pairs)


def _leans(obj: SceneObject, mark: SceneObject) -> bool:
    return bool(np.linalg.norm(obj.righting) > ASLANT and _apart(obj, mark) < TOUCHING)


def _over(one: SceneObject, other: SceneObject) -> bool:
    reach = 0.5 * float(np.linalg.norm(other.extents[:2])) + 0.01
    return other.covers(one.centre) or _gap(one, other) < min(reach, 0.5 * float(other.extents[:2].max()))
