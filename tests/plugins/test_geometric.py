"""The geometric verifier: each skill done, missed and undecided, from perceived scenes and reports alone."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.episode.evidence import RobotEvidence
from gvla2.geometry.transform import rigid
from gvla2.memory.contracts import Evidence, Verdict
from gvla2.planning.contracts import Abstention, Plan
from gvla2.planning.findings import CheckReport, Finding
from gvla2.planning.scene import KnownShape, PartJoint, Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.robot.report import ExecutionReport
from gvla2_plugins.geometric import GeometricConfig, gvla2_verifiers
from tests.objects import TABLE, renamed, reported, scene, scene_object


def obj(
    id_: str, x: float, y: float, z: float = TABLE, *, size: Sequence[float] = (0.05, 0.05, 0.05), yaw: float = 0.0,
    **more: Any,
) -> SceneObject:  # fmt: skip
    """An object whose underside is at height ``z``."""
    turn = Rotation.from_euler("z", yaw).as_matrix()
    return scene_object(id_, (x, y, z - TABLE + size[2] / 2), size, turn=turn, **more)


def evidence(
    before: Scene, after: Scene | None, skill: str, roles: dict[str, str], waypoints: Sequence[Waypoint],
    *, parameters: dict[str, float] | None = None, width: float = 0.0, last: dict[str, Any] | None = None,
) -> RobotEvidence:  # fmt: skip
    """Every waypoint reached to the millimetre; ``last`` changes the last report."""
    return RobotEvidence(
        instruction="do it",
        before=before,
        after=after,
        plan=Plan(Trajectory(tuple(waypoints)), skill, roles, parameters or {}),
        checks=CheckReport(),
        report=reported(waypoints, {len(waypoints) - 1: last or {}}),
        gripper_width=width,
    )


def judge(shown: Evidence) -> Verdict:
    (component,) = gvla2_verifiers()
    return component.build(GeometricConfig(name="geometric")).verify(shown)


BEFORE = scene(obj("a", 0.3, 0.1), obj("b", 0.3, -0.2, colour="blue"), obj("c", 0.5, 0.0, colour="green"))
PICK = (
    Waypoint((0.3, 0.1, 0.9), 1.0, "approach"),
    Waypoint((0.3, 0.1, 0.77), 1.0, "grasp", allowed_contacts=frozenset({"a"})),
    Waypoint((0.3, 0.1, 0.77), 0.0, "close", allowed_contacts=frozenset({"a"})),
    Waypoint((0.3, 0.1, 1.0), 0.0, "lift", allowed_contacts=frozenset({"a", "table"}), carries="a"),
)


def pick(after: Scene | None, width: float, **changes: Any) -> Verdict:
    return judge(evidence(BEFORE, after, "pick", {"theme": "a"}, PICK, width=width, **changes))


def moved(scene_: Scene, id_: str, x: float, y: float, z: float = TABLE, **looks: Any) -> Scene:
    old = scene_[id_]
    fresh = obj(id_, x, y, z, colour=old.colour, shape=old.shape, size=tuple(old.extents), **looks)
    return scene_.with_object(fresh)


def without(scene_: Scene, id_: str) -> Scene:
    return replace(scene_, objects=tuple(o for o in scene_.objects if o.id != id_))


def test_pick_done_whatever_the_second_perception_calls_objects() -> None:
    verdict = pick(renamed(moved(BEFORE, "a", 0.3, 0.1, 0.98)), 0.05)
    assert verdict.outcome == "verified_success"
    assert set(verdict.criteria) == {
        "task_completion", "spatial_consistency", "collision_safety", "execution_validity", "generalizability",
    }  # fmt: skip
    assert verdict.quality == pytest.approx(np.mean(list(verdict.criteria.values())))
    assert verdict.confidence == pytest.approx(2 * abs(verdict.quality - 0.5))


def test_pick_done_with_the_object_hidden_by_the_hand() -> None:
    assert pick(without(BEFORE, "a"), 0.05).outcome == "verified_success"


@pytest.mark.parametrize("width", [0.0, 0.0009])
def test_pick_with_an_empty_hand_is_a_failure_however_tidy_the_motion(width: float) -> None:
    verdict = pick(BEFORE, width)
    assert verdict.outcome == "verified_fail"
    assert verdict.quality <= 0.35
    assert verdict.criteria["execution_validity"] == 1.0


def test_an_object_that_moved_without_rising_was_not_picked() -> None:
    assert pick(moved(BEFORE, "a", 0.34, 0.1), 0.05).outcome == "verified_fail"


def test_a_small_lift_counts_when_a_small_lift_was_planned() -> None:
    low = (*PICK[:3], replace(PICK[3], xyz=(0.3, 0.1, 0.79)))
    for rise, planned, outcome in (
        (0.012, 0.02, "verified_success"),
        (0.012, 0.25, "uncertain"),
        (0.0, 0.02, "uncertain"),  # in the hand, hardly off the table
    ):
        after = moved(BEFORE, "a", 0.3, 0.1, TABLE + rise)
        shown = evidence(BEFORE, after, "pick", {"theme": "a"}, low, width=0.05,
                         parameters={"lift_height": planned})  # fmt: skip
        assert judge(shown).outcome == outcome


def test_twins_are_distinguished_by_place() -> None:
    twins = scene(obj("a", 0.3, 0.1), obj("twin", 0.3, -0.1), obj("c", 0.5, 0.0, colour="green"))
    shown = evidence(twins, renamed(without(twins, "a")), "pick", {"theme": "a"}, PICK, width=0.05)
    assert judge(shown).outcome == "verified_success"
    wrong = evidence(twins, renamed(without(twins, "twin")), "pick", {"theme": "a"}, PICK, width=0.05)
    assert judge(wrong).outcome == "verified_fail"


def test_nothing_perceived_at_the_end_is_unknown_not_half_done() -> None:
    verdict = pick(None, 0.05)
    assert (verdict.outcome, verdict.quality, verdict.confidence) == ("uncertain", 0.5, 0.0)
    assert "task_completion" not in verdict.criteria
    assert pick(None, 0.0).outcome == "verified_fail"  # an empty hand needs no camera


def test_disturbing_others_and_unplanned_contacts_cost() -> None:
    done = moved(BEFORE, "a", 0.3, 0.1, 0.98)
    clean, rough = pick(done, 0.05), pick(moved(done, "b", 0.3, -0.3), 0.05)
    assert rough.criteria["spatial_consistency"] == 0.5
    assert rough.quality < clean.quality
    touched = evidence(BEFORE, done, "pick", {"theme": "a"}, PICK, width=0.05)
    first = replace(touched.report.waypoints[0], contacts=("panda_link5",))
    report = replace(touched.report, waypoints=(first, *touched.report.waypoints[1:]))
    verdict = judge(replace(touched, report=report))
    assert verdict.criteria["collision_safety"] == pytest.approx(0.6)
    assert any("panda_link5" in reason for reason in verdict.reasons)
    assert judge(touched).criteria["collision_safety"] == 1.0


def test_an_abort_lowers_validity_and_a_collision_ends_safety() -> None:
    verdict = pick(BEFORE, 0.0, last={"abort": "collision", "message": "hit"})
    assert verdict.criteria["collision_safety"] == 0.0
    assert verdict.criteria["execution_validity"] < 0.5
    assert verdict.outcome == "verified_fail"


def test_an_interrupted_episode_is_nobodys_failure() -> None:
    assert pick(BEFORE, 0.0, last={"abort": "interrupted"}).outcome == "uncertain"


GOAL = obj("goal", 0.5, 0.2, shape="region", colour="blue", size=(0.1, 0.1, 0.001), yaw=0.4)
PUSHED = scene(obj("a", 0.3, 0.1), GOAL, obj("c", 0.5, -0.2, colour="green"))
PUSH = (
    Waypoint((0.2, 0.1, 0.9), 0.0, "approach"),
    Waypoint((0.22, 0.1, 0.77), 0.0, "lower"),
    Waypoint((0.47, 0.2, 0.77), 0.0, "push", allowed_contacts=frozenset({"a"})),
)


def push(x: float, y: float, **changes: Any) -> Verdict:
    after = renamed(without(moved(PUSHED, "a", x, y), "goal"))  # the block hides the paint
    return judge(evidence(PUSHED, after, "push", {"theme": "a", "goal": "goal"}, PUSH, **changes))


@pytest.mark.parametrize(
    ("x", "y", "outcome"),
    [
        (0.5, 0.2, "verified_success"),
        (0.53, 0.22, "verified_success"),
        (0.58, 0.2, "uncertain"),  # the goal is touched
        (0.3, 0.1, "verified_fail"),
        (0.7, 0.3, "verified_fail"),
    ],
)
def test_push(x: float, y: float, outcome: str) -> None:
    assert push(x, y).outcome == outcome


@pytest.mark.parametrize(
    ("x", "outcome"), [(0.5, "verified_success"), (0.3, "verified_fail"), (0.34, "verified_fail")]
)
def test_push_without_a_goal_is_judged_by_its_stroke(x: float, outcome: str) -> None:
    push = Waypoint((0.43, 0.1, 0.77), 0.0, "push", allowed_contacts=frozenset({"a"}))
    stroke = (Waypoint((0.2, 0.1, 0.77), 0.0, "lower"), push)
    shown = evidence(PUSHED, moved(PUSHED, "a", x, 0.1), "push", {"theme": "a"}, stroke,
                     parameters={"standoff": 0.03})  # fmt: skip
    assert judge(shown).outcome == outcome


@pytest.mark.parametrize(("x", "outcome"), [(0.452, "verified_success"), (0.33, "verified_fail")])
def test_push_against_a_solid_goal_ends_in_touch(x: float, outcome: str) -> None:
    before = scene(obj("a", 0.3, 0.0), obj("c", 0.5, 0.0, colour="green"))
    shown = evidence(before, moved(before, "a", x, 0.0), "push", {"theme": "a", "goal": "c"}, PUSH)
    assert judge(shown).outcome == outcome


LAMP = scene(
    obj("lamp", 0.4, 0.0, shape="box", colour="white", size=(0.1, 0.1, 0.02)),
    obj(
        "button", 0.4, 0.0, TABLE + 0.02, shape="disc", colour="red", size=(0.03, 0.03, 0.012), parent="lamp"
    ),
)
TOP = TABLE + 0.032


def press(depth: float, *, contact: bool = True, aside: float = 0.0, tip: float = 0.0) -> Verdict:
    """The hand was sent 8 mm below the button's top and went ``depth``; its tip is ``tip`` below its TCP."""
    allowed = frozenset({"button"})
    waypoints = (
        Waypoint((0.4, 0.0, TOP + 0.1), 0.0, "approach"),
        Waypoint((0.4, 0.0, TOP - 0.008 + tip), 0.0, "press", allowed_contacts=allowed),
    )
    last = {
        "reached": (0.4 + aside, 0.0, TOP - depth + tip),
        "contacts": ("panda_leftfinger",) if contact else (),
        "error": abs(0.008 - depth) + aside,
    }
    return judge(
        evidence(LAMP, LAMP, "press", {"theme": "lamp", "part": "button"}, waypoints,
                 parameters={"press_depth": 0.008}, last=last)
    )  # fmt: skip


