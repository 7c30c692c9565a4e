"""What several solids are together: a bottle with its neck, a box with its lid, a drawer with its handle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2_plugins.classical.pixels import Pixels
from gvla2_plugins.classical.things import THIN, Thing, upright_rectangle


class Draft:
    """The things of a scene while they are put together; what was taken into another is gone."""

    def __init__(self, things: Sequence[Thing], looks: Sequence[FloatArray]) -> None:
        self.things = list(things)
        self.looks = list(looks)
        self._into = list(range(len(things)))

    def left(self) -> list[int]:
        """Indices of the things that are still there and painted plainly."""
        return [k for k in self._there() if not self.things[k].textured]

    def _there(self) -> list[int]:
        return [k for k in range(len(self.things)) if self._into[k] == k]

    def carrier(self, k: int) -> int:
        """What carries a thing now, -1 for the table."""
        return self.now(self.things[k].on)

    def now(self, k: int) -> int:
        """Where a thing has gone to: itself while it is there."""
        while k >= 0 and self._into[k] != k:
            k = self._into[k]
        return k

    def on_top(self, k: int) -> list[int]:
        """What a thing carries."""
        return [j for j in self.left() if j != k and self.carrier(j) == k]

    def change(self, k: int, thing: Thing) -> None:
        """Put another thing in a thing's place."""
        self.things[k] = thing

    def take_in(self, k: int, others: Sequence[int]) -> None:
        """Make other things part of a thing's points; its own pixels still tell its colour."""
        for j in others:
            self._into[j] = k
        points = np.concatenate([self.things[k].points, *(self.things[j].points for j in others)])
        self.things[k] = replace(self.things[k], points=points)

    def finished(self) -> list[Thing]:
        """What is left, with its places among what is left."""
        left = self._there()
        place = {k: i for i, k in enumerate(left)} | {-1: -1}
        done = []
        for k in left:
            thing = self.things[k]
            on, part_of = place[self.now(thing.on)], place[self.now(thing.part_of)]
            done.append(replace(thing, on=-1 if on == place[k] else on, part_of=part_of))
        return done


@dataclass(frozen=True)
class Rule:
    """One kind of whole: ``apply`` looks for it in a draft and puts it together there."""

    name: str
    apply: Callable[[Draft], None]


def put_together(pixels: Pixels, things: Sequence[Thing], rules: Sequence[Rule]) -> list[Thing]:
    """The things after all rules, in their order; each sees what those before it made."""
    looks = [np.median(pixels.look[t.members], axis=0) for t in things]
    draft = Draft(things, looks)
    for rule in rules:
        rule.apply(draft)
    return draft.finished()


def grown(thing: Thing, points: FloatArray, bottom: float, top: float) -> Thing:
    """The thing with the upright box about itself and points (N, 3), from ``bottom`` to ``top``."""
    local = thing.local(points)
    low = np.minimum(np.percentile(local[:, :2], 1.0, axis=0), -0.5 * thing.extents[:2])
    high = np.maximum(np.percentile(local[:, :2], 99.0, axis=0), 0.5 * thing.extents[:2])
    lengths, shift = high - low, 0.5 * (low + high)
    c, s = np.cos(thing.yaw), np.sin(thing.yaw)
    middle = thing.centre[:2] + np.array([[c, -s], [s, c]]) @ shift
    yaw, width, depth = thing.yaw, float(lengths[0]), float(lengths[1])
    yaw, width, depth = upright_rectangle(yaw, width, depth)
    height = max(THIN, top - bottom)
    return replace(
        thing,
        centre=np.array([*middle, 0.5 * (bottom + top)]),
        yaw=yaw,
        extents=np.array([width, depth, height]),
    )
