"""A run in three dimensions as one glTF file: the cloud, the perceived objects, the planned path and the findings of
the checks.

Lengths are metres, the frame is glTF's (Y-up, see :func:`gvla2.geometry.mesh_files.to_y_up`). A node's ``extras`` hold
its ``kind`` ("seen", "ground", "object", "path" or "waypoint") and, if it has a name, ``label``, ``text`` and their
position ``at`` (3,). Any viewer of glTF opens the file; the run's page has its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from gvla2.episode.record import EpisodeRecord
from gvla2.errors import GeometryError
from gvla2.geometry.mesh_files import to_y_up
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint

OPEN, CLOSED, FAILED = (28, 142, 210), (224, 122, 16), (189, 45, 38)
"""Colours of the path by the gripper, and of a waypoint that a check rejects."""

MOST_POINTS = 14_000
MOST_FACES = 6_000
"""Most points of the cloud, and faces of one known mesh, before a page gets slow and large."""

_GRAIN = 0.006  # metres; one point of the cloud per cube of this side
_TUBE, _DOT = 0.0022, 0.008  # metres, radii of the path and of a waypoint
_RIM = 0.1  # metres around the workspace where the cloud is shown too: the arm reaches in from there


def scene_glb(record: EpisodeRecord) -> bytes:
    """The file as bytes; b"" before anything was perceived."""
    scene = record.scene
    if scene is None:
        return b""
    model = trimesh.Scene()
    _add(model, _ground(scene), "ground", "ground")
    if record.observation is not None:
        points, colours = cloud(record.observation, scene.workspace)
        if len(points):
            _add(model, trimesh.PointCloud(points, colors=colours), "seen", "seen")
    for k, obj in enumerate(scene.objects):
        solid = solid_of(obj)
        solid.visual.face_colors = np.uint8(255 * np.clip(np.nan_to_num(obj.rgb), 0, 1))
        at = np.append(obj.centre[:2], solid.bounds[1, 2])
        name = obj.label or obj.id
        text = f"{name}: {obj.shape}, {' × '.join(f'{1000 * e:.0f}' for e in obj.extents)} mm"
        _add(model, solid, obj.id, "object", label=f"{k + 1} {name}", at=at, text=text)
    if record.plan is not None and record.plan.trajectory is not None:
        _add_path(model, record, record.plan.trajectory, scene.table_height)
    for geometry in model.geometry.values():
        geometry.apply_transform(rigid(to_y_up(np.eye(3)).T))
    content: bytes = model.export(file_type="glb", tree_postprocessor=_matte)
    return content


def _matte(document: dict[str, Any]) -> None:
    """Give a glTF document a dull material: without one it counts as bare metal, nearly black in most viewers."""
    document["materials"] = [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}]
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            primitive["material"] = 0


def cloud(
    observation: Observation, workspace: Box, most: int = MOST_POINTS
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """(N, 3) world points that the cameras measured in and near the workspace, and their colours (N, 3).

    One point per cube of 6 mm, and of those at most ``most``, evenly spread.
    """
    points, colours = [np.zeros((0, 3))], [np.zeros((0, 3), np.uint8)]
    for view in observation.views:
        if view.depth is None:
            continue
        found = view.points().reshape(-1, 3)
        near = workspace.contains(found, margin=-_RIM)  # NaN is nowhere
        points.append(found[near])
        colours.append(view.image.reshape(-1, 3)[near])
    placed, painted = np.concatenate(points), np.concatenate(colours)
    cells = np.floor((placed - workspace.low) / _GRAIN).astype(np.int64) + 1024
    _, chosen = np.unique(cells @ [1 << 32, 1 << 16, 1], return_index=True)
    if len(chosen) > most:
        chosen = chosen[np.linspace(0, len(chosen) - 1, most).astype(np.int64)]
    return placed[chosen], painted[chosen]


def solid_of(obj: SceneObject) -> Any:
    """The object's body in the world as a :class:`trimesh.Trimesh`: the scan it was recognised as, else its shape."""
    if obj.known is not None:
        try:
            mesh = obj.known.mesh()
        except GeometryError:  # the scan's file is missing: its box is still known
            mesh = None
        if mesh is not None and 0 < len(mesh.faces) <= MOST_FACES:
            return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    match obj.shape:
        case "cylinder" | "disc":
            solid = trimesh.creation.cylinder(0.5, 1.0, sections=32)
        case "sphere":
            solid = trimesh.creation.icosphere(2, 0.5)
        case "ring":
            outer = max(float(obj.extents[:2].mean()), 1e-6)
            inner = float(np.clip(obj.opening / outer, 0.1, 0.95))
            solid = trimesh.creation.annulus(0.5 * inner, 0.5, 1.0, sections=32)
        case _:
            solid = trimesh.creation.box((1.0, 1.0, 1.0))
    world = transform_points(obj.world_from_object, solid.vertices * obj.extents)
    return trimesh.Trimesh(world, solid.faces, process=False)


