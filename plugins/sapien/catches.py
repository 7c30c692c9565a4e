"""Catches: a joint that is locked until another joint has moved."""

from __future__ import annotations

from typing import Any

from gvla2.robot.task import Catch, Joint


class Caught:
    """One catch: it locks or unlocks while its joint is at rest, and stays free once that has moved."""

    def __init__(self, catch: Catch, held: Joint, joints: dict[str, tuple[Any, int]]) -> None:
        self._catch = catch
        self._free = held.limits
        self._shut = (
            max(held.limits[0], held.rest - catch.play),
            min(held.limits[1], held.rest + catch.play),
        )
        self._articulation, self._index = joints[catch.joint]
        self._joint = self._articulation.active_joints[self._index]
        self._key, self._place = joints[catch.key]
        self._holds = True
        self._gone = False
        self._joint.set_limits([list(self._shut)])

    def watch(self) -> None:
        """Lock or unlock by the key's present position."""
        if self._gone:
            return
        low, high = self._shut
        away = (
            not low - self._catch.play
            <= float(self._articulation.qpos[self._index])
            <= high + self._catch.play
        )
        self._gone = away and not self._holds
        at = float(self._key.qpos[self._place])
        holds = not self._gone and not self._catch.travel <= at <= self._catch.until
        if holds != self._holds:
            self._holds = holds
            self._joint.set_limits([list(self._shut if holds else self._free)])
