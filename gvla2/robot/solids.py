"""What tasks are laid out of: hollow objects made of solid pieces, regions for success checks, places for objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, box_corners, invert_rigid, rigid, transform_points
from gvla2.planning.colours import DISTINCT, colour_distance
from gvla2.robot.collision import coal_shape
from gvla2.robot.kinematics import library
from gvla2.robot.scan import Scan
from gvla2.robot.task import Body, Primitive, Solid, TaskSite


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


TRIES = 5000

T = TypeVar("T")


def sample_until(draw: Callable[[], T | None], what: str, tries: int = TRIES) -> T:
    """The first draw that is not None; raises :class:`ConfigurationError` after many tries."""
    for _ in range(tries):
        sample = draw()
        if sample is not None:
            return sample
    raise ConfigurationError(
        f"No place was found for {what} in {tries} tries: it does not fit on the table within the arm's reach. "
        "Make it smaller, or the distances shorter."
    )


def sample_root(rng: np.random.Generator, site: TaskSite, yaw: float = np.pi) -> FloatArray:
    """world_from_root (4, 4): uniform in the site's rectangle on the table, turned by up to ``yaw`` either way."""
    half = 0.5 * np.asarray(site.size)
    xy = np.asarray(site.centre) + rng.uniform(-half, half)
    return planar(xy, site.table_height, float(rng.uniform(-yaw, yaw)))


def at(root: FloatArray, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> FloatArray:
    """world_from_object (4, 4) of an object at (x, y, z) in a root's frame (4, 4), turned by ``yaw`` about z."""
    return root @ planar((x, y), z, yaw)


def planar(xy: Sequence[float] | FloatArray, z: float, yaw: float) -> FloatArray:
    """(4, 4) pose upright at ``xy`` (2,) and ``z``, turned by ``yaw`` about z; metres and radians."""
    return rigid(Rotation.from_euler("z", yaw).as_matrix(), (xy[0], xy[1], z))


def clear(spots: FloatArray, radii: Sequence[float], gap: float = 0.02) -> bool:
    """Whether discs about ``spots`` (N, 2) are ``gap`` apart from one another, metres."""
    i, j = np.triu_indices(len(spots), 1)
    sizes = np.asarray(radii)
    return bool((np.linalg.norm(spots[i] - spots[j], axis=1) >= sizes[i] + sizes[j] + gap).all())


def distinct(rgb: Rgb, others: Sequence[Rgb]) -> bool:
    """Whether a colour is unlike all the others; each in [0, 1]."""
    return not others or bool((colour_distance(np.array(others), rgb) >= DISTINCT).all())
