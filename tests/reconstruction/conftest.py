"""Shapes seen by calibrated cameras: views with true masks, made in the test."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along
from gvla2.geometry.views import View, Views

MakeViews = Callable[..., Views]


def cameras_around(
    count: int, size: int, seed: int, extent: float = 1.0, target: tuple[float, float, float] = (0, 0, 0)
) -> list[Camera]:
    """Cameras of the GSO-30 protocol: over the sphere at 1.5 to 2.2 times the object's extent."""
    rng = np.random.default_rng(seed)
    focal = 1.09375 * size
    K = np.array([[focal, 0, size / 2], [0, focal, size / 2], [0, 0, 1]])
    cameras = []
    for number in range(count):
        direction = rng.normal(size=3)
        position = np.array(target) + direction / np.linalg.norm(direction) * rng.uniform(1.5, 2.2) * extent
        pose = look_along(position, np.array(target) - position)
        cameras.append(Camera(K, pose, size, size, f"view{number}"))
    return cameras


def views_of(mesh: trimesh.Trimesh, count=5, size=128, seed=0, extent=1.0, target=(0, 0, 0)) -> Views:
    """Images, depth and true masks of a mesh."""
    caster = RayCaster([Surface(mesh.vertices, mesh.faces, np.array([0.7, 0.4, 0.2]), 0)])
    cameras = cameras_around(count, size, seed, extent, target)
    return Views(
        tuple(
            View(camera, shot.image, shot.depth, (shot.ids >= 0).astype(np.float32))
            for camera, shot in zip(cameras, caster.cast(cameras, {}), strict=True)
        )
    )


def make_jug() -> trimesh.Trimesh:
    """A body with a handle on one side, longest side 1, centred: no symmetry that hides an axis, and a hole."""
    body = trimesh.creation.cylinder(radius=0.28, height=0.9, sections=48)
    handle = trimesh.creation.torus(major_radius=0.22, minor_radius=0.05)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0], [0, 0, 0]))
    handle.apply_translation([0.33, 0, 0.05])
    mesh = trimesh.util.concatenate([body, handle])
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    mesh.apply_scale(1 / mesh.extents.max())
    return mesh


@pytest.fixture(scope="session")
def masked_views() -> MakeViews:
    return views_of


@pytest.fixture(scope="session")
def jug() -> trimesh.Trimesh:
    return make_jug()
