"""The arm rendered at its measured joints: masks for the cameras' pictures, and previews."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import FloatArray, look_along, rigid, transform_points
from gvla2.geometry.views import View
from gvla2.planning.scene import Scene
from gvla2.robot.task import Primitive
from gvla2_plugins.piper.arm import piper_description

EXPLAINED = 0.025
"""A depth this near (m) to the modelled arm's, or behind it, is the arm: the solids are a little too large."""

_TABLE_RGB = (0.76, 0.61, 0.43)


class ArmLooks:
    """The arm's links as triangles; ``world_from_base`` (4, 4) places them."""

    def __init__(self, world_from_base: FloatArray, tcp_offset: float) -> None:
        self._base, self._arm = world_from_base, piper_description(tcp_offset)
        solids = [(link, solid) for link, parts in self._arm.solids.items() for solid in parts]
        self._links = [link for link, _ in solids]
        self.surfaces = [_surface(solid, index) for index, (_, solid) in enumerate(solids)]
        self._caster = RayCaster(self.surfaces)

    def poses(self, joints: FloatArray, width: float) -> dict[int, FloatArray]:
        """world_from_surface (4, 4) by index at joints (6,) and an opening in metres."""
        links = self._arm.link_poses(joints, width)
        return {i: self._base @ links[link] for i, link in enumerate(self._links)}

    def mask(self, views: Sequence[View], joints: FloatArray, width: float) -> tuple[View, ...]:
        """The views with the arm's pixels marked."""
        images = self._caster.cast([view.camera for view in views], self.poses(joints, width))
        masked = []
        for view, image in zip(views, images, strict=True):
            known = np.isfinite(image.depth)
            if view.depth is not None:
                with np.errstate(invalid="ignore"):
                    known &= ~(view.depth < image.depth - EXPLAINED)
            masked.append(replace(view, robot_mask=known))
        return tuple(masked)


class Preview:
    """Pictures of the arm, the table and the perceived objects, from the side."""

    def __init__(self, looks: ArmLooks, world_from_base: FloatArray, scene: Scene, size: int) -> None:
        self._looks, count = looks, len(looks.surfaces)
        table = trimesh.creation.box(extents=(1.2, 1.2, 0.02))
        top = world_from_base @ rigid(translation=(0.3, 0.0, 0.0))
        top[2, 3] = scene.table_height - 0.01
        wood = Surface(np.asarray(table.vertices), np.asarray(table.faces), np.array(_TABLE_RGB), count)
        self._things = [(wood, top)]
        for thing in scene.objects:
            extents = np.maximum(thing.extents, 1e-3)
            box = trimesh.creation.box(extents=extents)
            surface = Surface(
                np.asarray(box.vertices), np.asarray(box.faces), np.clip(thing.rgb, 0.0, 1.0), count + 1
            )
            self._things.append((surface, thing.world_from_object))
        self._caster = RayCaster([*looks.surfaces, *(surface for surface, _ in self._things)])
        eye = transform_points(world_from_base, [0.85, -0.75, 0.60])
        at = transform_points(world_from_base, [0.22, 0.0, 0.12])
        self._camera = Camera.from_fov(0.75, look_along(eye, at - eye), size, size, "preview")

    def picture(self, joints: FloatArray, width: float) -> NDArray[np.uint8]:
        """(size, size, 3) RGB at joints (6,) and an opening in metres."""
        poses = self._looks.poses(joints, width)
        poses |= {len(self._looks.surfaces) + i: pose for i, (_, pose) in enumerate(self._things)}
        return self._caster.cast([self._camera], poses)[0].image


def _surface(solid: Primitive, index: int) -> Surface:
    if solid.kind == "box":
        mesh = trimesh.creation.box(extents=solid.size)
    else:
        mesh = trimesh.creation.cylinder(0.5 * solid.size[0], height=solid.size[2], sections=24)
    vertices = transform_points(solid.body_from_shape, mesh.vertices)
    return Surface(vertices, np.asarray(mesh.faces, dtype=np.int64), np.array(solid.rgb), index)
