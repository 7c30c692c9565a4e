"""The part of a lifted path in which the hand holds nothing: it pushes a thing along."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gvla2.skills.proposals import Job, Path, Proposal, pointing
from gvla2.skills.schemas.place import support_along

if TYPE_CHECKING:
    from gvla2.skills.lifting import PathPoint

SPREAD = 0.6
"""The fingers push by this share of the face that they meet: two contacts carry a thing without turning it."""


def pushed(job: Job, points: Sequence[PathPoint], k: int) -> list[Proposal]:
    """From point ``k`` to the next one, along the table, the fingers across the way; one proposal a way round."""
    theme, hand, theta = job.theme, job.hand, job.theta
    begin, end = points[k].array, points[k + 1].array
    way = (end - begin) * [1.0, 1.0, 0.0]
    way = way / np.linalg.norm(way)
    across = np.array([-way[1], way[0], 0.0])
    depth = support_along(theme.world_from_object, theme.extents, way)
    face = support_along(theme.world_from_object, theme.extents, across)
    behind = theme.centre - way * (depth + 0.5 * hand.finger_breadth + theta["standoff"])
    if (begin - behind) @ way > 0.0:  # over the thing itself, or too close for the hand to come down
        begin = begin - way * float((begin - behind) @ way)
    opening = float(np.clip(2.0 * SPREAD * face / hand.max_width, 0.0, 1.0))
    low = max(job.scene.table_height + theta["push_height"] + hand.tip_beyond_tcp, job.lowest_tcp())
    above = min(theme.top + 0.02 + hand.tip_beyond_tcp, job.ceiling())
    touched, found = frozenset({theme.id}), []
    for sign in (1.0, -1.0):
        path = Path(theta["speed"], theta["contact_speed"], pointing(sign * across), gripper=opening)
        start, stop = np.array([*begin[:2], low]), np.array([*end[:2], low])
        off = stop - theta["standoff"] * way
        path.go("approach", np.array([*begin[:2], above]), gripper=opening)
        path.line("lower", start)
        path.line("push", stop, allowed=touched, slow=True)
        path.line("back off", off, allowed=touched)
        path.line("retreat", np.array([*off[:2], above]), allowed=touched)
        how = "push along the path" + (", hand turned round" if sign < 0 else "")
        found.append(Proposal(how, ("approach:top", "approach:straight"), 0.8, path.trajectory()))
    return found
