from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid, transform_points
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Advice, Plan, PlanRequest
from gvla2.planning.effects import Ban, Bound, Prior
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.workcell import make_cell
from gvla2.testing import inputs
from gvla2.testing.planning import check_planner
from gvla2_plugins.sapien import SapienPandaConfig
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.planner import SkillPlanner

TABLE = 0.752
PLANNER = SkillPlanner(SkillConfig())


@pytest.fixture(scope="module")
def arm():
    return make_cell(SapienPandaConfig()).arm


def scene_object(name, label, shape, xy, size, yaw=0.0, colour="", base=0.0, parent="") -> SceneObject:
    extents = np.array(size, dtype=float)
    turn = Rotation.from_euler("z", yaw).as_matrix()
    pose = rigid(turn, (*xy, TABLE + base + extents[2] / 2))
    return SceneObject(
        name, label, shape, colour or label.split()[0], pose, extents, np.zeros((0, 3)), parent=parent
    )


def cube(name, colour, xy, yaw=0.2, side=0.05) -> SceneObject:
    return scene_object(name, f"{colour} cube", "box", xy, (side,) * 3, yaw)


RED, BLUE = cube("r", "red", (0.3, 0.1)), cube("b", "blue", (0.25, -0.2))
SQUARE = scene_object("g", "green square", "region", (0.4, -0.1), (0.1, 0.1, 0.001))
BASE = scene_object("l", "gray lamp base", "plate", (0.35, -0.3), (0.16, 0.08, 0.01))
BUTTON = scene_object(
    "k", "orange button", "disc", (0.31, -0.3), (0.033, 0.033, 0.014), base=0.01, parent="l"
)
TRAY = scene_object("t", "white tray", "plate", (0.45, 0.25), (0.2, 0.15, 0.02))
ALL = (RED, BLUE, SQUARE, BASE, BUTTON, TRAY)


def request(arm, sentence: str, *objects: SceneObject, effects=(), rejections=()) -> PlanRequest:
    scene = Scene(objects or ALL, TABLE, arm.workspace)
    seen = replace(inputs.observation(16), world_from_tcp=arm.forward(arm.home), joints=arm.home)
    advice = Advice(effects=tuple(effects))
    return PlanRequest(sentence, scene, arm, arm.forward(arm.home), arm.home, seen, advice, rejections)


def plan(arm, sentence: str, *objects: SceneObject, **more) -> Plan:
    asked = request(arm, sentence, *objects, **more)
    made = PLANNER.plan(asked)
    assert (made.trajectory is None) == (made.abstention is not None)
    if made.trajectory is not None:
        report = check_trajectory(
            made.trajectory, asked.scene, arm, asked.start, asked.joints,
            effects=asked.advice.effects, parameters=made.parameters, skill=made.skill,
        )  # fmt: skip
        assert report.passed, report.reasons
    return made


def stage(made: Plan, name: str) -> np.ndarray:
    return np.array(next(w.xyz for w in made.trajectory if w.stage == name))


def refusal(made: Plan) -> str:
    assert made.abstention is not None, made
    assert made.abstention.message
    return made.abstention.kind


def test_it_passes_the_conformance_checks():
    check_planner(PLANNER)


def test_pick_grasps_across_two_faces_and_lifts_25_cm(arm):
    made = plan(arm, "lift the red cube")
    assert made.roles == {"theme": "r"}
    assert [w.stage for w in made.trajectory] == ["approach", "grasp", "close", "lift"]
    np.testing.assert_allclose(stage(made, "grasp")[:2], RED.centre[:2], atol=1e-9)
    assert stage(made, "lift")[2] - stage(made, "grasp")[2] == pytest.approx(0.25)
    closing = made.trajectory.waypoints[0].orientation.closing
    assert np.abs(RED.world_from_object[:3, :3].T @ closing).max() == pytest.approx(1.0)
    last = made.trajectory.waypoints[-1]
    assert (last.carries, last.gripper, last.motion) == ("r", 0.0, "linear")


