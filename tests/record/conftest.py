"""Records of episodes with two cubes on a table seen by three cameras: real geometry, no robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.episode.refine import Refinement
from gvla2.geometry.views import Observation, Views
from gvla2.memory.contracts import Learned, MemoryContext, MemoryItem, Verdict
from gvla2.planning.contracts import Abstention, Candidate, Plan
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import SuccessCheck
from gvla2.robot.report import ExecutionReport, WaypointReport
from gvla2.testing import inputs
from gvla2.testing.inputs import BLUE, RED, TABLE

STAGES = (
    "setup",
    "observe",
    "perceive",
    "reconstruct",
    "recall",
    "plan",
    "check",
    "execute",
    "verify",
    "learn",
)
FILLED = {
    "observe": ("observation",), "perceive": ("scene",), "reconstruct": ("refined",), "recall": ("recalled",),
    "plan": ("plan",), "check": ("checks",), "execute": ("report", "after", "after_scene"), "verify": ("verdict",),
    "learn": ("learned",), "success_check": ("success_check",),
}  # fmt: skip
"""The fields of a record that each stage fills."""


def build_observation() -> Observation:
    """What the cameras "front", "wrist" and "left" see."""
    seen = inputs.observation(64)
    named = zip(("front", "wrist", "left"), seen.views, strict=True)
    views = tuple(replace(view, camera=replace(view.camera, name=name)) for name, view in named)
    return replace(seen, views=Views(views))


def build_plan() -> Plan:
    touch = frozenset({"red_cube"})
    held: dict[str, Any] = {"motion": "linear", "carries": "red_cube"}
    path = (
        (
            RED.centre,
            0.15,
            1.0,
            "approach",
            {"orientation": Orientation("grasp", (0, 0, -1), (0.39, 0.92, 0))},
        ),
        (RED.centre, 0.02, 0.0, "grasp", {"motion": "linear", "allowed_contacts": touch}),
        (RED.centre, 0.22, 0.0, "lift", held),
        (BLUE.centre, 0.22, 0.0, "transit", {"carries": "red_cube"}),
        (BLUE.centre, 0.08, 1.0, "place", {**held, "allowed_contacts": touch}),
        (BLUE.centre, 0.20, 1.0, "retreat", {"motion": "linear"}),
    )
    return Plan(
        Trajectory(
            tuple(Waypoint((*xy, TABLE + up), grip, stage, **more) for xy, up, grip, stage, more in path)
        ),
        skill="pick_place",
        roles={"theme": "red_cube", "goal": "blue_cube"},
        parameters={"standoff": 0.13, "lift_height": 0.2},
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


def build_report(plan: Plan) -> ExecutionReport:
    reports = tuple(
        WaypointReport(k, w.stage, w.xyz, w.xyz, 0.0014, 0.0496, w.gripper < 0.5, ("left_finger",), w.motion)
        for k, w in enumerate(plan.trajectory or ())
    )
    return ExecutionReport(reports, seconds=6.2)


def build_recalled() -> MemoryContext:
    bound = {"kind": "bound", "parameter": "lift_height", "op": ">=", "value": 0.2, "skill": "pick_place"}
    items = (
        MemoryItem("rec-7", "failure_avoidance", "Lift at least 0.20 m before moving sideways.", 0.86, 0.71,
                   {"r_text": 0.42, "confidence": 0.19, "success": 0.16, "age": -0.06}, True, bound),
        MemoryItem("rec-3", "procedural_hint", "Close the fingers across the cube's short side.", 0.64, 0.44,
                   {"r_text": 0.31, "confidence": 0.08, "success": 0.05}, False),
    )  # fmt: skip
    return MemoryContext(items, "<memory>\nLift at least 0.20 m.\n</memory>")


@pytest.fixture(scope="session")
def seen() -> tuple[Scene, Observation]:
    """The scene, and an observation of it."""
    return replace(
        inputs.scene(), perceiver="classical", notes=("Three views were fused.",)
    ), build_observation()


@pytest.fixture(scope="session")
def episode(seen: tuple[Scene, Observation]) -> Callable[..., EpisodeRecord]:
    """A finished record; keyword arguments replace its fields."""
    (scene, observation), plan = seen, build_plan()
    full = EpisodeRecord(
        episode_id="2025-01-01/12-00-00",
        instruction="put the red cube on the blue cube",
        task="put_block",
        seed=3,
        choices={"robot": "sapien_panda", "task": "put_block", "perceiver": "classical", "memory": "governed",
                 "planner": "skill", "verifier": "geometric"},
        goal="relaxed: the block touches the target; strict: its centre is within 10 mm.",
        observation=observation,
        scene=scene,
        refined=(Refinement(scene.objects[0], scene.objects[0], True, "agreement with the masks 0.912 and 0.934"),),
        recalled=build_recalled(),
        plan=plan,
        checks=CheckReport(
            (
                Finding("schema", True, message="6 waypoints, finite, in the world frame."),
                Finding("clearance", True, message="Smallest clearance on the way.", value=0.017, limit=0.01),
            ),
        ),
        report=build_report(plan),
        after=observation,
        after_scene=scene,
        verdict=Verdict.from_criteria(
            {"theme_moved": 1.0, "theme_at_goal": 0.9, "others_still": 0.62},
            ("The red cube was seen 4 mm from the goal's centre.",),
            "geometric",
        ),
        learned=Learned(("rec-9",), ("rec-3",), (), 1, ("rec-9: transit at 0.22 m worked (added).",)),
        success_check=SuccessCheck(relaxed=True, strict=False),
        timings={**dict.fromkeys(STAGES, 0.1), "execute": 4.1, "success_check": 0.001},
    )  # fmt: skip

    def make(**changes: Any) -> EpisodeRecord:
        return replace(full, **changes)

    return make


@pytest.fixture(scope="session")
def failed_at(episode: Callable[..., EpisodeRecord]) -> Callable[[str], EpisodeRecord]:
    """A record whose stage of this name raised."""

    def make(stage: str) -> EpisodeRecord:
        before = STAGES[: STAGES.index(stage)]
        lost = {name: None for each, names in FILLED.items() if each not in before for name in names}
        failure = Failure(stage, "error", f"The stage {stage} broke.")  # type: ignore[arg-type]
        return episode(timings=dict.fromkeys(before, 0.1), failure=failure, **lost)

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