@pytest.mark.parametrize("tip", [0.0, 0.01])
def test_press(tip: float) -> None:
    assert press(0.008, tip=tip).outcome == "verified_success"
    assert press(0.0045, tip=tip).outcome == "verified_success"
    assert press(0.0005, tip=tip).outcome == "verified_fail"
    assert press(-0.02, tip=tip).outcome == "verified_fail"
    assert press(0.008, aside=0.05, tip=tip).outcome == "verified_fail"
    assert press(0.008, contact=False, tip=tip).outcome == "uncertain"


PLACE = (
    *PICK,
    Waypoint((0.5, 0.2, 0.78), 0.0, "place", carries="a", allowed_contacts=frozenset({"a", "goal", "table"})),
    Waypoint(
        (0.5, 0.2, 0.78), 1.0, "release", carries="a", allowed_contacts=frozenset({"a", "goal", "table"})
    ),
    Waypoint((0.5, 0.2, 0.9), 1.0, "retreat", allowed_contacts=frozenset({"a"})),
)


@pytest.mark.parametrize(
    ("x", "z", "held", "outcome"),
    [
        (0.5, TABLE, False, "verified_success"),
        (0.3, TABLE, False, "verified_fail"),
        (0.5, TABLE + 0.2, False, "uncertain"),  # over the goal, not on it
        (0.5, TABLE, True, "verified_fail"),
    ],
)
def test_place(x: float, z: float, held: bool, outcome: str) -> None:
    shown = evidence(PUSHED, moved(PUSHED, "a", x, 0.2, z), "place", {"theme": "a", "goal": "goal"}, PLACE,
                     width=0.08, last={"held": held})  # fmt: skip
    assert judge(shown).outcome == outcome