def test_pick_prefers_the_narrow_side_and_obeys_amounts(arm):
    bar = scene_object("a", "red box", "box", (0.35, 0.0), (0.12, 0.03, 0.04), 0.7)
    made = plan(arm, "lift the red box 10 cm", bar)
    assert made.parameters["lift_height"] == pytest.approx(0.10)
    assert stage(made, "lift")[2] - stage(made, "grasp")[2] == pytest.approx(0.10)
    closing = np.array(made.trajectory.waypoints[0].orientation.closing)
    assert abs(closing @ bar.world_from_object[:3, 1]) == pytest.approx(1.0)


def test_the_fingertips_never_reach_the_table(arm):
    flat = scene_object("a", "red plate", "plate", (0.35, 0.05), (0.1, 0.05, 0.008))
    made = plan(arm, "pick up the plate", flat, effects=[Bound("grasp_depth", 0.05, ">=", skill="pick")])
    for waypoint in made.trajectory:
        assert waypoint.xyz[2] - arm.hand.tip_beyond_tcp >= TABLE + 0.004 - 1e-9


@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.6, 1.2])
@pytest.mark.parametrize("side", [0.045, 0.0675])
def test_push_ends_with_the_block_on_the_goal(arm, yaw, side):
    block = cube("r", "red", (0.28, 0.08), yaw, side)
    made = plan(arm, "push the red cube onto the green square", block, SQUARE)
    assert made.roles == {"theme": "r", "goal": "g"}
    pushes = [i for i, w in enumerate(made.trajectory) if w.stage.startswith("push")]
    moved = np.zeros(2)
    for i in pushes:
        before, after = made.trajectory.waypoints[i - 1], made.trajectory.waypoints[i]
        assert after.motion == "linear"
        stroke = np.subtract(after.xyz, before.xyz)[:2]
        assert stroke[0] ** 2 + stroke[1] ** 2 > made.parameters["standoff"] ** 2
        moved += stroke * (1 - made.parameters["standoff"] / np.linalg.norm(stroke))
    np.testing.assert_allclose(block.centre[:2] + moved, SQUARE.centre[:2], atol=1e-6)


@pytest.mark.parametrize(
    ("words", "way"),
    [
        ("forward 12 cm", (0.12, 0)),
        ("to the left by 12 cm", (0, 0.12)),
        ("back 12 cm", (-0.12, 0)),
        ("right", (0, -0.1)),
    ],
)
def test_push_in_a_direction_of_the_robot(arm, words, way):
    made = plan(arm, f"push the cube {words}", cube("r", "red", (0.4, 0.0), 0.0))
    start, end = stage(made, "lower"), stage(made, "push")
    stroke = (end - start)[:2]
    shift = stroke * (1 - made.parameters["standoff"] / np.linalg.norm(stroke))
    np.testing.assert_allclose(shift, way, atol=1e-6)


def test_push_goes_around_what_would_be_hit_or_says_so(arm):
    block = cube("r", "red", (0.25, 0.1), 0.0)
    goal = scene_object("g", "green square", "region", (0.45, 0.1), (0.1, 0.1, 0.001))
    wall = cube("w", "blue", (0.35, 0.1), 0.0)
    made = plan(arm, "push the red cube to the green square", block, goal, wall)
    assert any("'blue cube' is in the way" in c.description for c in made.candidates)


@pytest.mark.parametrize(
    "sentence", ["turn on the lamp", "press the orange button", "press the button of the lamp"]
)
def test_press_goes_straight_down_on_the_button_with_closed_fingers(arm, sentence):
    made = plan(arm, sentence)
    assert made.roles == {"theme": "k", "part": "k"}
    assert all(w.gripper == 0.0 for w in made.trajectory)
    np.testing.assert_allclose(stage(made, "press")[:2], BUTTON.centre[:2])
    tip = stage(made, "press")[2] - arm.hand.tip_beyond_tcp
    assert BUTTON.top - tip == pytest.approx(made.parameters["press_depth"])


