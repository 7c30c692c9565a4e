"""What can be learnt in the learnable world: properties that no camera sees, and the ranges that they are drawn from.

Each range holds what the planner's own defaults are right for, so that some families need no memory. The ranges were
written down before any arm was measured in this world; docs/learnable_worlds.md tells them with their reasons.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Ranges:
    """Where the properties of a family are drawn from, uniformly where nothing else is said.

    ``jar`` and ``bottle``: degrees of turn at which a cap comes loose, and the share of bottles whose thread is
    ``left_handed``. ``click``: metres that a button travels until its lamp is lit. ``catch``: metres that a drawer's
    handle is lifted before the drawer can be pulled; the share ``no_catch`` of the drawers has none.
    """

    jar: tuple[float, float] = (80.0, 300.0)
    bottle: tuple[float, float] = (80.0, 250.0)
    left_handed: float = 0.5
    click: tuple[float, float] = (0.004, 0.020)
    catch: tuple[float, float] = (0.006, 0.025)
    no_catch: float = 0.25


RANGES = Ranges()


@dataclass(frozen=True)
class Family:
    """Things of one kind that look the same and behave the same: a colour word, and a value in the kind's unit.

    ``value`` is radians of turn for ``open_jar`` and ``open_wine`` (negative: with the clock), metres of travel for
    ``lamp_on``, metres of lift for ``open_drawer`` (0: no catch).
    """

    colour: str
    value: float


KINDS = ("open_jar", "open_wine", "lamp_on", "open_drawer")
"""The tasks that have something to learn."""

COLOURED = ("red", "blue", "lime", "magenta", "cyan", "orange")
"""Colours of families: hues that are told apart in any light."""


def families(kind: str, world: int, count: int, ranges: Ranges = RANGES) -> tuple[Family, ...]:
    """The families of a kind in the world of that seed, each of another colour; the same at each call."""
    rng = np.random.default_rng([world, zlib.crc32(kind.encode())])
    colours = [COLOURED[i] for i in rng.permutation(len(COLOURED))[:count]]
    return tuple(Family(colour, _drawn(kind, rng, ranges)) for colour in colours)


def _drawn(kind: str, rng: np.random.Generator, ranges: Ranges) -> float:
    if kind == "open_jar":
        return float(np.deg2rad(rng.uniform(*ranges.jar)))
    if kind == "open_wine":
        turn = float(np.deg2rad(rng.uniform(*ranges.bottle)))
        return -turn if rng.random() < ranges.left_handed else turn
    if kind == "lamp_on":
        return float(rng.uniform(*ranges.click))
    lift = float(rng.uniform(*ranges.catch))
    return 0.0 if rng.random() < ranges.no_catch else lift
