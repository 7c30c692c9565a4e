"""What several solids are together: a bottle with its neck, a box with its lid, a drawer with its handle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.pixels import Pixels
from gvla2_plugins.classical.things import THIN, Thing, upright_rectangle


class SceneDraft:
    """The things of a scene while they are put together; what was taken into another is gone."""

    def __init__(self, pixels: Pixels, things: Sequence[Thing]) -> None:
        self.things = list(things)
        self.looks = [np.median(pixels.look[t.members], axis=0) for t in things]
        self._into = list(range(len(things)))

    def left(self) -> list[int]:
        """Indices of the things that are still there and painted plainly."""
        return [k for k, into in enumerate(self._into) if into == k and not self.things[k].textured]

    def now(self, k: int) -> int:
        """Where a thing has gone to: itself while it is there."""
        while k >= 0 and self._into[k] != k:
            k = self._into[k]
        return k

    def carrier(self, k: int) -> int:
        """What carries a thing now, -1 for the table."""
        return self.now(self.things[k].on)

    def take_in(self, k: int, others: Sequence[int]) -> None:
        """Make other things part of a thing's points; its own pixels still tell its colour."""
        for j in others:
            self._into[j] = k
        points = np.concatenate([self.things[k].points, *(self.things[j].points for j in others)])
        self.things[k] = replace(self.things[k], points=points)

    def finished(self) -> list[Thing]:
        """What is left, with its places among what is left."""
        left = [k for k, into in enumerate(self._into) if into == k]
        place = {k: i for i, k in enumerate(left)} | {-1: -1}
        done = []
        for k in left:
            thing = self.things[k]
            on, part_of = place[self.now(thing.on)], place[self.now(thing.part_of)]
            done.append(replace(thing, on=-1 if on == place[k] else on, part_of=part_of))
        return done


def put_together(
    pixels: Pixels, things: Sequence[Thing], rules: Sequence[Callable[[SceneDraft], None]]
) -> list[Thing]:
    """The things after all rules, in their order; each sees what those before it made."""
    draft = SceneDraft(pixels, things)
    for rule in rules:
        rule(draft)
    return draft.finished()


def boxed(thing: Thing, host: Thing, low: FloatArray, high: FloatArray) -> Thing:
    """The thing as an upright box from ``low`` to ``high`` (3,), metres from another's centre along its axes."""
    centre = host.pose[:3, :3] @ (0.5 * (low + high)) + host.centre
    lengths = np.maximum(high - low, THIN)
    yaw, width, depth = upright_rectangle(host.yaw, float(lengths[0]), float(lengths[1]))
    return replace(thing, kind="box", centre=centre, yaw=yaw, extents=np.array([width, depth, lengths[2]]))
