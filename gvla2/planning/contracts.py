"""The interfaces of perceivers and planners, and the data between them and the loop.

A planner's answer is a :class:`Plan`: a trajectory with what it means, or a typed refusal.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2.planning.arm import Arm
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.effects import Effect, Scale
from gvla2.planning.programs import Program
from gvla2.planning.scene import Box, Scene
from gvla2.planning.skill import Skill
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


class Perceiver(Protocol):
    """Turns RGB-D views into a labelled 3D scene."""

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene X_t inside ``workspace``; raises :class:`~gvla2.errors.PerceptionError` when nothing is seen."""
        ...


@dataclass(frozen=True)
class Done:
    """The lasting effect of a failed attempt of the same episode: the amount of ``parameter`` (its own unit, earlier
    attempts included) done to the object at ``place``, metres. A turned cap stays turned.
    """

    skill: str
    parameter: str
    value: float
    place: tuple[float, float, float]


@dataclass(frozen=True)
class Advice:
    """Memory's advice to a planner: a bounded text block, typed effects and programs; all may be empty.

    ``programs`` succeeded in similar episodes, best first (see :mod:`gvla2.planning.programs`). ``done`` is of this
    episode's own attempts.
    """

    text: str = ""
    effects: tuple[Effect, ...] = ()
    programs: tuple[Program, ...] = ()
    done: tuple[Done, ...] = ()


@dataclass(frozen=True)
class PlanRequest:
    """Everything a planner may use. ``start`` (4, 4) is the tool's pose, ``joints`` (dof,) its joints, radians.

    ``observation`` is the scene's source, for planners that use images. ``skills`` is the table of skills that any
    planner may call, plugins' included (empty: the standard ones). ``rejections`` are sentences from the checks about
    this planner's last answer, on a second try, and ``rejected`` is that answer, if it was a plan.
    """

    instruction: str
    scene: Scene
    arm: Arm
    start: FloatArray
    joints: FloatArray
    observation: Observation
    advice: Advice = Advice()
    rejections: tuple[str, ...] = ()
    skills: Mapping[str, Skill] = field(default_factory=dict)
    rejected: Plan | None = None


class Planner(Protocol):
    """Plans waypoints from an instruction, a scene and advice."""

    def plan(self, request: PlanRequest) -> Plan:
        """A plan, or an abstention; never an exception for an impossible instruction."""
        ...
