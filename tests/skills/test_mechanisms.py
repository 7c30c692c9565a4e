"""Hinges, and how far a lid is open; doors and their handles; stuck bricks; whether a lamp shines."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, PartJoint, Scene, SceneObject
from gvla2.skills.mechanisms import hinge_for, opening_angle, shines, stuck
from tests.skills.scenes import TABLE, asked, at, box, make_object, named, request


def lid(angle: float, yaw: float = 0.0, scale: float = 1.0) -> tuple[SceneObject, SceneObject]:
    """A lid open by ``angle`` and its box, all turned by ``yaw``; the hinge is at the box's +x side."""
    turned = Rotation.from_euler("z", yaw).as_matrix()
    swung = Rotation.from_euler("y", angle).as_matrix()
    size, reach = np.array([0.25, 0.35, 0.15]) * scale, 0.268 * scale
    hinge = np.array([0.5 * size[0], 0.0, size[2] + 0.005])
    centre = hinge - 0.5 * reach * swung[:, 0]
    pose = rigid(turned @ swung, turned @ centre)
    box = SceneObject("b", "box", "box", "", rigid(turned, (0, 0, 0.5 * size[2])), size, np.zeros((0, 3)))
    plate = SceneObject(
        "l", "lid", "plate", "", pose, np.array([reach, size[1], 0.01]), np.zeros((0, 3)), parent="b"
    )
    return plate, box


@given(st.floats(0.2, 2.6), st.floats(-3.1, 3.1), st.floats(0.8, 1.2))
def test_the_angle_is_the_one_it_was_swung_by(angle, yaw, scale):
    assert opening_angle(*lid(angle, yaw, scale)) == pytest.approx(angle, abs=1e-6)


def test_flat_is_closed_and_without_a_box_nothing_leans_away():
    plate, box = lid(0.05)
    assert opening_angle(plate, box) == 0.0
    assert opening_angle(lid(2.0)[0], None) == pytest.approx(np.pi - 2.0)