@pytest.mark.parametrize(
    ("height", "depth"), [(0.0092, 0.008), (0.011, 0.0098), (0.014, 0.010), (0.02, 0.010)]
)
@pytest.mark.parametrize("effects", [(), (Prior("press_depth", 0.015, count=1000),)])
def test_press_stops_above_what_the_button_stands_on(arm, height, depth, effects):
    button = replace(BUTTON, extents=np.array([0.033, 0.033, height]))
    button = replace(button, world_from_object=rigid(translation=(0.31, -0.3, BASE.top + height / 2)))
    made = plan(arm, "press the button", BASE, button, effects=effects)
    tip = stage(made, "press")[2] - arm.hand.tip_beyond_tcp
    assert tip >= BASE.top + 0.001
    assert button.top - tip == pytest.approx(made.parameters["press_depth"])
    if not effects:
        assert made.parameters["press_depth"] == pytest.approx(depth)
    if made.parameters["press_depth"] < 0.010:
        assert any("stands out by" in note for note in made.notes)


def test_place_carries_over_and_lets_go_on_the_goal(arm):
    made = plan(arm, "put the red cube on the tray")
    assert [w.stage for w in made.trajectory] == [
        "approach", "grasp", "close", "lift", "transit", "place", "release", "retreat",
    ]  # fmt: skip
    hangs = stage(made, "grasp")[2] - RED.bottom
    np.testing.assert_allclose(stage(made, "place")[:2], TRAY.centre[:2], atol=1e-9)
    assert stage(made, "place")[2] - hangs == pytest.approx(TRAY.top + made.parameters["place_height"])
    beside = plan(arm, "put the red cube to the left of the blue cube")
    assert stage(beside, "place")[1] > BLUE.centre[1] + 0.05


@pytest.mark.parametrize(
    ("sentence", "kind"),
    [
        ("juggle the red cube", "unknown_skill"),
        ("open the tray", "unknown_skill"),
        ("", "unknown_skill"),
        ("pick up the banana", "nothing_matches"),
        ("pick up the magenta cube", "nothing_matches"),
        ("pick up the cube", "ambiguous"),
        ("pick up the table", "nothing_matches"),
        ("push the red cube", "no_goal"),
        ("put the red cube down", "no_goal"),
        ("push the red cube to the moon", "nothing_matches"),
        ("press the red cube", "nothing_matches"),
        ("pick up the white tray", "too_wide"),
        ("pick up the red cube and press the button", "other"),
        ("push the red cube forward 90 cm", "unreachable"),
    ],
)
def test_each_kind_of_abstention(arm, sentence, kind):
    assert refusal(plan(arm, sentence)) == kind


def test_no_other_colour_and_no_other_kind_stands_in_for_what_is_not_there(arm):
    lime = cube("a", "lime", (0.35, 0.1))
    can = scene_object("c", "blue box", "box", (0.35, 0.1), (0.05, 0.05, 0.08))
    assert refusal(plan(arm, "pick up the teal cube", lime, BLUE)) == "nothing_matches"
    assert plan(arm, "pick up the green cube", lime, BLUE).roles["theme"] == "a"
    assert plan(arm, "pick up the green cube", lime, cube("g", "green", (0.3, -0.1))).roles["theme"] == "g"
    for sentence in ("pick up the blue cylinder", "pick up the can", "put the blue mug on the red cube"):
        assert refusal(plan(arm, sentence, can, RED)) == "nothing_matches"


