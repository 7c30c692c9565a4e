"""The staged schemas, one file a skill: from grounded objects and theta to proposed trajectories."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from gvla2.planning.contracts import Abstention
from gvla2_plugins.skill.proposals import Job, Proposal
from gvla2_plugins.skill.schemas.hinge import propose_close, propose_open
from gvla2_plugins.skill.schemas.insert import propose_insert
from gvla2_plugins.skill.schemas.pick import propose_pick
from gvla2_plugins.skill.schemas.place import propose_place
from gvla2_plugins.skill.schemas.press import propose_press
from gvla2_plugins.skill.schemas.pull import propose_pull
from gvla2_plugins.skill.schemas.pull_out import propose_draw
from gvla2_plugins.skill.schemas.push import propose_push
from gvla2_plugins.skill.schemas.twist import propose_twist

SCHEMAS: Mapping[str, Callable[[Job], list[Proposal] | Abstention]] = {
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
"""Skill to its schema. A new skill is a file here, its verbs in the lexicon and its theta in ``parameters``."""
