"""The true scene of the simulated world: for the ``oracle`` perceiver."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import get_args

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.perception.objects import footprint, opening_of
from gvla2.planning.colours import nearest_colours
from gvla2.planning.scene import Box, KnownShape, Scene, SceneObject, Shape
from gvla2.robot.looks import body_surface
from gvla2.robot.scan import Scan
from gvla2.robot.solids import extent
from gvla2.robot.task import Body, Layout
from gvla2_plugins.sapien.world import SapienWorld

POINTS = 1500
"""Points of an object's surface."""

THIN = 0.25
"""A solid is a disc or a plate when its height is below this share of its breadth."""

_PAINT = 0.002


def true_scene(world: SapienWorld, layout: Layout, table_height: float, workspace: Box) -> Scene:
    """Every body as an object whose id is the body's name, and its named parts; parts name their parent."""
    above = {joint.child: joint.parent for joint in layout.joints}
    above |= {thread.child: thread.parent for thread in layout.threads}
    objects: list[SceneObject] = []
    for body in layout.lit(world.peaks):
        pose = world.pose(body.name)
        parts = [_part(body, label, numbers) for label, numbers in body.parts]
        objects.append(_object(_without_protrusions(body), pose, above.get(body.name, "")))
        objects += [_object(part, pose, body.name) for part in parts]
    return Scene(tuple(objects), table_height, workspace, "oracle")


def _part(body: Body, label: str, numbers: tuple[int, ...]) -> Body:
    """Some solids of a body as a separate body, named after both."""
    solids = tuple(body.solids[i] for i in numbers)
    return replace(body, name=f"{body.name}/{label}", solids=solids, label=label, shape="", parts=())


def _without_protrusions(body: Body) -> Body:
    """The body without the parts beside it: a drawer's box ends where its handle begins."""
    aside: set[int] = set()
    for _, numbers in body.parts:
        rest = tuple(solid for i, solid in enumerate(body.solids) if i not in numbers)
        low, high = extent(rest)
        middle = 0.5 * np.sum(extent(tuple(body.solids[i] for i in numbers)), axis=0)
        if ((middle < low) | (middle > high))[:2].any():
            aside |= set(numbers)
    return replace(body, solids=tuple(solid for i, solid in enumerate(body.solids) if i not in aside))


def _object(body: Body, pose: FloatArray, parent: str) -> SceneObject:
    """The body as an object; one that is a mesh in the smallest upright box about it, known by its file."""
    low, high = extent(body.solids)
    size, known = high - low, None
    world_from_box = pose @ rigid(translation=0.5 * (low + high))
    shape, rgb = _shape(body, size), np.array(_main_colour(body))
    scan = body.solids[0]
    if len(body.solids) == 1 and isinstance(scan, Scan):
        world_from_scan = pose @ scan.body_from_shape
        corners = transform_points(world_from_scan, scan.hull)
        yaw, low, high = footprint(corners[:, :2])
        low, high = np.append(low, corners[:, 2].min()), np.append(high, corners[:, 2].max())
        turn = Rotation.from_euler("z", yaw).as_matrix()
        world_from_box, size = rigid(turn, turn @ (0.5 * (low + high))), high - low
        placed = world_from_scan @ rigid(translation=-scan.offset)
        known = KnownShape(body.name, scan.path, placed, scan.scale)
    colour = nearest_colours(rgb, 1)[0][0]
    surface = body_surface(body)
    points, _ = TriangleMesh(surface.vertices, surface.faces).sample(POINTS, np.random.default_rng(0))
    points = transform_points(pose, points)
    hole = np.linalg.norm(points[:, :2] - world_from_box[:2, 3], axis=1).min()
    return SceneObject(
        body.name,
        body.label or f"{colour} {shape}",
        shape,
        colour,
        world_from_box,
        size,
        points,
        rgb,
        parent,
        opening=2 * float(hole) if shape == "ring" else opening_of(points),
        known=known,
    )


def _main_colour(body: Body) -> tuple[float, float, float]:
    """The colour of most of the body's volume."""
    volume: dict[tuple[float, float, float], float] = defaultdict(float)
    for solid in body.solids:
        volume[solid.rgb] += float(np.prod(solid.size))
    return max(volume, key=lambda rgb: volume[rgb])


def _shape(body: Body, size: FloatArray) -> Shape:
    if body.shape in get_args(Shape):
        return body.shape  # type: ignore[return-value]
    if size[2] <= _PAINT and not any(solid.collides for solid in body.solids):
        return "region"
    if len(body.solids) > 1:
        return "other"
    kind, flat = body.solids[0].kind, size[2] < THIN * min(size[:2])
    if kind == "cylinder":
        return "disc" if flat else "cylinder"
    if kind == "sphere":
        return "sphere"
    return "plate" if flat else "box"
