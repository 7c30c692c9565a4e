"""Catches: a joint whose limits are shut until another joint has moved far enough."""

from __future__ import annotations

from typing import Any

from gvla2.robot.task import Catch, Joint


class Caught:
    """One catch, holding until it is free; for ever after that."""

    def __init__(self, catch: Catch, held: Joint, joints: dict[str, tuple[Any, int]]) -> None:
        self._catch, self._limits = catch, held.limits
        articulation, index = joints[catch.joint]
        self._joint = articulation.active_joints[index]
        self._key, self._place = joints[catch.key]
        self.free = False
        rest = held.rest
        self._joint.set_limits([[max(held.limits[0], rest - catch.play), min(held.limits[1], rest + catch.play)]])

    def watch(self) -> None:
        """Let go where the key has travelled far enough."""
        if not self.free and float(self._key.qpos[self._place]) >= self._catch.travel:
            self._joint.set_limits([list(self._limits)])
            self.free = True
