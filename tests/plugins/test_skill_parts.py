"""Holds of parts, caps, holes, sticks, and several objects at once."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.arm import Hand
from gvla2.planning.checks import check_trajectory
from gvla2.planning.checks_motion import part_fits
from gvla2.planning.contracts import Abstention, Advice, Plan, PlanRequest
from gvla2.planning.part_hierarchy import assembled, rise, way_out
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.trajectory import MAX_WAYPOINTS, grasp_rotation
from gvla2.robot.workcell import make_cell
from gvla2.skills.grasps import DEFAULT, holds
from gvla2.testing import inputs
from gvla2_plugins.sapien import SapienPandaConfig
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.planner import SentenceReading, SkillPlanner, read

PANDA_HAND = Hand(**SapienPandaConfig().hand)

TABLE = 0.752
PLANNER = SkillPlanner(SkillConfig())


@pytest.fixture(scope="module")
def arm():
    return make_cell(SapienPandaConfig()).arm


def scene_object(
    name, label, shape, xy, size, base=0.0, yaw=0.0, parent="", opening=0.0, points=None
) -> SceneObject:
    extents = np.array(size, dtype=float)
    pose = rigid(Rotation.from_euler("z", yaw).as_matrix(), (*xy, TABLE + base + extents[2] / 2))
    seen = np.zeros((0, 3)) if points is None else points
    return SceneObject(
        name, label, shape, label.split()[0], pose, extents, seen, parent=parent, opening=opening
    )


def tube(xy, width, low, high, count=1500) -> np.ndarray:
    """Points (N, 3) on the side of an upright cylinder; heights above the table."""
    rng = np.random.default_rng(0)
    angle, z = rng.uniform(0, 2 * np.pi, count), rng.uniform(low, high, count)
    side = 0.5 * width * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.column_stack([side + xy, z + TABLE])


def plan(arm, sentence: str, *objects: SceneObject) -> Plan:
    scene = Scene(objects, TABLE, arm.workspace)
    start = arm.forward(arm.home)
    seen = replace(inputs.observation(16), world_from_tcp=start, joints=arm.home)
    made = PLANNER.plan(PlanRequest(sentence, scene, arm, start, arm.home, seen, Advice()))
    if made.trajectory is not None:
        report = check_trajectory(
            made.trajectory, scene, arm, start, arm.home, parameters=made.parameters, skill=made.skill
        )
        assert report.passed, report.reasons
        assert len(made.trajectory) <= MAX_WAYPOINTS
    return made


def stages(made: Plan) -> list[str]:
    assert made.trajectory is not None, made.abstention
    return [w.stage for w in made.trajectory]


def at(made: Plan, stage: str) -> np.ndarray:
    assert made.trajectory is not None, made.abstention
    return np.array(next(w.xyz for w in made.trajectory if w.stage == stage))


CUP_POINTS = np.concatenate([tube((0.35, 0.1), 0.095, 0.0, 0.14), tube((0.35, 0.1), 0.087, 0.01, 0.14)])
CUP = scene_object(
    "c", "red cup", "cylinder", (0.35, 0.1), (0.095, 0.095, 0.14), opening=0.087, points=CUP_POINTS
)
BOTTLE_XY = (0.35, 0.1)
BOTTLE_POINTS = np.concatenate([tube(BOTTLE_XY, 0.09, 0.0, 0.12), tube(BOTTLE_XY, 0.028, 0.12, 0.19)])
BOTTLE = scene_object("b", "blue bottle", "other", BOTTLE_XY, (0.09, 0.09, 0.19), points=BOTTLE_POINTS)


def test_what_is_too_wide_is_taken_by_its_wall(arm):
    made = plan(arm, "lift the red cup", CUP)
    off = at(made, "close")[:2] - CUP.centre[:2]
    assert np.linalg.norm(off) == pytest.approx(0.5 * 0.091, abs=0.002)
    # Nothing but its outside and a flat top is seen: no wall to hold.
    flat = np.concatenate([tube((0.35, 0.1), d, 0.139, 0.14) for d in np.linspace(0.002, 0.095, 24)])
    points = np.concatenate([tube((0.35, 0.1), 0.095, 0.0, 0.14), flat])
    closed = plan(arm, "lift the red cup", replace(CUP, opening=0.0, points=points))
    assert closed.abstention is not None
    assert closed.abstention.kind == "too_wide"


def test_the_slim_top_of_what_is_too_wide_is_held(arm):
    found = holds(BOTTLE, PANDA_HAND, DEFAULT)
    assert {h.part for h in found} == {"top"}
    assert all(0.02 < h.width < 0.032 and h.width + DEFAULT.clearance <= PANDA_HAND.max_width for h in found)
    made = plan(arm, "pick up the bottle", BOTTLE)
    assert at(made, "close")[2] - PANDA_HAND.tip_beyond_tcp > TABLE + 0.12


def test_the_check_of_the_width_looks_at_what_is_between_the_fingers():
    pose = rigid(grasp_rotation(np.array([0, 0, -1.0]), np.array([0, 1.0, 0])), (*BOTTLE_XY, TABLE + 0.16))
    assert part_fits(BOTTLE, pose, 0.08, PANDA_HAND)
    low = rigid(translation=(0, 0, -0.08)) @ pose
    assert not part_fits(BOTTLE, low, 0.08, PANDA_HAND)  # the fingers would come down on its sides
    assert not part_fits(replace(BOTTLE, points=np.zeros((0, 3))), pose, 0.08, PANDA_HAND)


JAR = scene_object("j", "green jar", "cylinder", (0.35, -0.1), (0.066, 0.066, 0.12))
LID = scene_object("l", "gray lid", "disc", (0.35, -0.1), (0.074, 0.074, 0.021), base=0.12, parent="j")
SQUARE = scene_object("s", "red square", "region", (0.3, 0.2), (0.1, 0.1, 0.001))


@pytest.mark.parametrize(
    "sentence",
    ["open the green jar", "unscrew the lid of the green jar", "twist the lid off the jar", "uncap the jar"],
)
def test_a_cap_is_turned_and_lifted(arm, sentence):
    made = plan(arm, sentence, JAR, LID, SQUARE)
    assert made.skill == "twist"
    assert made.roles["theme"] == "l"
    assert stages(made)[-1] == "lift"
    poses = made.trajectory.poses(np.eye(4))
    turned = [p[:3, :3] for p, w in zip(poses, made.trajectory, strict=True) if w.stage in ("close", "turn")]
    steps = [Rotation.from_matrix(b @ a.T).as_rotvec() for a, b in pairwise(turned)]
    assert sum(s[2] for s in steps) == pytest.approx(made.parameters["turn"], abs=1e-6)  # against the clock


def test_a_cap_is_put_where_it_is_said(arm):
    made = plan(arm, "take the lid off the green jar and put it on the red square", JAR, LID, SQUARE)
    assert made.skill == "twist"
    np.testing.assert_allclose(at(made, "release")[:2], SQUARE.centre[:2], atol=1e-6)


RING = scene_object("r", "red ring", "ring", (0.35, -0.2), (0.05, 0.05, 0.01), yaw=0.4, opening=0.03)
POST = scene_object("p", "blue pillar", "box", (0.3, 0.15), (0.025, 0.025, 0.12), yaw=0.1)


@pytest.mark.parametrize(
    "sentence", ["put the ring on the blue pillar", "slip the ring over the blue pillar"]
)
def test_a_ring_goes_over_a_post_in_line_with_it(arm, sentence):
    made = plan(arm, sentence, RING, POST)
    assert made.skill == "insert"
    np.testing.assert_allclose(at(made, "insert")[:2], POST.centre[:2], atol=1e-6)
    poses = {w.stage: p for w, p in zip(made.trajectory, made.trajectory.poses(np.eye(4)), strict=True)}
    turn = Rotation.from_matrix(poses["insert"][:3, :3] @ poses["close"][:3, :3].T).as_rotvec()[2]
    assert (turn + 0.3) % (np.pi / 2) == pytest.approx(0.0, abs=1e-6) or (turn + 0.3) % (
        np.pi / 2
    ) == pytest.approx(np.pi / 2, abs=1e-6)


def test_a_stick_in_something_is_drawn_out_along_itself_and_all_of_it():
    block = scene_object("k", "brown block", "box", (0.3, 0.1), (0.04, 0.08, 0.15))
    lean = Rotation.from_euler("y", 0.1).as_matrix()
    grip = scene_object("g", "red knife", "box", (0.305, 0.1), (0.023, 0.015, 0.084), base=0.15)
    grip = replace(grip, world_from_object=rigid(lean, grip.centre))
    scene = Scene((block, grip), TABLE, Box(np.full(3, -1.0), np.full(3, 2.0)))
    full = assembled(grip, scene)
    assert full.bottom < TABLE + 0.02
    assert full.top == pytest.approx(grip.top)
    assert rise(full, scene) > 0.14
    np.testing.assert_allclose(way_out(full, scene), lean[:, 2], atol=1e-9)
    cube = scene_object("q", "red cube", "box", (0.3, 0.1), (0.04, 0.04, 0.04), base=0.15)
    assert assembled(cube, Scene((block, cube), TABLE, scene.workspace)) is cube


def test_an_object_is_lifted_with_its_parts(arm):
    cap = scene_object("n", "red nozzle", "cylinder", (0.35, 0.1), (0.02, 0.02, 0.03), base=0.1, parent="m")
    body = scene_object("m", "yellow bottle", "box", (0.35, 0.1), (0.09, 0.06, 0.1))
    made = plan(arm, "pick up the yellow bottle", body, cap)
    assert at(made, "close")[2] + PANDA_HAND.finger_length - PANDA_HAND.tip_beyond_tcp > cap.top
    assert {"m", "n"} <= made.trajectory.waypoints[1].allowed_contacts


BINS = tuple(
    scene_object(f"{colour}_bin", f"{colour} bin", "box", xy, (0.17, 0.17, 0.05), opening=0.158)
    for colour, xy in (("red", (0.25, 0.3)), ("blue", (0.25, -0.3)))
)
LOOSE = (
    scene_object("a", "red cube", "box", (0.3, 0.0), (0.045,) * 3),
    scene_object("b", "blue can", "cylinder", (0.4, 0.1), (0.045, 0.045, 0.07)),
    scene_object("c", "red bar", "box", (0.4, -0.1), (0.035, 0.07, 0.04)),
)
RIGHT = {"a": "red_bin", "b": "blue_bin", "c": "red_bin"}


def goals(sentence: str, scene: Scene) -> dict[str, str]:
    found = read(sentence, scene)
    assert isinstance(found, SentenceReading), found
    assert all((call.skill, call.relation) == ("place", "in") for call in found.calls)
    return {call.theme: call.goal for call in found.calls}


@pytest.mark.parametrize(
    ("sentence", "right"),
    [
        ("sort the objects into the bins of the same colour", RIGHT),
        ("put every object into the bin that has its colour", RIGHT),
        ("put the red things in the red bin and the blue things in the blue bin", RIGHT),
        ("sort the red and blue objects into the bins of their own colour", RIGHT),
        ("place each object in the box of matching colour", RIGHT),
        ("sort everything by color", RIGHT),
        ("put all the red things into the blue bin", {"a": "blue_bin", "c": "blue_bin"}),
    ],
)
def test_which_object_goes_where(arm, sentence, right):
    assert goals(sentence, Scene((*BINS, *LOOSE), TABLE, arm.workspace)) == right


def test_a_flat_bin_may_be_called_a_tray(arm):
    trays = tuple(replace(each, label=each.label.replace("bin", "tray")) for each in BINS)
    scene = Scene((*trays, *LOOSE), TABLE, arm.workspace)
    sentence = "put the red things in the red bin and the blue things in the blue bin"
    assert goals(sentence, scene) == RIGHT
    assert isinstance(read(sentence.replace("blue bin", "green bin"), scene), Abstention)


def test_sorting_is_one_trajectory_that_ends_in_the_bins(arm):
    made = plan(arm, "put every object into the bin that has its colour", *BINS, *LOOSE)
    assert stages(made).count("release") == 3
    for waypoint, object_id in zip((w for w in made.trajectory if w.stage == "release"), RIGHT, strict=True):
        goal = next(b for b in BINS if b.id == RIGHT[object_id])
        assert np.abs(np.array(waypoint.xyz[:2]) - goal.centre[:2]).max() < 0.05