def _add_path(model: Any, record: EpisodeRecord, trajectory: Trajectory, table: float) -> None:
    """The legs as tubes, a ball for each waypoint, and plumb lines to the table."""
    start = None if record.observation is None else record.observation.world_from_tcp[:3, 3]
    stops = trajectory.xyzg().reshape(-1, 4)[:, :3]
    tubes = []
    for before, stop, opening in zip(
        [start, *stops], stops, [1.0, *(w.gripper for w in trajectory)], strict=False
    ):
        if before is not None and np.linalg.norm(stop - before) > 1e-6:
            tubes.append(trimesh.creation.cylinder(_TUBE, segment=[before, stop], sections=6))
            tubes[-1].visual.face_colors = OPEN if opening > 0.5 else CLOSED
    if tubes:
        _add(model, trimesh.util.concatenate(tubes), "path", "path")
    plumbs = [[stop, [*stop[:2], table]] for stop in stops]
    if plumbs:
        _add(model, trimesh.load_path(np.array(plumbs)), "plumb lines", "path")
    for k, waypoint in enumerate(trajectory):
        text, bad = waypoint_text(k, waypoint, record.checks)
        ball = trimesh.creation.icosphere(1, _DOT)
        ball.apply_translation(stops[k])
        ball.visual.face_colors = FAILED if bad else OPEN if waypoint.gripper > 0.5 else CLOSED
        more = {"label": str(k), "at": stops[k], "text": text, "bad": bad}
        _add(model, ball, f"waypoint {k}", "waypoint", **more)


def waypoint_text(k: int, waypoint: Waypoint, checks: CheckReport | None) -> tuple[str, bool]:
    """A waypoint in words with the checks' findings there, and whether any failed."""
    place = ", ".join(f"{v:.3f}" for v in waypoint.xyz)
    grip = "open" if waypoint.gripper > 0.5 else "closed"
    words = f"{k} {waypoint.stage.replace('_', ' ')}: {place} m, gripper {grip}, {waypoint.motion}"
    if checks is None:
        return f"{words}; not checked", False
    failed = [f.message or f.kind for f in checks.findings if not f.passed and f.index == k]
    return f"{words}; {' '.join(failed) or 'all checks passed'}", bool(failed)


def _ground(scene: Scene) -> Any:
    """A grid of 10 cm on the table, over the workspace."""
    (x0, y0), (x1, y1) = scene.workspace.low[:2], scene.workspace.high[:2]
    xs, ys = (np.arange(np.ceil(10 * a), np.floor(10 * b) + 1) / 10 for a, b in ((x0, x1), (y0, y1)))
    z = scene.table_height
    lines = [[(x, y0, z), (x, y1, z)] for x in xs] + [[(x0, y, z), (x1, y, z)] for y in ys]
    return trimesh.load_path(np.array(lines))


def _add(model: Any, geometry: Any, name: str, kind: str, **extras: Any) -> None:
    if "at" in extras:
        extras["at"] = [round(float(v), 4) for v in to_y_up(extras["at"])]
    model.add_geometry(geometry, node_name=name, geom_name=name, metadata={"kind": kind, **extras})