@pytest.mark.parametrize("angle", [0.0, 0.9, 2.0, 2.6])
def test_the_hinge_is_found_from_how_the_lid_lies(angle):
    body, lid = box(angle)
    hinge = hinge_for(body, request(body, lid).scene)
    assert hinge.angle == pytest.approx(angle, abs=1e-6)
    np.testing.assert_allclose(hinge.level, [-1.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(hinge.origin[0], body.centre[0] + 0.125, atol=1e-6)
    assert not hinge.guessed


def test_a_lid_flush_all_around_is_taken_to_open_towards_the_robot():
    body, _ = box(0.0)
    flush = named("l", "white lid", "plate", (0.12, -0.1, 0.155), (0.25, 0.35, 0.01), parent="box")
    hinge = hinge_for(flush, request(body, flush).scene)
    assert hinge.guessed
    np.testing.assert_allclose(hinge.level, [-1.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("into", [0.0, 0.018])
def test_of_a_brick_in_a_tower_seen_as_one_the_rest_is_taken_to_be_inside(into):
    whole = named("t", "white tower", "box", (0.12, -0.1, 0.0825), (0.2, 0.2, 0.165))
    end = named("k", "red brick", "box", (0.12, 0.03 - into, 0.114), (0.06, 0.06, 0.03))
    held = stuck(end, request(whole, end).scene)
    np.testing.assert_allclose(held.way, [0.0, 1.0, 0.0], atol=1e-6)
    assert held.hidden == pytest.approx(0.2)
    assert held.theme.extents[1] == pytest.approx(0.16)


def part(id_: str, label: str, x: float, grey: float, parent: str = "base") -> SceneObject:
    pose = rigid(translation=(x, 0.0, 0.8))
    rgb = np.full(3, grey)
    return SceneObject(id_, label, "box", "gray", pose, np.full(3, 0.03), np.zeros((0, 3)), rgb, parent)


def lamp(shade: float, label: str = "gray lamp shade") -> Scene:
    objects = (
        part("base", "black lamp base", 0.0, 0.15, ""), part("shade", label, 0.1, shade),
        part("button", "red button", -0.1, 0.4),
    )  # fmt: skip
    return Scene(objects, 0.75, Box(-np.ones(3), np.ones(3)))


def test_a_lamp_that_got_brighter_shines():
    dark = lamp(0.27)
    assert shines(dark["button"], dark, lamp(0.85)) is True
    assert shines(dark["button"], dark, lamp(0.30)) is False
    assert shines(dark["button"], dark, lamp(0.85, "white cylinder")) is True, "whatever it is called then"


def test_without_a_lamp_it_is_unknown():
    dark, lit = lamp(0.27), lamp(0.85)
    lone = part("bell", "red button", 0.0, 0.4, "")
    assert shines(lone, Scene((lone,), 0.75, dark.workspace), lit) is None
    assert shines(dark["button"], dark, Scene((), 0.75, dark.workspace)) is None, "it was not seen again"


def door(lever: bool) -> tuple[SceneObject, SceneObject]:
    """A door across the robot's way, hinged at its right; its handle is a lever, or a bar that is held at both ends."""
    panel = make_object("door", "box", (0.5, 0.0, 0.3), (0.03, 0.4, 0.6), label="gray door")
    rng = np.random.default_rng(0)
    middle = np.array([0.42, 0.09, TABLE + 0.3])
    bar = middle + rng.uniform(-0.5, 0.5, (400, 3)) * [0.02, 0.14, 0.02]
    ends = [0.065] if lever else [0.065, -0.065]
    feet = [middle + [0.035, y, 0.0] + rng.uniform(-0.5, 0.5, (60, 3)) * [0.06, 0.015, 0.02] for y in ends]
    points = np.concatenate([bar, *feet])
    size = (0.08, 0.14, 0.02)
    handle = make_object("grip", "box", (0.45, 0.09, 0.3), size, parent="door", points=points, label="handle")
    return panel, handle


@pytest.mark.parametrize("lever", [True, False])
def test_a_door_turns_about_its_edge_far_from_the_handle_after_a_lever_went_down(lever):
    made, _ = asked("open the door", *door(lever))
    ways = {
        stage: np.array([w.xyz for w in made.trajectory if w.stage == stage]) for stage in ("turn", "swing")
    }
    assert (len(ways["turn"]) > 0) == lever
    start = ways["turn"][-1] if lever else at(made, "close")
    hinge = np.array([0.5, -0.2])
    for xyz in ways["swing"]:  # towards the robot, on a circle
        np.testing.assert_allclose(
            np.linalg.norm(xyz[:2] - hinge), np.linalg.norm(start[:2] - hinge), atol=1e-6
        )
        assert xyz[0] < start[0]
    assert not lever or start[2] < at(made, "close")[2] - 0.05


def test_a_known_door_is_pushed_shut_from_outside_at_its_free_edge():
    joint = PartJoint(False, np.array([0.0, 0.0, 1.0]), np.array([0.5, -0.2, TABLE + 0.2]), 1.0, 1.6)
    case = make_object("case", "box", (0.6, 0.0, 0.15), (0.2, 0.4, 0.3), label="microwave")
    along = Rotation.from_euler("z", 1.0).apply([0.0, 1.0, 0.0])
    rng = np.random.default_rng(0)
    points = (
        joint.origin + rng.uniform(0, 0.36, (300, 1)) * along + rng.uniform(-0.1, 0.1, (300, 1)) * [0, 0, 1]
    )
    middle = joint.origin + 0.18 * along - [0, 0, TABLE]
    panel = make_object(
        "panel", "box", middle, (0.02, 0.36, 0.2), yaw=1.0, parent="case", points=points, label="door"
    )
    made, _ = asked("close the microwave", case, replace(panel, joint=joint))
    pushed = [np.array(w.xyz) for w in made.trajectory if w.stage == "push"]
    assert made.skill == "close"
    assert pushed[-1][1] > pushed[0][1]  # back in front of the case, whose face is at x = 0.5
    assert abs(pushed[-1][0] - 0.5) < 0.1
