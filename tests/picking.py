"""Episodes of picking a cube up, as the loop records them, with whatever is to be otherwise."""

from dataclasses import replace
from typing import Any

from gvla2.episode.failure_diagnosis import diagnose
from gvla2.episode.record import EpisodeRecord
from gvla2.memory.contracts import Verdict
from gvla2.planning.contracts import Plan
from gvla2.planning.effects import Effect, effect_from_json
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import SceneObject
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from tests.objects import reported, scene, scene_object

SUCCESS = Verdict.from_criteria({"task_completion": 1.0, "collision_safety": 1.0})
FAIL = Verdict.from_criteria({"task_completion": 0.0, "collision_safety": 0.2})
UNCERTAIN = Verdict.from_criteria({"task_completion": 0.5})


def cube(id_: str, x: float, y: float, colour: str, side: float = 0.05) -> SceneObject:
    return replace(scene_object(id_, (x, y, side / 2), (side,) * 3, colour), label=f"{colour} cube")


def square(id_: str, x: float, y: float, colour: str, side: float) -> SceneObject:
    painted = scene_object(id_, (x, y, side / 2), (side, side, 0.001), colour, "region")
    return replace(painted, label=f"{colour} square")


SCENE = scene(
    cube("a", 0.3, 0.1, "red"), cube("b", 0.3, -0.2, "blue"), square("goal", 0.5, 0.1, "green", 0.1)
)
DOWN = Orientation("grasp")
SIDE = Orientation("grasp", (1.0, 0.0, -0.1), (0.0, 1.0, 0.0))
PICK = (
    Waypoint((0.3, 0.1, 0.9), 1.0, "approach", DOWN),
    Waypoint((0.3, 0.1, 0.77), 1.0, "grasp", DOWN, allowed_contacts=frozenset({"a"})),
    Waypoint((0.3, 0.1, 0.77), 0.0, "close", DOWN, allowed_contacts=frozenset({"a"})),
    Waypoint((0.3, 0.1, 1.0), 0.0, "lift", DOWN, allowed_contacts=frozenset({"a"}), carries="a"),
    Waypoint((0.3, 0.1, 1.1), 0.0, "hold", DOWN, carries="a"),
)
THETA = {
    "standoff": 0.05,
    "approach_tilt": 0.0,
    "grasp_depth": 0.025,
    "lift_height": 0.25,
    "transit_clearance": 0.04,
    "speed": 0.25,
}


def episode(
    changes: dict[int, dict[str, Any]] | None = None, *, skill: str = "pick", waypoints: Any = PICK,
    instruction: str = "Pick up the red cube", roles: dict[str, str] | None = None,
    theta: dict[str, float] | None = None, **record: Any,
) -> EpisodeRecord:  # fmt: skip
    before = record.pop("scene", SCENE)
    candidates = record.pop("candidates", ())
    plan = Plan(
        Trajectory(waypoints), skill, roles or {"theme": "a"}, THETA if theta is None else theta, candidates
    )
    return EpisodeRecord(
        "run/1", instruction, "some_task", 0, {"planner": "skill"}, scene=before, plan=plan, checks=CheckReport(),
        report=reported(waypoints, changes, held=True, opened=0.05), **record,
    )  # fmt: skip


def kinds(record: EpisodeRecord) -> list[str]:
    return [signal.kind for signal in diagnose(record)]


def effects_of(lessons: Any) -> list[Effect]:
    """The effects on parameters; programs aside."""
    effects = (lesson.effect for lesson in lessons if lesson.effect)
    return [effect_from_json(effect) for effect in effects if effect["kind"] != "program"]


SCALES = {"grasp_depth": ("height", 0.05)}


def sized(record: EpisodeRecord) -> EpisodeRecord:
    """The record with a plan that says which parameter goes with the object's size."""
    assert record.plan is not None
    return replace(record, plan=replace(record.plan, scales=SCALES))
