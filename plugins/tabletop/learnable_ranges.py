"""The hidden properties of the learnable world, and their ranges.

Each range includes values that suit the planner's defaults, so that some families need no memory. The ranges were fixed
before any arm was measured in this world; docs/learnable_worlds.md gives their reasons.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np


@dataclass(frozen=True)
class Ranges:
    """The ranges of a family's properties, uniform unless noted.

    ``jar`` and ``bottle``: degrees of turn at which a cap comes loose, and the share of bottles whose thread is
    ``left_handed``. ``click``: metres that a button travels until its lamp is lit. ``hold``: seconds that it has to be
    held down. ``catch``: metres that a drawer's handle is lifted before the drawer can be pulled; the share
    ``no_catch`` of the drawers has none. ``spring``: degrees of opening from which a lid stays open by its weight;
    short of that its spring shuts it.
    """

    jar: tuple[float, float] = (80.0, 300.0)
    bottle: tuple[float, float] = (80.0, 250.0)
    left_handed: float = 0.5
    click: tuple[float, float] = (0.004, 0.020)
    hold: tuple[float, float] = (0.2, 3.0)
    catch: tuple[float, float] = (0.006, 0.025)
    no_catch: float = 0.25
    spring: tuple[float, float] = (98.0, 114.0)


RANGES = Ranges()


@dataclass(frozen=True)
class Family:
    """Things of one kind that look the same and behave the same: a colour word, and a value in the kind's unit.

    ``value`` of its ``trait``: radians of turn of a ``jar`` or ``bottle`` (negative: with the clock), metres of travel
    of a ``click``, seconds of a ``hold``, metres of lift of a ``catch`` (0: none), radians of a lid's ``spring``.
    """

    colour: str
    trait: str
    value: float


TRAITS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "open_jar": ("jar",),
        "open_wine": ("bottle",),
        "lamp_on": ("click", "hold"),
        "open_drawer": ("catch",),
        "open_box": ("spring",),
    }
)
"""The tasks with something to learn, and their traits: with several, the families take them in turn."""

COLOURED = ("red", "blue", "lime", "magenta", "cyan", "orange")
"""Colours of families: hues that are distinct in any light."""


def families(kind: str, world: int, count: int, ranges: Ranges = RANGES) -> tuple[Family, ...]:
    """The families of a kind in the world of that seed, each of another colour; the same at each call."""
    rng = np.random.default_rng([world, zlib.crc32(kind.encode())])
    colours = [COLOURED[i] for i in rng.permutation(len(COLOURED))[:count]]
    traits = (TRAITS[kind][i % len(TRAITS[kind])] for i in range(count))
    return tuple(Family(c, t, _drawn(t, rng, ranges)) for c, t in zip(colours, traits, strict=True))


def _drawn(trait: str, rng: np.random.Generator, ranges: Ranges) -> float:
    value = float(rng.uniform(*getattr(ranges, trait)))
    if trait in ("jar", "bottle", "spring"):
        value = float(np.deg2rad(value))
    if trait == "bottle" and rng.random() < ranges.left_handed:
        return -value
    if trait == "catch" and rng.random() < ranges.no_catch:
        return 0.0
    return value
