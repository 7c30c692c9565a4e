"""A trained policy's contract: from what the cameras see to the next joint targets, again and again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation


class Policy(Protocol):
    """Drives the robot in closed loop, in place of perceiver, planner and executor.

    ``rate`` is in actions a second, ``seconds`` are those of the robot after which an episode is given up, ``source``
    says for the record what drives: the kind of policy and its checkpoint.
    """

    @property
    def rate(self) -> float:
        """Actions a second."""
        ...

    @property
    def seconds(self) -> float:
        """Seconds of an episode at most."""
        ...

    @property
    def source(self) -> str:
        """The kind of policy and its checkpoint."""
        ...

    def begin(self, instruction: str) -> None:
        """Start an episode: nothing of the last one is remembered."""
        ...

    def act(self, observation: Observation) -> FloatArray:
        """(dof + 1,) where the robot is to be after ``1 / rate`` seconds: its joints, radians, and the width between
        the fingers, metres.
        """
        ...


@dataclass(frozen=True)
class Rollout:
    """What a policy did in an episode: its ``source``, its ``rate`` and the number of its actions."""

    source: str
    rate: float
    steps: int
