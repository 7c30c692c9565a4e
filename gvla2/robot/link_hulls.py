"""The solids of a URDF's links, meshes and boxes merged into one convex hull per link."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, box_corners
from gvla2.robot.kinematics import Kinematics
from gvla2.robot.libraries import library


def link_geometry(kinematics: Kinematics, urdf: Path, package_dirs: Sequence[Path]) -> Any:
    """A pinocchio ``GeometryModel`` in the world: solids are named by their link, and names may repeat.

    Round primitives (spheres, cylinders, capsules) are kept: exact, and faster than a hull. Raises :class:`RobotError`
    when a mesh can't be read.
    """
    pin, folders = library("pinocchio"), [str(folder) for folder in package_dirs]
    try:
        source = pin.buildGeomFromUrdf(
            kinematics.model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders
        )
    except ValueError as error:
        raise RobotError(f"The collision meshes of {urdf.name} can't be read: {error}") from error
    merged = pin.GeometryModel()

    def add(frame: int, placement: Any, shape: Any) -> None:
        link = kinematics.model.frames[frame]
        merged.addGeometryObject(pin.GeometryObject(link.name, link.parentJoint, frame, placement, shape))

    corners: dict[int, list[FloatArray]] = defaultdict(list)
    for solid in source.geometryObjects:
        points = _corners(solid.geometry)
        if points is None:
            add(solid.parentFrame, solid.placement, solid.geometry)
        else:
            pose = solid.placement
            corners[solid.parentFrame].append(points @ pose.rotation.T + pose.translation)
    for frame, parts in corners.items():
        add(frame, pin.SE3.Identity(), _hull(np.concatenate(parts)))
    return merged


def _corners(shape: Any) -> FloatArray | None:
    """Points (N, 3) whose hull contains a mesh or box; None for round primitives."""
    coal = library("coal")
    if isinstance(shape, coal.BVHModelBase):
        return np.array(shape.vertices(), dtype=np.float64).reshape(-1, 3)
    if isinstance(shape, coal.Box):
        return box_corners(2.0 * shape.halfSide)
    return None


def _hull(points: FloatArray) -> Any:
    coal = library("coal")
    vertices = coal.StdVec_Vec3s()
    for point in points:
        vertices.append(point)
    return coal.Convex.convexHull(vertices, True, "Qt")
