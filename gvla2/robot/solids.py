"""Hollow objects made of solid pieces (cups, trays, rings), and regions of space for success checks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, box_corners, invert_rigid, rigid, transform_points
from gvla2.robot.collision import coal_shape
from gvla2.robot.kinematics import library
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Primitive, Solid


@dataclass(frozen=True)
class Volume:
    """A box of full side lengths ``size`` (x, y, z), metres, about the origin of ``world_from_volume`` (4, 4).

    ``round``: instead the cylinder about the box's z axis that fills it.
    """

    world_from_volume: FloatArray
    size: tuple[float, float, float]
    round: bool = False

    def holds(self, point: FloatArray) -> bool:
        """Whether a world point (3,) is inside."""
        x, y, z = transform_points(invert_rigid(self.world_from_volume), point)
        a, b, c = 0.5 * np.asarray(self.size)
        if self.round:
            return bool((x / a) ** 2 + (y / b) ** 2 <= 1.0 and abs(z) <= c)
        return bool(abs(x) <= a and abs(y) <= b and abs(z) <= c)

    def meets(self, body: Body, world_from_body: FloatArray) -> bool:
        """Whether any solid of a body, at its pose (4, 4), shares a point with the volume; meshes as their boxes."""
        coal = library("coal")
        mine, at = coal_shape("cylinder" if self.round else "box", self.size), self.world_from_volume
        here = coal.Transform3s(at[:3, :3], at[:3, 3])
        for solid in body.solids:
            pose = world_from_body @ solid.body_from_shape
            there = coal.Transform3s(pose[:3, :3], pose[:3, 3])
            other, result = coal_shape(solid.kind, solid.size), coal.CollisionResult()
            if coal.collide(mine, here, other, there, coal.CollisionRequest(), result):
                return True
        return False


def on(surface: FloatArray, size: tuple[float, float], height: float) -> Volume:
    """The box of ``height`` standing on a rectangle of ``size`` about the origin of ``surface`` (4, 4), z up."""
    return Volume(surface @ rigid(translation=(0.0, 0.0, height / 2)), (*size, height))


def lowest(solid: Solid, world_from_body: FloatArray) -> float:
    """World z of a solid's lowest point with its body at ``world_from_body`` (4, 4), metres (round: their box)."""
    return float(_solid_points(solid, world_from_body)[:, 2].min())


def _solid_points(solid: Solid, world_from_body: FloatArray) -> FloatArray:
    local = solid.hull if isinstance(solid, Scan) else box_corners(solid.size)
    return transform_points(world_from_body @ solid.body_from_shape, local)


def extent(solids: tuple[Solid, ...]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest corner (3,) of solids together, in their body's frame, metres."""
    corners = np.concatenate([transform_points(s.body_from_shape, box_corners(s.size)) for s in solids])
    return corners.min(axis=0), corners.max(axis=0)


def body_points(body: Body, world_from_body: FloatArray) -> FloatArray:
    """(N, 3) world points whose convex hull holds the body at its pose (4, 4); round solids by their boxes."""
    return np.concatenate([_solid_points(solid, world_from_body) for solid in body.solids])


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
