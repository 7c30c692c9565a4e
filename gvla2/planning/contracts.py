"""The interfaces of perceivers and planners, and the data between them and the loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.geometry.views import Observation
from gvla2.planning.arm import Arm
from gvla2.planning.effects import Effect
from gvla2.planning.plan import Abstention, AbstentionKind, Candidate, Plan, RefusedError
from gvla2.planning.programs import Program
from gvla2.planning.scene import Box, Scene
from gvla2.planning.skill import Skill
from gvla2.planning.trajectory import Trajectory

__all__ = [
    "Abstention", "AbstentionKind", "Advice", "Candidate", "Done", "Perceiver", "Plan", "PlanRequest", "Planner",
    "RefusedError", "Tried",
]  # fmt: skip


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
class Tried:
    """A grasp of a failed attempt: the tool's poses (4, 4) where the hand closed and where it opened again, both moved
    with the objects to where these are now. ``release`` is None if the object was lost on the way: then no place makes
    the grasp better.
    """

    grasp: FloatArray
    release: FloatArray | None = None

    def repeated(self, poses: Sequence[FloatArray], trajectory: Trajectory) -> bool:
        """Whether a trajectory, whose waypoints have these tool poses (4, 4), does nearly the same."""
        close, opens = trajectory.grips()
        if close is None or not _alike(self.grasp, poses[close]):
            return False
        return self.release is None or (opens is not None and _alike(self.release, poses[opens]))


ACROSS, ALONG, TURNED = 0.01, 0.004, np.radians(15.0)
"""Grasps are alike within these distances across and along the approach, metres, and this angle, radians: a look errs
by less, and a grasp deeper by more is the remedy for a slip."""


def _alike(one: FloatArray, other: FloatArray) -> bool:
    """Whether two tool poses (4, 4) are nearly the same grasp, its two fingers being equal."""
    between = invert_rigid(one) @ other
    away = between[:3, 3]
    turned = min(abs(between[1, 1]), between[2, 2])  # of the closing direction and of the approach
    near = float(np.hypot(away[0], away[1])) < ACROSS and abs(float(away[2])) < ALONG
    return near and bool(turned > np.cos(TURNED))


@dataclass(frozen=True)
class Advice:
    """Memory's advice to a planner: a bounded text block, typed effects and programs; all may be empty.

    ``programs`` succeeded in similar episodes, best first (see :mod:`gvla2.planning.programs`). ``done`` and ``tried``
    are of this episode's own failed attempts.
    """

    text: str = ""
    effects: tuple[Effect, ...] = ()
    programs: tuple[Program, ...] = ()
    done: tuple[Done, ...] = ()
    tried: tuple[Tried, ...] = ()


@dataclass(frozen=True)
class PlanRequest:
    """Everything a planner may use. ``start`` (4, 4) is the tool's pose, ``joints`` (dof,) its joints, radians.

    ``observation`` is the scene's source, for planners that use images. ``skills`` is the table of skills that any
    planner may call, plugins' included (empty: the standard ones). ``rejections`` are sentences from the checks about
    this planner's last answer, on a second try.
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


class Planner(Protocol):
    """Plans waypoints from an instruction, a scene and advice."""

    def plan(self, request: PlanRequest) -> Plan:
        """A plan, or an abstention; never an exception for an impossible instruction."""
        ...
