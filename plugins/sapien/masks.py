"""Ground-truth masks: only for measuring perceivers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, RayImage, Surface
from gvla2.geometry.transform import FloatArray
from gvla2.robot.looks import body_surface
from gvla2.robot.task import Body, Solid


def cast_masks(
    cameras: Sequence[Camera],
    robot: Sequence[RayImage],
    bodies: Mapping[str, Body],
    world_from_body: Mapping[str, FloatArray],
    scenery: Body,
) -> tuple[tuple[str, ...], list[NDArray[np.int32]]]:
    """The names of bodies and their named parts, and one image (H, W) a camera of indices into the names.

    -1 is where none of them is seen: the robot (``robot``, its own images by the same cameras) and ``scenery`` hide
    what is behind them. ``bodies`` and their poses (4, 4) go by name; a part is called ``body/label``, as in
    :func:`~gvla2_plugins.sapien.truth.true_scene`, and its pixels are not the body's.
    """
    names: list[str] = []
    surfaces: list[Surface] = []
    poses: dict[int, FloatArray] = {}
    for name, body in bodies.items():
        for piece, solids in _pieces(name, body):
            poses[len(surfaces)] = world_from_body[name]
            names.append(piece)
            surfaces.append(replace(body_surface(replace(body, solids=solids)), id=len(surfaces)))
    poses[len(surfaces)] = scenery.world_from_body
    surfaces.append(replace(body_surface(scenery), id=len(surfaces)))
    images = []
    for arm, things in zip(robot, RayCaster(surfaces).cast(cameras, poses), strict=True):
        nearer = np.isfinite(arm.depth) & ~(things.depth < arm.depth)
        images.append(np.where(nearer | (things.ids == len(names)), -1, things.ids).astype(np.int32))
    return tuple(names), images


def _pieces(name: str, body: Body) -> list[tuple[str, tuple[Solid, ...]]]:
    """The body's solids that belong to no part, then those of each part; a solid belongs to the first that names it."""
    left = dict(enumerate(body.solids))
    parts = [
        (f"{name}/{label}", tuple(left.pop(i) for i in numbers if i in left)) for label, numbers in body.parts
    ]
    return [(piece, solids) for piece, solids in [(name, tuple(left.values())), *parts] if solids]
