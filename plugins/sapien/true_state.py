"""The true state of the simulated world, for a task's success check."""

from __future__ import annotations

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.sapien.bodies import PREFIX
from gvla2_plugins.sapien.world import World

HOLDING_FORCE = 0.2
"""Least force of a pressing finger, newtons; a cube of 0.125 kg needs about 0.5 N from each to stay."""

RESTING_SPEED = 0.02
"""Metres a second below which a body lies still."""


class TrueState:
    """Implements :class:`gvla2.robot.task.WorldState`."""

    def __init__(self, world: World) -> None:
        self._world = world

    def pose(self, body: str) -> FloatArray:
        """world_from_body (4, 4) now."""
        return self._world.body_pose(body)

    def joint(self, name: str) -> float:
        """Travel of a joint now, radians or metres."""
        return self._world.travel(name)

    def peak(self, name: str) -> float:
        """Largest travel of a joint since the reset, radians or metres."""
        return self._world.peaks[name]

    def held(self, body: str) -> bool:
        """Whether both fingers press on the body now."""
        forces = self._world.finger_forces().get(PREFIX + body, (0.0, 0.0))
        return min(forces) > HOLDING_FORCE

    def touching(self, body: str) -> frozenset[str]:
        """Names of the bodies that press on the body now; "table" and "robot" are among them."""
        return frozenset(self._world.touching(body))

    def resting(self, body: str) -> bool:
        """Whether the body lies still now and the robot does not touch it."""
        return self._world.body_speed(body) < RESTING_SPEED and "robot" not in self._world.touching(body)

    def loose(self, thread: str) -> bool:
        """Whether a thread has come loose."""
        return self._world.loose(thread)
