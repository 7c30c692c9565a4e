"""A planner's answer: a trajectory with what it means, or a typed refusal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.effects import Scale
from gvla2.planning.programs import Program
from gvla2.planning.trajectory import Trajectory

AbstentionKind = Literal[
    "unknown_skill", "nothing_matches", "ambiguous", "no_goal", "unreachable", "too_wide", "other"
]


@dataclass(frozen=True)
class Abstention:
    """A planner's typed refusal: nothing is moved.

    ``unread``: words of the instruction were not understood, so a more capable planner may find a plan; the object need
    not be absent.
    """

    kind: AbstentionKind
    message: str
    unread: bool = False

    @property
    def gives_way(self) -> bool:
        """Whether another planner may do better; otherwise the refusal is final."""
        return self.unread or self.kind in ("other", "unknown_skill", "unreachable")


class RefusedError(Exception):
    """Ends a search for calls or a plan with a refusal, its ``abstention``."""

    def __init__(self, kind: AbstentionKind, message: str, unread: bool = False) -> None:
        super().__init__(message)
        self.abstention = Abstention(kind, message, unread)


@dataclass(frozen=True)
class Candidate:
    """One option that a planner considered: what, its score, and why it was dropped ("" if it was not).

    ``approaches`` are the names by which an effect of kind ``forbid`` rules it out ("approach:top").
    """

    description: str
    score: float
    rejected: str = ""
    approaches: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """A planner's answer: a trajectory, or an abstention with its reason.

    ``skill`` is a word such as "pick"; ``roles`` maps theme, goal, part to scene object ids; ``parameters`` are the
    numbers theta that shaped the motion, SI units; ``scales`` gives, for those that scale with a side of the handled
    object, that side and its length (:data:`~gvla2.planning.effects.Scale`), so that lessons transfer to other sizes.
    ``notes`` are plain sentences. ``fallback`` names the planner that stepped in, "" when none did. ``transcript``
    holds prompts and answers of a language model, if one was asked.

    A plan may be one part of a longer program: ``calls`` are the skill calls that this trajectory carries out,
    ``remaining`` those that come after the robot has looked again, planned with ``options``. ``program`` is the plan in
    the planner's own language, as memory keeps it after a success.
    """

    trajectory: Trajectory | None
    skill: str = ""
    roles: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    candidates: tuple[Candidate, ...] = ()
    abstention: Abstention | None = None
    notes: tuple[str, ...] = ()
    fallback: str = ""
    transcript: tuple[Mapping[str, Any], ...] = ()
    scales: Mapping[str, Scale] = field(default_factory=dict)
    calls: tuple[SkillCall, ...] = ()
    remaining: tuple[SkillCall, ...] = ()
    options: SkillOptions = field(default_factory=SkillOptions)
    program: Program | None = None