def test_memory_bounds_and_priors_change_theta_and_the_motion(arm):
    bound = Bound("lift_height", 0.35, ">=", skill="pick", source="r1")
    prior = Prior("standoff", 0.1, count=1000, source="r2")
    plain, taught = plan(arm, "lift the red cube"), plan(arm, "lift the red cube", effects=[bound, prior])
    assert taught.parameters["lift_height"] == 0.35
    assert stage(taught, "lift")[2] - stage(plain, "lift")[2] == pytest.approx(0.10)
    assert stage(taught, "approach")[2] > stage(plain, "approach")[2] + 0.04
    assert any("r1" in n for n in taught.notes)
    assert any("r2" in n for n in taught.notes)
    overshoot = Bound("push_overshoot", 0.02, ">=", skill="push")
    block = cube("r", "red", (0.28, 0.0), 0.0)
    goal = scene_object("g", "green square", "region", (0.45, 0.0), (0.1, 0.1, 0.001))
    ends = [
        stage(plan(arm, "push the cube to the square", block, goal, effects=e), "push")
        for e in ([], [overshoot])
    ]
    assert ends[1][0] - ends[0][0] == pytest.approx(0.02)


def test_a_forbidden_approach_is_not_used(arm):
    forbid = Ban("approach:straight", skill="push", source="r3")
    asked = ("push the red cube onto the green square", cube("r", "red", (0.28, 0.08), 0.3), SQUARE)
    plain, taught = plan(arm, *asked), plan(arm, *asked, effects=[forbid])
    assert [w.stage for w in plain.trajectory] != [w.stage for w in taught.trajectory]
    assert any("r3" in c.rejected for c in taught.candidates)
    top = Ban("approach:top", skill="press")
    assert refusal(plan(arm, "turn on the lamp", effects=[top])) == "other"


def test_a_second_try_after_a_rejection_is_another_way(arm):
    first = plan(arm, "lift the red cube")
    second = plan(arm, "lift the red cube", rejections=("The hand hits the wall.",))
    assert first.trajectory != second.trajectory
    assert any("hits the wall" in c.rejected for c in second.candidates)


@settings(max_examples=8, deadline=None)
@given(
    yaw=st.floats(-0.6, 0.6),
    skill=st.sampled_from(["pick up the red cube", "push the red cube to the square"]),
)
def test_turning_the_scene_about_the_base_turns_the_plan(arm, yaw, skill):
    foot = np.array([*SapienPandaConfig().base_position[:2], 0.0])
    turn = (
        rigid(translation=foot) @ rigid(Rotation.from_euler("z", yaw).as_matrix()) @ rigid(translation=-foot)
    )
    objects = (
        cube("r", "red", (0.25, 0.05), 0.3),
        scene_object("g", "green square", "region", (0.35, -0.1), (0.1, 0.1, 0.001)),
    )
    turned = tuple(replace(o, world_from_object=turn @ o.world_from_object) for o in objects)
    plain, other = plan(arm, skill, *objects), plan(arm, skill, *turned)
    # The same grasp or stroke may be done by the hand turned round, which leaves the positions alone.
    assert len(plain.trajectory) == len(other.trajectory)
    np.testing.assert_allclose(
        other.trajectory.xyzg()[:, :3], transform_points(turn, plain.trajectory.xyzg()[:, :3]), atol=1e-6
    )


@settings(max_examples=25, deadline=None)
@given(st.text(max_size=40))
def test_no_sentence_raises(arm, text):
    made = PLANNER.plan(request(arm, text))
    assert made.abstention is None or made.abstention.kind


@pytest.mark.parametrize(
    "said",
    ["-5 cm", "by - 5cm", "by −5 cm", "minus five cm", "1/2 cm", "5 - 10 cm", "5 to 10 cm", "1,5 cm", "10"],
)
def test_a_length_that_is_negative_or_no_single_number_is_declined(arm, said):
    assert refusal(plan(arm, f"lift the red cube {said}")) in ("other", "nothing_matches")


def test_an_object_is_not_its_own_goal(arm):
    made = plan(arm, "put the red cube on the red cube")
    assert refusal(made) == "other"
    assert "The red cube cannot be its own goal" in made.abstention.message


def test_a_distance_from_another_object_is_declined(arm):
    made = plan(arm, "put the red cube 10 cm to the right of the blue cube")
    assert refusal(made) == "other"
    assert "not supported; 0.1 m from the blue cube was asked for" in made.abstention.message
