"""The solids of a URDF's links, meshes and boxes merged into one convex hull per link."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, box_corners
from gvla2.robot.kinematics import Kinematics


def link_geometry(kinematics: Kinematics, urdf: Path, package_dirs: list[str], pin: Any, coal: Any) -> Any:
    """A pinocchio ``GeometryModel`` in the world: solids are named by their link, and names may repeat.

    Round primitives (spheres, cylinders, capsules) are kept: exact, and faster than a hull. Raises :class:`RobotError`
    when a mesh can't be read.
    """
    try:
        source = pin.buildGeomFromUrdf(
            kinematics.model, str(urdf), pin.GeometryType.COLLISION, package_dirs=package_dirs
        )
    except ValueError as error:
        raise RobotError(f"The collision meshes of {urdf.name} can't be read: {error}") from error
    merged = pin.GeometryModel()
    corners: dict[int, list[FloatArray]] = defaultdict(list)
    for solid in source.geometryObjects:
        points = _corners(solid.geometry, coal)
        if points is None:
            _add(pin, kinematics, merged, solid.parentFrame, solid.placement, solid.geometry)
        else:
            pose = solid.placement
            corners[solid.parentFrame].append(points @ pose.rotation.T + pose.translation)
    for frame, parts in corners.items():
        hull = _hull(coal, np.concatenate(parts))
        _add(pin, kinematics, merged, frame, pin.SE3.Identity(), hull)
    return merged


def _add(pin: Any, kinematics: Kinematics, merged: Any, frame: int, placement: Any, shape: Any) -> None:
    link = kinematics.model.frames[frame]
    merged.addGeometryObject(pin.GeometryObject(link.name, link.parentJoint, frame, placement, shape))


def _corners(shape: Any, coal: Any) -> FloatArray | None:
    """Points (N, 3) whose hull contains a mesh or box; None for round primitives."""
    if isinstance(shape, coal.BVHModelBase):
        return np.array(shape.vertices(), dtype=np.float64).reshape(-1, 3)
    if isinstance(shape, coal.Box):
        return box_corners(2.0 * shape.halfSide)
    return None


def _hull(coal: Any, points: FloatArray) -> Any:
    vertices = coal.StdVec_Vec3s()
    for point in points:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, True, "Qt")
