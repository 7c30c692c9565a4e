"""Motion schemas: from objects and theta to proposed trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from gvla2.planning.contracts import Abstention
from gvla2.planning.skill import Job, Proposal
from gvla2.skills.schemas.hinge import propose_close, propose_open
from gvla2.skills.schemas.pick_place import propose_insert, propose_pick, propose_place
from gvla2.skills.schemas.pull import propose_draw, propose_pull
from gvla2.skills.schemas.push import propose_press, propose_push
from gvla2.skills.schemas.twist import propose_twist

PROPOSE: Mapping[str, Callable[[Job], Sequence[Proposal] | Abstention]] = {
    "pick": propose_pick,
    "place": propose_place,
    "push": propose_push,
    "press": propose_press,
    "twist": propose_twist,
    "insert": propose_insert,
    "open": propose_open,
    "close": propose_close,
    "pull": propose_pull,
    "draw": propose_draw,
}
"""The motions of the standard skills, by name."""
