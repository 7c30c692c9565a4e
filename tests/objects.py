"""Objects on a table, scenes of them, and waypoints with the reports of an arm that reached each."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import Waypoint
from gvla2.robot.report import ExecutionReport, WaypointReport

TABLE = 0.75
RGB = {"red": (0.8, 0.1, 0.1), "blue": (0.1, 0.1, 0.8), "green": (0.1, 0.7, 0.2), "gray": (0.5, 0.5, 0.5),
       "white": (0.9, 0.9, 0.9)}  # fmt: skip


def scene_object(
    id_: str, xyz: Sequence[float], size: Sequence[float] = (0.05, 0.05, 0.05), colour: str = "red",
    shape: Any = "box", *, turn: Any = None, parent: str = "", points: Any = None, **more: Any,
) -> SceneObject:  # fmt: skip
    """``xyz`` is the middle, its height above the table."""
    pose = rigid(turn, (xyz[0], xyz[1], TABLE + xyz[2]))
    seen = np.zeros((0, 3)) if points is None else np.asarray(points)
    return SceneObject(id_, f"{colour} {shape}", shape, colour, pose, np.asarray(size, dtype=float), seen,
                       np.array(RGB[colour]), parent, **more)  # fmt: skip


def box(angle: float) -> tuple[SceneObject, SceneObject]:
    """A box whose lid, hinged at +x, is open by ``angle``, and shows its inside from 0.2 radians on."""
    turn = Rotation.from_euler("y", angle).as_matrix()
    middle = np.array([0.425, 0.0, 0.155]) - 0.134 * turn[:, 0]
    lid = scene_object("l", middle, (0.268, 0.35, 0.01), "blue", "plate", turn=turn, parent="b")
    return scene_object("b", (0.3, 0, 0.075), (0.25, 0.35, 0.15), opening=0.23 * (angle > 0.2)), lid


def scene(*objects: SceneObject) -> Scene:
    return Scene(objects, TABLE, Box(np.array([-1, -1, TABLE]), np.array([1, 1, 2.0])))


def renamed(given: Scene) -> Scene:
    """Other ids in another order, as a second perception gives."""
    return scene(*(replace(o, id=f"new{i}", parent="") for i, o in enumerate(reversed(given.objects))))


def move(stage: str, xyz: Sequence[float], gripper: float = 1.0, carries: str = "", **more: Any) -> Waypoint:
    """A waypoint whose height is above the table."""
    x, y, z = (float(v) for v in xyz)
    return Waypoint((x, y, TABLE + z), gripper, stage, carries=carries, **more)


def reported(
    waypoints: Sequence[Waypoint], changes: dict[int, dict[str, Any]] | None = None,
    *, width: float = 0.05, held: bool | None = None, opened: float | None = None,
) -> ExecutionReport:  # fmt: skip
    """Every waypoint reached to the millimetre, up to the first abort among the ``changes`` by waypoint.

    ``width`` and ``held`` are the hand's measurements; an open hand measures ``opened`` metres, where that is given.
    """
    reports: list[WaypointReport] = []
    for i, w in enumerate(waypoints):
        shut = opened is None or w.gripper < 0.5
        measured = (width, held) if shut else (opened, False)
        report = WaypointReport(i, w.stage, w.xyz, w.xyz, 0.001, *measured)
        reports.append(replace(report, **(changes or {}).get(i, {})))
        if reports[-1].abort:
            break
    return ExecutionReport(tuple(reports), 4.0)
