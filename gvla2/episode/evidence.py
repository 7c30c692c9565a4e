"""Input of a robot's verifier: scenes before and after, the plan, the report, and how objects of both scenes match."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gvla2.memory.contracts import Evidence
from gvla2.planning.contracts import Plan
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import PRINTED, READ_ALIKE, Scene, SceneObject, likeness_of_words
from gvla2.robot.report import ExecutionReport

MAX_DIFFERENCE = 1.0
"""Objects that differ by more are different ones."""

_UNMATCHED = 10.0
_PLACE_WEIGHT = 0.15
_OTHER_WORDS = 0.7
_STILL, _STILL_WEIGHT = 0.03, 0.2


@dataclass(frozen=True, kw_only=True)
class RobotEvidence(Evidence):
    """Evidence of one episode, as the robot itself could gather it: perceived scenes, never true state.

    ``after`` is None when nothing could be perceived at the end. ``gripper_width`` at the end, metres.
    """

    before: Scene
    after: Scene | None
    plan: Plan
    checks: CheckReport
    report: ExecutionReport
    gripper_width: float


def correspond(before: Scene, after: Scene) -> dict[str, SceneObject]:
    """The later object of each earlier one, by its id, with the least total difference; what is missing was not seen.

    Distance counts little, so that a moved object is found again; an unchanged place counts more than a changed label,
    so that its unmoved twin keeps its own identity. Painted regions match regions only.
    """
    if not before.objects or not after.objects:
        return {}
    cost = np.array([[_cost(a, b) for b in after.objects] for a in before.objects])
    pairs = zip(*linear_sum_assignment(cost), strict=True)
    return {before.objects[i].id: after.objects[j] for i, j in pairs if cost[i, j] < _UNMATCHED}


def _cost(first: SceneObject, second: SceneObject) -> float:
    different = difference(first, second)
    if different > MAX_DIFFERENCE:
        return _UNMATCHED
    moved = float(np.linalg.norm(first.centre - second.centre))
    return different + _PLACE_WEIGHT * min(moved / 0.3, 1.0) + _STILL_WEIGHT * min(moved / _STILL, 1.0)


def difference(first: SceneObject, second: SceneObject) -> float:
    """Dissimilarity of two perceived objects: 0 for the same colour, size and label; above 1 for different objects.

    Of objects on which no common word was read, only those that look just alike are the same. Sizes may shrink in part,
    because a hand hides some of what it holds. Of two known objects the names decide, as they do for a known object and
    a cabinet or its drawer that the same gallery named.
    """
    known = [obj.known is not None for obj in (first, second)]
    if all(known) or (any(known) and first.named_by == second.named_by):
        return 0.0 if first.label == second.label else 2.0 * MAX_DIFFERENCE
    if (first.shape == "region") != (second.shape == "region"):
        return 2.0 * MAX_DIFFERENCE
    colour = min(float(np.linalg.norm(first.rgb - second.rgb)) / 0.5, 1.5)
    if first.colour and second.colour:
        # Named colours settle most cases; the rgb of one object changes with the shadow on it.
        colour = 0.3 * colour if first.colour == second.colour else max(colour, 0.5)
    sizes = np.log((np.sort(first.extents) + 0.005) / (np.sort(second.extents) + 0.005))
    size = min(float(np.abs(sizes).mean()), 1.5)
    label = 0.0 if first.label == second.label else 0.15
    if first.named_by == second.named_by == PRINTED:
        words, others = first.label.split()[:-1], second.label.split()[:-1]
        alike = any(likeness_of_words(one, other) >= READ_ALIKE for one in words for other in others)
        label = 0.0 if alike else _OTHER_WORDS
    return colour + 0.6 * size + label
