"""What rerun shows of a scene: the points that the cameras measured, the objects' bodies, and waypoints in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from gvla2.errors import GeometryError
from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.views import Observation
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Box, SceneObject
from gvla2.planning.trajectory import Waypoint

OPEN, CLOSED, FAILED = (28, 142, 210), (224, 122, 16), (189, 45, 38)
"""Colours of the path by the gripper, and of a waypoint that a check rejects."""

MOST_FACES = 6_000
"""A known mesh with more faces is shown as its shape."""

_GRAIN = 0.006  # metres; one point of the cloud per cube of this side
_RIM = 0.1  # metres around the workspace where points are shown too: the arm reaches in from there


def cloud(observation: Observation, workspace: Box, most: int) -> tuple[FloatArray, NDArray[np.uint8]]:
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


def waypoint_text(k: int, waypoint: Waypoint, checks: CheckReport | None) -> tuple[str, bool]:
    """A waypoint in words with the checks' findings there, and whether any failed."""
    place = ", ".join(f"{v:.3f}" for v in waypoint.xyz)
    grip = "open" if waypoint.gripper > 0.5 else "closed"
    words = f"{k} {waypoint.stage.replace('_', ' ')}: {place} m, gripper {grip}, {waypoint.motion}"
    if checks is None:
        return f"{words}; not checked", False
    failed = [f.message or f.kind for f in checks.findings if not f.passed and f.index == k]
    return f"{words}; {' '.join(failed) or 'no check speaks against it'}", bool(failed)