@pytest.mark.parametrize(("y", "outcome"), [(0.0, "verified_success"), (0.16, "uncertain")])
def test_what_fell_beside_a_board_is_not_on_it_though_both_are_seen_as_a_larger_one(
    y: float, outcome: str
) -> None:
    board = obj("goal", 0.5, 0.0, colour="white", shape="plate", size=(0.40, 0.26, 0.015))
    before = scene(obj("a", 0.1, 0.3, size=(0.08, 0.02, 0.015)), board)
    larger = obj("goal", 0.5, 0.02, colour="white", shape="plate", size=(0.40, 0.32, 0.015))
    after = moved(before.with_object(larger), "a", 0.5, y, TABLE + 0.015 * (y == 0))
    there = (*PICK, *(replace(w, xyz=(0.5, 0.0, w.xyz[2])) for w in PLACE[len(PICK) :]))
    shown = evidence(before, after, "place", {"theme": "a", "goal": "goal"}, there, last={"held": False})
    assert judge(shown).outcome == outcome


def test_place_beside_is_judged_by_where_the_plan_meant() -> None:
    roles = {"theme": "a", "goal": "c"}
    for x, y, outcome in ((0.5, 0.2, "verified_success"), (0.6, 0.2, "verified_fail")):
        shown = evidence(PUSHED, moved(PUSHED, "a", x, y), "place", roles, PLACE, last={"held": False})
        assert judge(shown).outcome == outcome


