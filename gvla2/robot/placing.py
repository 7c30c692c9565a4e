"""Placing objects: rejection sampling inside a site, and the geometry of success checks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import DISTINCT, colour_distance
from gvla2.robot.task import TaskSite

TRIES = 5000

T = TypeVar("T")
Rgb = tuple[float, float, float]


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
