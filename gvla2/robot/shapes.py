"""Hollow things made of solid pieces: cups, trays, stands, rings."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.robot.task import Primitive

Rgb = tuple[float, float, float]


def cup(diameter: float, height: float, wall: float, rgb: Rgb, sides: int = 16) -> tuple[Primitive, ...]:
    """An open vessel that stands on z = 0: a disc for its floor and a ring of flat staves; metres.

    The staves' middles touch the circle of ``diameter`` from inside, so that only their edges stick out of it, by 2 %
    of the radius at 16 ``sides``.
    """
    radius = 0.5 * diameter
    breadth = 2.0 * radius * np.tan(np.pi / sides)
    floor = Primitive("cylinder", (2 * (radius - wall), 2 * (radius - wall), wall), rgb, _up(0, 0, wall / 2))
    staves = []
    for turn in 2.0 * np.pi * np.arange(sides) / sides:
        pose = rigid(Rotation.from_euler("z", turn).as_matrix()) @ _up(radius - wall / 2, 0, height / 2)
        staves.append(Primitive("box", (wall, float(breadth), height), rgb, pose))
    return (floor, *staves)


def tray(size: tuple[float, float, float], wall: float, rgb: Rgb) -> tuple[Primitive, ...]:
    """An open box that stands on z = 0, of outer ``size`` (x, y, z) with floor and walls of thickness ``wall``."""
    x, y, z = size
    return (
        Primitive("box", (x, y, wall), rgb, _up(0, 0, wall / 2)),
        *square_ring((x, y, z - wall), wall, rgb, wall),
    )


def square_ring(
    size: tuple[float, float, float], wall: float, rgb: Rgb, bottom: float = 0.0
) -> tuple[Primitive, ...]:
    """Four walls about z, open above and below, from z = ``bottom`` on; outer ``size`` (x, y, z), metres."""
    x, y, z = size
    middle = bottom + z / 2
    along = (x, wall, z)
    across = (wall, y - 2 * wall, z)
    return (
        Primitive("box", along, rgb, _up(0, (y - wall) / 2, middle)),
        Primitive("box", along, rgb, _up(0, -(y - wall) / 2, middle)),
        Primitive("box", across, rgb, _up((x - wall) / 2, 0, middle)),
        Primitive("box", across, rgb, _up(-(x - wall) / 2, 0, middle)),
    )


def _up(x: float, y: float, z: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return rigid(translation=(x, y, z))