@pytest.mark.parametrize(("lean", "outcome"), [(0.1, "verified_success"), (0.5, "uncertain")])
def test_a_known_object_that_lies_tilted_is_not_placed(lean: float, outcome: str) -> None:
    after = moved(PUSHED, "a", 0.5, 0.2)
    turn = rigid(Rotation.from_euler("x", lean).as_matrix())
    tilted = replace(after["a"], known=KnownShape("cube", "cube.obj", turn, up=np.array([0.0, 0.0, 1.0])))
    roles = {"theme": "a", "goal": "goal"}
    shown = evidence(PUSHED, after.with_object(tilted), "place", roles, PLACE, last={"held": False})
    assert judge(shown).outcome == outcome


def test_nothing_executed_is_uncertain() -> None:
    shown = evidence(BEFORE, BEFORE, "pick", {"theme": "a"}, PICK)
    abstained = Plan(None, abstention=Abstention("ambiguous", "two red cubes"))
    rejected = CheckReport((Finding("kinematics", False, 1, "unreachable", "too far"),))
    for never in (
        replace(shown, plan=abstained, report=ExecutionReport()),
        replace(shown, checks=rejected, report=ExecutionReport()),
        replace(shown, report=reported(PICK[:1], {0: {"abort": "not_started"}})),
    ):
        verdict = judge(never)
        assert (verdict.outcome, verdict.confidence) == ("uncertain", 0.0)
        assert verdict.reasons[0].startswith("Nothing was executed")


def test_a_skill_without_a_rule_is_uncertain_and_other_evidence_unavailable() -> None:
    shown = evidence(BEFORE, BEFORE, "juggle", {"theme": "a"}, PICK)
    assert judge(shown).outcome == "uncertain"
    assert judge(Evidence("fix the bug", facts={"exit_status": 0})).outcome == "unavailable"


def test_roles_that_name_nothing_are_unknown() -> None:
    for skill in ("pick", "push", "place", "press"):
        assert (
            judge(evidence(BEFORE, BEFORE, skill, {"theme": "ghost"}, PICK, width=0.05)).outcome
            == "uncertain"
        )


@pytest.mark.parametrize(("came", "outcome"), [(1.9, "verified_success"), (0.2, "uncertain")])
def test_a_knob_that_stays_in_place_is_judged_by_its_joint(came, outcome):
    joint = PartJoint(False, np.array([0.0, 0.0, 1.0]), np.zeros(3), 0.0, 2.0)
    knob = replace(obj("a", 0.3, 0.1), joint=joint)
    later = replace(knob, joint=replace(joint, position=came))
    shown = evidence(scene(knob), scene(later), "twist", {"theme": "a"}, PICK[:3], parameters={"turn": 2.0})
    assert judge(shown).outcome == outcome


def test_a_colour_in_the_name_that_perception_gave_is_no_colour() -> None:
    """A black bowl whose pixels are red: what the sentence calls black was handled, though something black is there."""
    bowl = replace(obj("a", 0.3, 0.1), label="black bowl", named_by="gallery")
    before = scene(bowl, replace(obj("b", 0.3, -0.2, colour="blue"), colour="black"))
    after = before.with_object(replace(bowl, world_from_object=rigid(None, (0.3, 0.1, 1.0))))
    shown = evidence(before, after, "pick", {"theme": "a"}, PICK, width=0.05)
    assert judge(replace(shown, instruction="pick up the black bowl")).outcome == "verified_success"
    plain = [
        replace(view, objects=(replace(view["a"], label="red box", named_by=""), view["b"]))
        for view in (before, after)
    ]
    shown = replace(shown, before=plain[0], after=plain[1], instruction="pick up the black bowl")
    assert judge(shown).outcome == "uncertain"


def test_what_an_object_stood_on_is_not_the_object() -> None:
    """A bowl is taken off a box and hidden by the hand: the box below its old place does not stand for it."""
    before = scene(
        obj("a", 0.3, 0.1, TABLE + 0.02), obj("b", 0.3, 0.1, colour="blue", size=(0.06, 0.08, 0.02))
    )
    after = without(before, "a")
    shown = evidence(before, after, "pick", {"theme": "a"}, PICK, width=0.05)
    assert judge(shown).outcome == "verified_success"
