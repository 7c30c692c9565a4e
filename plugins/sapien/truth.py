"""The true scene and masks of the simulated world: for the ``oracle`` perceiver and measurements."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.camera import Camera
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.raycast import RayCaster, RayImage, Surface
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.colours import nearest_colours
from gvla2.planning.scene import Box, KnownShape, Scene, SceneObject, Shape
from gvla2.robot.looks import body_surface
from gvla2.robot.scan import Scan
from gvla2.robot.solids import extent
from gvla2.robot.task import Body, Layout, Solid
from gvla2_plugins.sapien.convex import pieces
from gvla2_plugins.sapien.world import SapienWorld

BELOW_TOP = 0.2
"""Where the walls are checked: this share of the height below the top."""

DIRECTIONS, STEPS = 24, 400


def opening(solids: tuple[Solid, ...], low: FloatArray, high: FloatArray) -> float:
    """The narrowest inner width of a body about its middle, near its top, metres; 0 if it is closed.

    ``low`` and ``high`` (3,) bound the body in its own frame. It is open when its middle is empty there and walls
    surround it.
    """
    middle = 0.5 * (low + high)
    height = high[2] - BELOW_TOP * (high[2] - low[2])
    turns = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    reach = 0.5 * float(np.hypot(*(high - low)[:2])) * np.arange(STEPS + 1) / STEPS
    xy = np.stack([np.cos(turns), np.sin(turns)], axis=1)[:, None] * reach[None, :, None]  # (D, S, 2)
    points = np.concatenate([middle[:2] + xy, np.full((*xy.shape[:2], 1), height)], axis=2)
    solid = _within(solids, points.reshape(-1, 3)).reshape(xy.shape[:2])
    if solid[:, 0].any() or not solid.any(axis=1).all():
        return 0.0
    free = reach[solid.argmax(axis=1)]
    half = DIRECTIONS // 2
    return float((free[:half] + free[half:]).min())


def _within(solids: tuple[Solid, ...], points: FloatArray) -> np.ndarray:
    """(N,) bool: points (N, 3) inside any of the solids."""
    inside = np.zeros(len(points), dtype=bool)
    for solid in solids:
        local = transform_points(invert_rigid(solid.body_from_shape), points)
        if isinstance(solid, Scan):
            inside |= np.any([piece.holds(local) for piece in pieces(solid)], axis=0)
            continue
        x, y, z = np.abs(local).T
        a, b, c = 0.5 * np.asarray(solid.size)
        if solid.kind == "box":
            inside |= (x <= a) & (y <= b) & (z <= c)
        elif solid.kind == "cylinder":
            inside |= (np.hypot(x, y) <= a) & (z <= c)
        else:
            inside |= x**2 + y**2 + z**2 <= a**2
    return inside


def cast_masks(
    cameras: Sequence[Camera],
    robot: Sequence[RayImage],
    bodies: Sequence[Body],
    world_from_body: Mapping[str, FloatArray],
    scenery: Body,
) -> tuple[tuple[str, ...], list[NDArray[np.int32]]]:
    """The names of bodies and their named parts, and one image (H, W) per camera of indices into the names.

    -1 is where none of them is seen: the robot (``robot``, its own images by the same cameras) and ``scenery`` hide
    what is behind them. Poses (4, 4) go by the bodies' names; a part is called ``body/label``, as in
    :func:`true_scene`, and its pixels are not the body's.
    """
    names: list[str] = []
    surfaces: list[Surface] = []
    poses: dict[int, FloatArray] = {}
    for body in bodies:
        for piece, solids in _pieces(body):
            poses[len(surfaces)] = world_from_body[body.name]
            names.append(piece)
            surfaces.append(replace(body_surface(replace(body, solids=solids)), id=len(surfaces)))
    poses[len(surfaces)] = scenery.world_from_body
    surfaces.append(replace(body_surface(scenery), id=len(surfaces)))
    images = []
    for arm, objects in zip(robot, RayCaster(surfaces).cast(cameras, poses), strict=True):
        nearer = np.isfinite(arm.depth) & ~(objects.depth < arm.depth)
        images.append(np.where(nearer | (objects.ids == len(names)), -1, objects.ids).astype(np.int32))
    return tuple(names), images


def _pieces(body: Body) -> list[tuple[str, tuple[Solid, ...]]]:
    """The body's solids that belong to no part, then those of each part; a solid belongs to the first that names it."""
    left = dict(enumerate(body.solids))
    parts = [
        (f"{body.name}/{label}", tuple(left.pop(i) for i in numbers if i in left))
        for label, numbers in body.parts
    ]
    return [(piece, solids) for piece, solids in [(body.name, tuple(left.values())), *parts] if solids]


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


def upright_box(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The pose (4, 4) and sides (3,) of the box about points (N, 3), z up, of the least area seen from above."""
    turns = np.deg2rad(np.arange(0.0, 90.0, 2.0))
    ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)  # (T, 2)
    across = np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    x, y = points[:, :2] @ ways.T, points[:, :2] @ across.T  # (N, T)
    best = int(np.argmin(np.ptp(x, axis=0) * np.ptp(y, axis=0)))
    low = np.array([x[:, best].min(), y[:, best].min(), points[:, 2].min()])
    high = np.array([x[:, best].max(), y[:, best].max(), points[:, 2].max()])
    turn = np.eye(3)
    turn[:2, 0], turn[:2, 1] = ways[best], across[best]
    return rigid(turn, turn @ (0.5 * (low + high))), high - low


def _object(body: Body, pose: FloatArray, parent: str) -> SceneObject:
    """The body as an object; one that is a mesh in the slimmest upright box about it, known by its file."""
    low, high = extent(body.solids)
    size, known = high - low, None
    world_from_box = pose @ rigid(translation=0.5 * (low + high))
    shape, rgb = _shape(body, size), np.array(_main_colour(body))
    scan = body.solids[0]
    if len(body.solids) == 1 and isinstance(scan, Scan):
        world_from_scan = pose @ scan.body_from_shape
        world_from_box, size = upright_box(transform_points(world_from_scan, scan.hull))
        placed = world_from_scan @ rigid(translation=-scan.offset)
        known = KnownShape(body.name, scan.path, placed, scan.scale)
    colour = nearest_colours(rgb, 1)[0][0]
    surface = body_surface(body)
    points, _ = TriangleMesh(surface.vertices, surface.faces).sample(POINTS, np.random.default_rng(0))
    return SceneObject(
        body.name,
        body.label or f"{colour} {shape}",
        shape,
        colour,
        world_from_box,
        size,
        transform_points(pose, points),
        rgb,
        parent,
        opening=opening(body.solids, low, high) if pose[2, 2] > 0.9 else 0.0,
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
