"""A small table seen by four cameras, and records of episodes on it: real geometry, no robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid, transform_points
from gvla2.geometry.views import Observation, View, Views
from gvla2.memory.contracts import Learned, MemoryContext, MemoryItem, Verdict
from gvla2.planning.contracts import Abstention, Candidate, Plan
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import SuccessCheck
from gvla2.robot.report import ExecutionReport, WaypointReport

TABLE = 0.752
SIDE = 64
CAMERAS = {
    "front": ((1.35, 0.0, 1.58), (-0.906, 0.0, -0.423), 40.0),
    "left_shoulder": ((-0.175, 0.2, 1.98), (0.416, -0.073, -0.906), 40.0),
    "right_shoulder": ((-0.175, -0.2, 1.98), (0.416, 0.073, -0.906), 40.0),
    "wrist": ((0.23, -0.01, 1.44), (0.05, 0.0, -1.0), 60.0),
}
THINGS = (
    ("red cube", "box", "red", (0.82, 0.12, 0.10), (0.24, -0.10), 0.4, (0.05, 0.05, 0.05)),
    ("olive cube", "box", "olive", (0.50, 0.52, 0.10), (0.33, 0.12), -0.2, (0.05, 0.05, 0.05)),
    ("white plate", "region", "white", (0.93, 0.93, 0.90), (0.12, 0.20), 0.1, (0.17, 0.17, 0.001)),
)


@pytest.fixture(scope="session")
def side() -> int:
    return SIDE


def _solid(extents: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return 0.5 * signs * np.array(extents), np.array(faces, dtype=np.int64)


def _pose(xy: tuple[float, float], yaw: float, height: float) -> np.ndarray:
    c, s = np.cos(yaw), np.sin(yaw)
    return rigid([[c, -s, 0], [s, c, 0], [0, 0, 1]], (*xy, TABLE + height / 2))


def build_scene(lifted: float = 0.0) -> Scene:
    objects = []
    for k, (label, shape, colour, rgb, xy, yaw, extents) in enumerate(THINGS):
        pose = _pose(xy, yaw, extents[2])
        if k == 0:
            pose[2, 3] += lifted
        grid = np.random.default_rng(k).uniform(-0.5, 0.5, (120, 3)) * extents
        grid[:, 2] = extents[2] / 2
        objects.append(
            SceneObject(
                id=f"object_{k}",
                label=label,
                shape=shape,
                colour=colour,
                world_from_object=pose,
                extents=np.array(extents),
                points=transform_points(pose, grid),
                rgb=np.array(rgb),
                confidence=0.97 - 0.13 * k,
            )
        )
    space = Box(np.array([-0.275, -0.655, 0.752]), np.array([0.775, 0.655, 1.752]))
    return Scene(tuple(objects), TABLE, space, perceiver="classical", notes=("Four views were fused.",))


def build_observation(scene: Scene, size: int) -> Observation:
    surfaces, poses = [], {}
    top, faces = _solid((1.3, 1.5, 0.04))
    surfaces.append(Surface(top, faces, np.array([0.71, 0.62, 0.50]), 0))
    poses[0] = rigid(translation=(0.25, 0.0, TABLE - 0.02))
    for k, thing in enumerate(scene.objects, start=1):
        vertices, faces = _solid(tuple(thing.extents))
        surfaces.append(Surface(vertices, faces, thing.rgb, k))
        poses[k] = thing.world_from_object
    cameras = [
        Camera.from_fov(np.deg2rad(fov), look_along(at, forward), size, size, name)
        for name, (at, forward, fov) in CAMERAS.items()
    ]
    shots = RayCaster(surfaces).cast(cameras, poses)
    views = Views(tuple(View(c, s.image, s.depth) for c, s in zip(cameras, shots, strict=True)))
    tcp = rigid(np.diag([1.0, -1.0, -1.0]), (0.279, -0.009, 1.1))
    return Observation(views, tcp, np.zeros(7), 1.0, 0.08)


def build_plan() -> Plan:
    down = Orientation("grasp", (0.0, 0.0, -1.0), (0.39, 0.92, 0.0))
    touch = frozenset({"object_0"})
    waypoints = (
        Waypoint((0.24, -0.10, TABLE + 0.15), 1.0, "approach", down),
        Waypoint(
            (0.24, -0.10, TABLE + 0.02), 0.0, "grasp", motion="linear", speed=0.1, allowed_contacts=touch
        ),
        Waypoint((0.24, -0.10, TABLE + 0.22), 0.0, "lift", motion="linear", carries="object_0"),
        Waypoint((0.12, 0.20, TABLE + 0.22), 0.0, "transit", carries="object_0"),
        Waypoint(
            (0.12, 0.20, TABLE + 0.04),
            1.0,
            "place",
            motion="linear",
            carries="object_0",
            allowed_contacts=touch,
        ),
        Waypoint((0.12, 0.20, TABLE + 0.16), 1.0, "retreat", motion="linear"),
    )
    return Plan(
        Trajectory(waypoints),
        skill="pick_place",
        roles={"theme": "object_0", "goal": "object_2"},
        parameters={"standoff": 0.13, "grasp_depth": 0.03, "lift_height": 0.2, "speed": 0.25},
        candidates=(
            Candidate("from above, fingers across the short side", 0.91),
            Candidate("from above, fingers along the diagonal", 0.55),
            Candidate("from the side", 0.62, "the hand would touch the table"),
        ),
        notes=(
            "lift_height: 0.17 -> 0.2, bound >= 0.2 from rec-7",
            "The cube is narrower than the open hand.",
        ),
    )


def build_report(plan: Plan, stop_at: int | None = None) -> ExecutionReport:
    reports = []
    for k, w in enumerate(plan.trajectory or ()):
        held = w.gripper < 0.5
        reports.append(
            WaypointReport(
                index=k,
                stage=w.stage,
                target=w.xyz,
                reached=(w.xyz[0] + 0.0004, w.xyz[1] - 0.0011, w.xyz[2] + 0.0008),
                error=0.0014,
                gripper_width=0.0496 if held else 0.08,
                held=held,
                contacts=("left_finger", "right_finger") if held else (),
                status=w.motion if w.motion == "linear" else "rrt_connect",
                abort="slipped" if k == stop_at else "",
                message="The fingers closed to 0.4 mm." if k == stop_at else "",
                planning_seconds=0.06,
                motion_seconds=0.9,
            )
        )
        if k == stop_at:
            break
    return ExecutionReport(tuple(reports), seconds=6.2)


def build_recalled() -> MemoryContext:
    items = (
        MemoryItem(
            "rec-7",
            "failure_avoidance",
            "Lift at least 0.20 m before moving sideways: at 0.17 m the held cube touched a neighbour.",
            0.86,
            0.71,
            {"r_text": 0.42, "confidence": 0.19, "success": 0.16, "age": -0.06},
            True,
            {"kind": "bound", "parameter": "lift_height", "op": ">=", "value": 0.2, "skill": "pick_place"},
        ),
        MemoryItem(
            "rec-3",
            "procedural_hint",
            "Close the fingers across the cube's short side.",
            0.64,
            0.44,
            {"r_text": 0.31, "confidence": 0.08, "success": 0.05},
            False,
        ),
    )
    return MemoryContext(items, "<memory>\nLift at least 0.20 m.\n</memory>")


def build_checks(passed: bool = True) -> CheckReport:
    findings = [
        Finding("schema", True, message="6 waypoints, finite, in the world frame."),
        Finding(
            "workspace", True, message="Smallest distance to the workspace's edge.", value=0.021, limit=0.0
        ),
        Finding("gripper", True, message="Closes on object_0, opens on object_2."),
        Finding("kinematics", True, message="Smallest margin to a joint limit.", value=0.31, limit=0.05),
        Finding("clearance", True, message="Smallest clearance on the way.", value=0.017, limit=0.01),
        Finding("memory", True, message="lift_height >= 0.2 holds."),
    ]
    if not passed:
        findings[4] = Finding(
            "clearance",
            False,
            3,
            "collision",
            "Waypoint 3 (transit): the hand comes too near object_1.",
            0.002,
            0.01,
        )
    return CheckReport(tuple(findings), ("Waypoint 0 (approach): raised by 4 mm.",))


@pytest.fixture(scope="session")
def seen() -> tuple[Scene, Observation, Observation]:
    """The scene, and observations before and after."""
    scene = build_scene()
    return scene, build_observation(scene, SIDE), build_observation(build_scene(0.2), SIDE)


@pytest.fixture(scope="session")
def episode(seen: tuple[Scene, Observation, Observation]) -> Callable[..., EpisodeRecord]:
    """A finished record; keyword arguments replace its fields."""
    full = full_record(*seen)

    def make(**changes: Any) -> EpisodeRecord:
        return replace(full, **changes)

    return make


def full_record(scene: Scene, before: Observation, after: Observation) -> EpisodeRecord:
    plan = build_plan()
    return EpisodeRecord(
        episode_id="2025-01-01/12-00-00",
        instruction="put the red cube on the white plate",
        task="put_block",
        seed=3,
        choices={"robot": "sapien_panda", "task": "put_block", "perceiver": "classical", "memory": "governed",
                 "planner": "skill", "verifier": "geometric"},
        goal="relaxed: the block touches the target; strict: its centre is within 10 mm.",
        observation=before,
        scene=scene,
        refinement="Three boxes were fitted to the fused points; the largest change was 1.2 mm.",
        recalled=build_recalled(),
        plan=plan,
        checks=build_checks(),
        report=build_report(plan),
        after=after,
        after_scene=build_scene(0.2),
        verdict=Verdict.from_criteria(
            {"theme_moved": 1.0, "theme_at_goal": 0.9, "others_still": 0.62},
            ("The red cube was seen 4 mm from the plate's centre.",),
            "geometric",
        ),
        learned=Learned(("rec-9",), ("rec-3",), (), 1, ("rec-9: transit at 0.22 m worked (added).",)),
        success_check=SuccessCheck(relaxed=True, strict=False),
        timings={"setup": 0.9, "observe": 0.04, "perceive": 0.31, "reconstruct": 0.12, "recall": 0.02, "plan": 0.2,
                 "check": 0.4, "execute": 4.1, "verify": 0.1, "learn": 0.03, "success_check": 0.001},
    )  # fmt: skip


STAGE_FIELDS = {
    "setup": (),
    "observe": (),
    "perceive": ("observation",),
    "reconstruct": ("observation", "scene"),
    "recall": ("observation", "scene", "refinement"),
    "plan": ("observation", "scene", "refinement", "recalled"),
    "check": ("observation", "scene", "refinement", "recalled", "plan"),
    "execute": ("observation", "scene", "refinement", "recalled", "plan", "checks"),
    "verify": ("observation", "scene", "refinement", "recalled", "plan", "checks", "report", "after"),
    "learn": (
        "observation",
        "scene",
        "refinement",
        "recalled",
        "plan",
        "checks",
        "report",
        "after",
        "verdict",
    ),
}


@pytest.fixture(scope="session")
def failed_at(seen: tuple[Scene, Observation, Observation]) -> Callable[[str], EpisodeRecord]:
    """A record whose stage of this name raised."""
    full = full_record(*seen)

    def make(stage: str) -> EpisodeRecord:
        kept = {name: getattr(full, name) for name in STAGE_FIELDS[stage]}
        timings = {
            k: v
            for k, v in full.timings.items()
            if k in list(STAGE_FIELDS)[: list(STAGE_FIELDS).index(stage)]
        }
        return EpisodeRecord(
            full.episode_id, full.instruction, full.task, full.seed, full.choices, full.goal,
            timings=timings, failure=Failure(stage, "error", f"The stage {stage} broke."), **kept
        )  # fmt: skip

    return make


@pytest.fixture(scope="session")
def abstained(episode: Callable[..., EpisodeRecord]) -> EpisodeRecord:
    """A record whose planner declined."""
    refusal = Abstention("ambiguous", "Two red cubes fit “the red cube”; say which one.")
    return episode(
        plan=Plan(None, abstention=refusal, notes=("Both lie within reach.",)),
        checks=None, report=None, after=None, after_scene=None, verdict=None, learned=None, success_check=None,
        failure=Failure("plan", refusal.kind, refusal.message),
    )  # fmt: skip
