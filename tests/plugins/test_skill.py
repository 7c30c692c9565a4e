"""The planner ``skill``: from a sentence and a scene to motions that pass every check, or to a typed refusal."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid, transform_points
from gvla2.planning.contracts import Plan
from gvla2.planning.effects import Ban, Bound, Prior
from gvla2.skills.mechanisms import hinge_for, slide_for, stuck
from gvla2_plugins.sapien import SapienPandaConfig
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.planner import SkillPlanner
from tests.skills.scenes import (
    ARM,
    PATCH,
    TABLE,
    asked,
    at,
    box,
    drawer,
    jar,
    named,
    request,
    stuck_brick,
)

HAND = ARM.hand
BACK = np.array([1.0, 0.0, 0.0])


def block(name, colour, xy, yaw=0.2, side=0.05):
    return named(name, f"{colour} cube", "box", (*xy, side / 2), (side,) * 3, yaw=yaw)


def square(xy, label="green square"):
    return named("g", label, "region", (*xy, 0.0005), (0.1, 0.1, 0.001))


RED, BLUE = block("r", "red", (0.3, 0.1)), block("b", "blue", (0.25, -0.2))
BASE = named("l", "gray lamp base", "plate", (0.35, -0.3, 0.005), (0.16, 0.08, 0.01))
BUTTON = named("k", "orange button", "disc", (0.31, -0.3, 0.017), (0.033, 0.033, 0.014), parent="l")
TRAY = named("t", "white tray", "plate", (0.45, 0.25, 0.01), (0.2, 0.15, 0.02))
ALL = (RED, BLUE, square((0.4, -0.1)), BASE, BUTTON, TRAY)


def plan(sentence: str, *objects, **more) -> Plan:
    return asked(sentence, *(objects or ALL), **more)[0]


def refusal(made: Plan) -> str:
    assert made.abstention is not None, made
    assert made.abstention.message
    return made.abstention.kind


# Pick and place


def test_pick_grasps_across_two_faces_and_lifts_25_cm():
    made = plan("lift the red cube")
    assert made.roles == {"theme": "r"}
    assert [w.stage for w in made.trajectory] == ["approach", "grasp", "close", "lift"]
    np.testing.assert_allclose(at(made, "grasp")[:2], RED.centre[:2], atol=1e-9)
    assert at(made, "lift")[2] - at(made, "grasp")[2] == pytest.approx(0.25)
    closing = made.trajectory.waypoints[0].orientation.closing
    assert np.abs(RED.world_from_object[:3, :3].T @ closing).max() == pytest.approx(1.0)
    last = made.trajectory.waypoints[-1]
    assert (last.carries, last.gripper, last.motion) == ("r", 0.0, "linear")


def test_pick_prefers_the_narrow_side_and_obeys_amounts():
    bar = named("a", "red box", "box", (0.35, 0.0, 0.02), (0.12, 0.03, 0.04), yaw=0.7)
    made = plan("lift the red box 10 cm", bar)
    assert at(made, "lift")[2] - at(made, "grasp")[2] == pytest.approx(0.10)
    closing = np.array(made.trajectory.waypoints[0].orientation.closing)
    assert abs(closing @ bar.world_from_object[:3, 1]) == pytest.approx(1.0)


def test_place_carries_over_and_lets_go_on_the_goal():
    made = plan("put the red cube on the tray")
    assert [w.stage for w in made.trajectory] == [
        "approach", "grasp", "close", "lift", "transit", "place", "release", "retreat",
    ]  # fmt: skip
    hangs = at(made, "grasp")[2] - RED.bottom
    np.testing.assert_allclose(at(made, "place")[:2], TRAY.centre[:2], atol=1e-9)
    assert at(made, "place")[2] - hangs == pytest.approx(TRAY.top + made.parameters["place_height"])


def tube(width, low, high, xy=(0.35, 0.1)) -> np.ndarray:
    """Points (N, 3) on the side of an upright cylinder; heights above the table."""
    rng = np.random.default_rng(0)
    angle, z = rng.uniform(0, 2 * np.pi, 1500), rng.uniform(low, high, 1500)
    side = 0.5 * width * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.column_stack([side + xy, z + TABLE])


def test_sides_are_those_of_who_faces_the_robot_and_a_goal_has_sides():
    seen = request(RED, BLUE, TRAY)
    seen = replace(seen, instruction="put the red cube to the left of the blue cube")
    facing = replace(seen, scene=replace(seen.scene, viewpoint="facing"))
    planner = SkillPlanner(SkillConfig())
    assert at(planner.plan(seen), "place")[1] > BLUE.centre[1] + 0.05
    assert at(planner.plan(facing), "place")[1] < BLUE.centre[1] - 0.05
    aside = planner.plan(replace(seen, instruction="put the red cube in the left half of the tray"))
    assert at(aside, "place")[:2] == pytest.approx(TRAY.centre[:2] + np.array([0.0, 0.0375]))


CUP = named("c", "red cup", "cylinder", (0.35, 0.1, 0.07), (0.095, 0.095, 0.14), opening=0.087,
            points=np.concatenate([tube(0.095, 0.0, 0.14), tube(0.087, 0.01, 0.14)]))  # fmt: skip
BOTTLE = named("b", "blue bottle", "other", (0.35, 0.1, 0.095), (0.09, 0.09, 0.19),
               points=np.concatenate([tube(0.09, 0.0, 0.12), tube(0.028, 0.12, 0.19)]))  # fmt: skip


def test_what_is_too_wide_is_taken_by_its_wall_or_its_neck_or_not_at_all():
    off = at(plan("lift the red cup", CUP), "close")[:2] - CUP.centre[:2]
    assert np.linalg.norm(off) == pytest.approx(0.5 * 0.091, abs=0.002)
    neck = plan("pick up the bottle", BOTTLE)
    assert at(neck, "close")[2] - HAND.tip_beyond_tcp > TABLE + 0.12
    flat = np.concatenate([tube(d, 0.139, 0.14) for d in np.linspace(0.002, 0.095, 24)])
    closed = replace(CUP, opening=0.0, points=np.concatenate([tube(0.095, 0.0, 0.14), flat]))
    assert refusal(plan("lift the red cup", closed)) == "too_wide"


def test_a_stick_in_something_is_drawn_out_along_itself_and_all_of_it():
    holder = named("k", "brown block", "box", (0.3, 0.1, 0.075), (0.04, 0.08, 0.15))
    lean = Rotation.from_euler("y", 0.1).as_matrix()
    grip = named("g", "red knife", "box", (0.305, 0.1, 0.192), (0.023, 0.015, 0.084), turn=lean)
    made = plan("pick up the red knife", holder, grip)
    drawn = at(made, "draw") - at(made, "close")
    np.testing.assert_allclose(drawn / np.linalg.norm(drawn), lean[:, 2], atol=1e-9)
    assert drawn[2] > 0.14
    on_top = named("q", "red cube", "box", (0.3, 0.1, 0.17), (0.04, 0.04, 0.04))
    stages = [w.stage for w in plan("pick up the red cube", holder, on_top).trajectory]
    assert "draw" not in stages


def test_an_object_is_lifted_with_its_parts():
    cap = named("n", "red nozzle", "cylinder", (0.35, 0.1, 0.115), (0.02, 0.02, 0.03), parent="m")
    body = named("m", "yellow bottle", "box", (0.35, 0.1, 0.05), (0.09, 0.06, 0.1))
    made = plan("pick up the yellow bottle", body, cap)
    assert at(made, "close")[2] + HAND.finger_length - HAND.tip_beyond_tcp > cap.top
    assert {"m", "n"} <= made.trajectory.waypoints[1].allowed_contacts


# Push and press


def shift(made: Plan, end: str) -> np.ndarray:
    """How far the strokes that begin like ``end`` move the object, (2,): the first ``standoff`` is before contact."""
    waypoints, moved = made.trajectory.waypoints, np.zeros(2)
    for before, after in pairwise(waypoints):
        if after.stage.startswith(end):
            stroke = np.subtract(after.xyz, before.xyz)[:2]
            assert after.motion == "linear"
            moved += stroke * (1 - made.parameters["standoff"] / np.linalg.norm(stroke))
    return moved


@pytest.mark.parametrize("yaw", [0.0, 0.3, 0.6, 1.2])
@pytest.mark.parametrize("side", [0.045, 0.0675])
def test_push_ends_with_the_block_on_the_goal(yaw, side):
    pushed, goal = block("r", "red", (0.28, 0.08), yaw, side), square((0.4, -0.1))
    made = plan("push the red cube onto the green square", pushed, goal)
    assert made.roles == {"theme": "r", "goal": "g"}
    np.testing.assert_allclose(pushed.centre[:2] + shift(made, "push"), goal.centre[:2], atol=1e-6)


@pytest.mark.parametrize(
    ("words", "way"),
    [("forward 12 cm", (0.12, 0)), ("to the left by 12 cm", (0, 0.12)), ("right", (0, -0.1))],
)
def test_push_in_a_direction_of_the_robot(words, way):
    made = plan(f"push the cube {words}", block("r", "red", (0.4, 0.0), 0.0))
    np.testing.assert_allclose(shift(made, "push"), way, atol=1e-6)


def test_push_goes_around_what_would_be_hit_or_says_so():
    wall = block("w", "blue", (0.35, 0.1), 0.0)
    made = plan(
        "push the red cube to the square", block("r", "red", (0.25, 0.1), 0.0), square((0.45, 0.1)), wall
    )
    assert any("'blue cube' is in the way" in c.description for c in made.candidates)


@pytest.mark.parametrize(
    "sentence", ["turn on the lamp", "press the orange button", "press the button of the lamp"]
)
def test_press_goes_straight_down_on_the_button_with_closed_fingers(sentence):
    made = plan(sentence)
    assert made.roles == {"theme": "k", "part": "k"}
    assert all(w.gripper == 0.0 for w in made.trajectory)
    np.testing.assert_allclose(at(made, "press")[:2], BUTTON.centre[:2])
    tip = at(made, "press")[2] - HAND.tip_beyond_tcp
    assert BUTTON.top - tip == pytest.approx(made.parameters["press_depth"])


@pytest.mark.parametrize(("height", "depth"), [(0.0092, 0.008), (0.014, 0.010)])
@pytest.mark.parametrize("effects", [(), (Prior("press_depth", 0.015, count=1000),)])
def test_press_stops_above_what_the_button_stands_on(height, depth, effects):
    button = named(
        "k", "orange button", "disc", (0.31, -0.3, 0.01 + height / 2), (0.033, 0.033, height), parent="l"
    )
    made = plan("press the button", BASE, button, effects=effects)
    assert at(made, "press")[2] - HAND.tip_beyond_tcp >= BASE.top + 0.001
    if not effects:
        assert made.parameters["press_depth"] == pytest.approx(depth)
    if made.parameters["press_depth"] < 0.010:
        assert any("stands out by" in note for note in made.notes)


# Caps, rings, lids, drawers, stuck objects


@pytest.mark.parametrize("sentence", ["open the jar", "unscrew the cap of the jar", "uncap the jar"])
def test_a_cap_is_turned_and_lifted(sentence):
    made = plan(sentence, *jar())
    assert (made.skill, made.roles["theme"]) == ("twist", "cap")
    assert made.trajectory.waypoints[-1].stage == "lift"
    poses = zip(made.trajectory.poses(np.eye(4)), made.trajectory, strict=True)
    turned = [pose[:3, :3] for pose, w in poses if w.stage in ("close", "turn")]
    steps = [Rotation.from_matrix(b @ a.T).as_rotvec()[2] for a, b in pairwise(turned)]
    assert sum(steps) == pytest.approx(made.parameters["turn"], abs=1e-6)  # against the clock


def test_a_cap_is_put_where_it_is_said():
    made = plan("take the cap off the jar and put it on the patch", *jar(), PATCH)
    assert made.skill == "twist"
    np.testing.assert_allclose(at(made, "release")[:2], PATCH.centre[:2], atol=1e-6)


def test_a_ring_goes_over_a_post_in_line_with_it():
    ring = named("r", "red ring", "ring", (0.35, -0.2, 0.005), (0.05, 0.05, 0.01), yaw=0.4, opening=0.03)
    post = named("p", "blue pillar", "box", (0.3, 0.15, 0.06), (0.025, 0.025, 0.12), yaw=0.1)
    made = plan("slip the ring over the blue pillar", ring, post)
    assert made.skill == "insert"
    np.testing.assert_allclose(at(made, "insert")[:2], post.centre[:2], atol=1e-6)
    poses = {w.stage: p for w, p in zip(made.trajectory, made.trajectory.poses(np.eye(4)), strict=True)}
    turn = Rotation.from_matrix(poses["insert"][:3, :3] @ poses["close"][:3, :3].T).as_rotvec()[2] + 0.3
    assert abs((turn + np.pi / 4) % (np.pi / 2) - np.pi / 4) < 1e-6


def test_a_nut_goes_over_the_peg_of_the_form_that_is_said():
    pegs = (
        named("s", "orange box", "box", (0.35, 0.2, 0.065), (0.032, 0.032, 0.13)),
        named("r", "silver bottle", "cylinder", (0.35, -0.2, 0.065), (0.04, 0.04, 0.13)),
    )
    ring = named("n", "orange ring", "ring", (0.25, 0.0, 0.01), (0.078, 0.07, 0.02), opening=0.046)
    made = plan("put the square nut on the square peg", ring, *pegs)
    assert (made.skill, made.roles["goal"]) == ("insert", "s")
    assert plan("put the nut on the round peg", ring, *pegs).roles["goal"] == "r"


@pytest.mark.parametrize(
    ("xy", "swung", "all_the_way"), [((0.1, 0.1), 109, True), ((0.12, -0.1), 104, False)]
)
def test_a_lid_is_swung_less_far_than_learned_only_where_the_arm_gets_no_further(xy, swung, all_the_way):
    made = plan("open the box", *box(0.0, xy), effects=[Bound("open_angle", 1.9, skill="open")])
    viable = [c.description for c in made.candidates if not c.rejected]
    assert f"open {swung}°" in viable[0]
    assert any("open 109°" in way for way in viable) == all_the_way


@pytest.mark.parametrize("sentence", ["open the box", "lift the lid of the box until it stays open"])
def test_opening_leads_the_lip_on_a_circle_about_the_hinge(sentence):
    objects = box(0.0)
    made, given_ = asked(sentence, *objects)
    assert made.skill == "open"
    hinge = hinge_for(objects[1], given_.scene)
    offsets = np.array([w.xyz for w in made.trajectory if w.stage == "swing"]) - hinge.origin
    radius = np.linalg.norm(offsets - np.outer(offsets @ hinge.axis, hinge.axis), axis=1)
    np.testing.assert_allclose(radius, 0.268 - made.parameters["lip_depth"], atol=1e-6)
    assert offsets[-1] @ hinge.level < 0  # past the vertical
    assert made.trajectory.waypoints[-1].carries == ""


@pytest.mark.parametrize("sentence", ["shut the lid of the box", "put the lid on the box"])
def test_closing_comes_from_behind_the_free_edge_and_lets_go_over_the_box(sentence):
    objects = box(2.618)
    made = plan(sentence, *objects)
    assert made.skill == "close"
    way = [w.xyz[0] for w in made.trajectory if w.stage == "draw over"]
    assert way[0] > objects[1].centre[0] > way[-1]
    assert all(w.gripper == 0.0 for w in made.trajectory)


@pytest.mark.parametrize(("xy", "least"), [((0.30, 0.15), 0.15), ((0.14, -0.1), 0.10)])
def test_a_drawer_is_pulled_along_its_own_normal_less_far_near_the_arm(xy, least):
    objects = drawer(xy)
    assert slide_for(objects[0], request(*objects).scene).handle.id == "bar"
    for sentence in ("open the drawer", "slide the drawer out of the cabinet", "pull the bar"):
        made = plan(sentence, *objects)
        assert made.skill == "pull"
        drawn = at(made, "pull") - at(made, "close")
        np.testing.assert_allclose(drawn[1:], 0.0, atol=1e-9)
        assert least - 1e-9 <= -drawn[0] <= made.parameters["pull_distance"] + 1e-9


def test_a_brick_between_bricks_is_drawn_out_by_its_free_end():
    made, given_ = asked("pull the brick out and put it on the patch", *stuck_brick(), PATCH)
    held = stuck(given_.scene["brick"], given_.scene)
    np.testing.assert_allclose(held.way, [0.0, 1.0, 0.0], atol=1e-6)
    assert held.exposed == pytest.approx(0.06, abs=0.006)
    assert made.skill == "draw"
    drawn = at(made, "pull") - at(made, "close")
    np.testing.assert_allclose(drawn[[0, 2]], 0.0, atol=1e-9)
    assert drawn[1] >= held.hidden


# Sorting


BINS = tuple(
    named(f"{colour}_bin", f"{colour} bin", "box", (*xy, 0.025), (0.17, 0.17, 0.05), opening=0.158)
    for colour, xy in (("red", (0.25, 0.3)), ("blue", (0.25, -0.3)))
)
LOOSE = (
    named("a", "red cube", "box", (0.3, 0.0, 0.0225), (0.045,) * 3),
    named("b", "blue can", "cylinder", (0.4, 0.1, 0.035), (0.045, 0.045, 0.07)),
    named("c", "red bar", "box", (0.4, -0.1, 0.02), (0.035, 0.07, 0.04)),
)


def test_sorting_is_one_trajectory_that_ends_in_the_bins():
    made = plan("put every object into the bin that has its colour", *BINS, *LOOSE)
    released = [np.array(w.xyz[:2]) for w in made.trajectory if w.stage == "release"]
    for place, goal in zip(released, (BINS[0], BINS[1], BINS[0]), strict=True):
        assert np.abs(place - goal.centre[:2]).max() < 0.05


def test_the_hand_lets_go_in_a_container_no_wider_than_it_must():
    def widths(sentence, goal):
        made = plan(sentence, RED, goal)
        both = (next(w for w in made.trajectory if w.stage == stage) for stage in ("approach", "release"))
        return [w.gripper * HAND.max_width for w in both]

    taken, let_go = widths("put the red cube in the red bin", BINS[0])
    assert 0.05 < let_go < min(taken, 0.07)
    taken, let_go = widths("put the red cube on the tray", TRAY)
    assert let_go == taken


def test_what_stands_on_something_hidden_is_found_by_standing_above_the_table():
    high = named("h", "red cube", "box", (0.4, 0.15, 0.2), (0.05,) * 3)
    sentence = "pick up the red cube on the cabinet"
    assert plan(sentence, RED, high).roles["theme"] == "h"
    carrier = named("s", "gray box", "box", (0.4, 0.15, 0.0875), (0.12, 0.12, 0.175))
    assert refusal(plan(sentence, RED, high, carrier)) == "nothing_matches"  # it stands on what is seen
    second = named("i", "red cube", "box", (0.3, -0.15, 0.2), (0.05,) * 3)
    assert refusal(plan(sentence, RED, high, second)) == "nothing_matches"
    assert refusal(plan("pick up the red cube in the cabinet", RED, high)) == "nothing_matches"


# Memory, rejections, refusals


def test_memory_bounds_and_priors_change_theta_and_the_motion():
    bound = Bound("lift_height", 0.35, ">=", skill="pick", source="r1")
    prior = Prior("standoff", 0.1, count=1000, source="r2")
    plain, taught = plan("lift the red cube"), plan("lift the red cube", effects=[bound, prior])
    assert at(taught, "lift")[2] - at(plain, "lift")[2] == pytest.approx(0.10)
    assert at(taught, "approach")[2] > at(plain, "approach")[2] + 0.04
    assert all(any(source in note for note in taught.notes) for source in ("r1", "r2"))


def test_a_forbidden_approach_is_not_used():
    pushing = ("push the red cube onto the square", block("r", "red", (0.28, 0.08), 0.3), square((0.4, -0.1)))
    plain = plan(*pushing)
    taught = plan(*pushing, effects=[Ban("approach:straight", skill="push", source="r3")])
    assert [w.stage for w in plain.trajectory] != [w.stage for w in taught.trajectory]
    assert any("r3" in c.rejected for c in taught.candidates)
    assert refusal(plan("turn on the lamp", effects=[Ban("approach:top", skill="press")])) == "other"


def test_a_second_try_after_a_rejection_is_another_way():
    first = plan("lift the red cube")
    second = plan("lift the red cube", rejections=("The hand hits the wall.",))
    assert first.trajectory != second.trajectory
    assert any("hits the wall" in c.rejected for c in second.candidates)


@pytest.mark.parametrize(
    ("sentence", "kind"),
    [
        ("juggle the red cube", "unknown_skill"),
        ("open the tray", "unknown_skill"),
        ("", "unknown_skill"),
        ("pick up the banana", "nothing_matches"),
        ("pick up the cube", "ambiguous"),
        ("pick up the table", "nothing_matches"),
        ("push the red cube", "no_goal"),
        ("put the red cube down", "no_goal"),
        ("push the red cube to the moon", "nothing_matches"),
        ("press the red cube", "nothing_matches"),
        ("pick up the white tray", "too_wide"),
        ("pick up the red cube and press the button", "other"),
        ("put the red cube on the red cube", "other"),
        ("put the red cube 10 cm to the right of the blue cube", "other"),
        ("pull the red cube", "unknown_skill"),
        ("push the red cube forward 90 cm", "unreachable"),
    ],
)
def test_each_kind_of_abstention(sentence, kind):
    assert refusal(plan(sentence)) == kind


@pytest.mark.parametrize(
    "said", ["-5 cm", "by −5 cm", "minus five cm", "1/2 cm", "5 - 10 cm", "1,5 cm", "10"]
)
def test_a_length_that_is_negative_or_no_single_number_is_declined(said):
    assert refusal(plan(f"lift the red cube {said}")) in ("other", "nothing_matches")


@settings(max_examples=8, deadline=None)
@given(
    yaw=st.floats(-0.6, 0.6),
    skill=st.sampled_from(["pick up the red cube", "push the red cube to the square"]),
)
def test_turning_the_scene_about_the_base_turns_the_plan(yaw, skill):
    foot = np.array([*SapienPandaConfig().base_position[:2], 0.0])
    spun = Rotation.from_euler("z", yaw).as_matrix()
    turn = rigid(translation=foot) @ rigid(spun) @ rigid(translation=-foot)
    objects = (block("r", "red", (0.25, 0.05), 0.3), square((0.35, -0.1)))
    turned = tuple(replace(o, world_from_object=turn @ o.world_from_object) for o in objects)
    plain, other = plan(skill, *objects), plan(skill, *turned)
    # The same grasp or stroke may be done by the hand turned round, which leaves the positions alone.
    expected = transform_points(turn, plain.trajectory.xyzg()[:, :3])
    np.testing.assert_allclose(other.trajectory.xyzg()[:, :3], expected, atol=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.text(max_size=40))
def test_no_sentence_raises(text):
    made = plan(text)
    assert made.abstention is None or made.abstention.kind
