"""The skills that come with gvla2, offered through the same hook as third parties'."""

from __future__ import annotations

from collections.abc import Iterable

from gvla2 import hookimpl
from gvla2.planning.skill import Skill
from gvla2.skills.table import STANDARD


@hookimpl
def gvla2_skills() -> Iterable[Skill]:
    """Pick, place, push, press, twist, insert, open, close, pull and draw."""
    return STANDARD.values()
