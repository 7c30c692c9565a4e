"""Lids, drawers and objects that are stuck: what the scene shows of them, and the motions that follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Advice, Plan, PlanRequest
from gvla2.planning.effects import Bound
from gvla2.planning.scene import Scene, SceneObject
from gvla2.robot.workcell import make_cell
from gvla2.skills.mechanisms import hinge_for, slide_for, stuck
from gvla2.testing import inputs
from gvla2_plugins.sapien import SapienPandaConfig
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.planner import SkillPlanner

TABLE = 0.752
PLANNER = SkillPlanner(SkillConfig())
BACK = np.array([1.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def arm():
    return make_cell(SapienPandaConfig()).arm


def scene_object(name, label, shape, xyz, size, turn=None, parent="") -> SceneObject:
    rotation = np.eye(3) if turn is None else turn
    pose = rigid(rotation, (xyz[0], xyz[1], TABLE + xyz[2]))
    extents = np.array(size, dtype=float)
    return SceneObject(name, label, shape, label.split()[0], pose, extents, np.zeros((0, 3)), parent=parent)


def box(angle: float, scale: float = 1.0, xy=(0.12, -0.1)) -> tuple[SceneObject, SceneObject]:
    """A box with its hinge at +x, open by ``angle``."""
    size = np.array([0.25, 0.35, 0.15]) * scale
    reach = 0.268 * scale
    hinge = np.array([xy[0] + size[0] / 2, xy[1], size[2] + 0.005])
    turn = Rotation.from_euler("y", angle).as_matrix()
    centre = hinge - turn[:, 0] * reach / 2
    body = scene_object("b", "lime box", "box", (*xy, size[2] / 2), size)
    return body, scene_object("l", "white lid", "plate", centre, (reach, size[1], 0.01), turn, "b")


def drawer(xy=(0.30, 0.15)) -> tuple[SceneObject, ...]:
    return (
        scene_object("c", "azure cabinet", "box", (*xy, 0.08), (0.24, 0.28, 0.16)),
        scene_object(
            "d", "lime drawer", "box", (xy[0] - 0.114, xy[1], 0.08), (0.012, 0.248, 0.128), parent="c"
        ),
        scene_object(
            "h", "gray handle", "bar", (xy[0] - 0.16, xy[1], 0.125), (0.012, 0.11, 0.012), parent="d"
        ),
    )


def tower() -> tuple[SceneObject, ...]:
    side = Rotation.from_euler("z", np.pi / 2).as_matrix()
    bricks = []
    for layer in range(5):
        for slot in range(3):
            if (layer, slot) == (3, 1):
                continue
            across = (slot - 1) * 0.067
            at = (0.12 + across, -0.1) if layer % 2 else (0.12, -0.1 + across)
            bricks.append(
                scene_object(
                    f"w{layer}{slot}", "white brick", "box", (*at, (layer + 0.5) * 0.033), (0.2, 0.067, 0.033),
                    side if layer % 2 else None,
                )
            )  # fmt: skip
    loose = scene_object("k", "red brick", "box", (0.12, -0.03, 0.114), (0.18, 0.06, 0.03), side)
    circle = scene_object("g", "blue circle", "region", (0.36, 0.12, 0.0005), (0.1, 0.1, 0.001))
    return (*bricks, loose, circle)


def plan(arm, sentence: str, *objects: SceneObject) -> tuple[Plan, PlanRequest]:
    scene = Scene(objects, TABLE, arm.workspace)
    seen = replace(inputs.observation(16), world_from_tcp=arm.forward(arm.home), joints=arm.home)
    asked = PlanRequest(sentence, scene, arm, arm.forward(arm.home), arm.home, seen)
    return PLANNER.plan(asked), asked


def sound(made: Plan, asked: PlanRequest) -> bool:
    assert made.trajectory is not None, made.abstention
    return check_trajectory(made.trajectory, asked.scene, asked.arm, asked.start, asked.joints).passed


@pytest.mark.parametrize("angle", [0.0, 0.9, 2.0, 2.6])
@pytest.mark.parametrize("scale", [0.8, 1.0, 1.2])
def test_the_hinge_is_found_from_how_the_lid_lies(arm, angle, scale):
    objects = box(angle, scale)
    hinge = hinge_for(objects[0], Scene(objects, TABLE, arm.workspace))
    assert hinge.angle == pytest.approx(angle, abs=1e-6)
    np.testing.assert_allclose(hinge.level, -BACK, atol=1e-6)
    np.testing.assert_allclose(hinge.origin[0], objects[0].centre[0] + 0.125 * scale, atol=1e-6)
    assert not hinge.guessed


def test_a_lid_flush_all_around_is_taken_to_open_towards_the_robot(arm):
    body, lid = box(0.0)
    flush = replace(
        lid, extents=np.array([0.25, 0.35, 0.01]), world_from_object=body.world_from_object.copy()
    )
    flush.world_from_object[2, 3] = TABLE + 0.155
    hinge = hinge_for(flush, Scene((body, flush), TABLE, arm.workspace))
    assert hinge.guessed
    np.testing.assert_allclose(hinge.level, -BACK, atol=1e-6)


@pytest.mark.parametrize(
    ("xy", "swung", "all_the_way"), [((0.1, 0.1), 109, True), ((0.12, -0.1), 104, False)]
)
def test_a_lid_is_swung_less_far_than_learnt_only_where_the_arm_gets_no_further(arm, xy, swung, all_the_way):
    _, asked = plan(arm, "open the box", *box(0.0, 1.0, xy))
    taught = Advice(effects=(Bound("open_angle", 1.9, skill="open"),))
    made = PLANNER.plan(replace(asked, advice=taught))
    assert sound(made, asked)
    viable = [c.description for c in made.candidates if not c.rejected]
    assert f"open {swung}°" in viable[0]
    assert any("open 109°" in way for way in viable) == all_the_way


@pytest.mark.parametrize("sentence", ["open the box", "lift the lid of the box until it stays open"])
def test_opening_leads_the_lip_on_a_circle_about_the_hinge(arm, sentence):
    objects = box(0.0)
    made, asked = plan(arm, sentence, *objects)
    assert made.skill == "open"
    assert sound(made, asked)
    hinge = hinge_for(objects[1], asked.scene)
    swing = [w for w in made.trajectory if w.stage == "swing"]
    offsets = np.array([w.xyz for w in swing]) - hinge.origin
    radius = np.linalg.norm(offsets - np.outer(offsets @ hinge.axis, hinge.axis), axis=1)
    np.testing.assert_allclose(radius, 0.268 - made.parameters["lip_depth"], atol=1e-6)
    assert offsets[-1] @ hinge.level < 0  # past the vertical
    assert made.trajectory.waypoints[-1].carries == ""


def test_closing_comes_from_behind_the_free_edge_and_lets_go_over_the_box(arm):
    objects = box(2.618)
    made, asked = plan(arm, "shut the lid of the lime box", *objects)
    assert made.skill == "close"
    assert sound(made, asked)
    way = [w.xyz[0] for w in made.trajectory if w.stage == "draw over"]
    assert way[0] > objects[1].centre[0] > way[-1]
    assert all(w.gripper == 0.0 for w in made.trajectory)


def test_a_hinged_lid_that_is_put_on_its_box_is_closed(arm):
    made, asked = plan(arm, "put the lid on the box", *box(2.618))
    assert made.skill == "close"
    assert sound(made, asked)


def test_a_lid_whose_edge_is_out_of_reach_is_pushed_from_beside(arm):
    made, asked = plan(arm, "close the box", *box(2.618, 1.2, (0.10, 0.20)))
    assert sound(made, asked)
    hinge = hinge_for(asked.scene.objects[1], asked.scene)
    pushes = np.array([w.xyz for w in made.trajectory if w.stage == "push over"])
    assert len(pushes) > 3
    off = pushes - hinge.origin
    assert (np.abs(off @ hinge.axis) < 0.5 * hinge.breadth).all()  # behind the lid, not beside it
    out = [np.array([o @ hinge.level, o[2]]) for o in off - np.outer(off @ hinge.axis, hinge.axis)]
    turned = np.unwrap([np.arctan2(o[1], o[0]) for o in out])
    assert (np.diff(turned) < 0).all()
    assert turned[-1] < 0.5 * np.pi


def test_a_drawer_near_the_arm_is_pulled_from_beside_or_less_far(arm):
    made, asked = plan(arm, "pull the drawer open", *drawer((0.14, -0.1)))
    assert sound(made, asked)
    at = {w.stage: np.array(w.xyz) for w in made.trajectory}
    drawn = at["pull"] - at["close"]
    np.testing.assert_allclose(drawn[1:], 0.0, atol=1e-9)
    assert 0.10 < -drawn[0] <= made.parameters["pull_distance"] + 1e-9


def test_a_drawer_is_pulled_along_its_own_normal(arm):
    objects = drawer()
    assert slide_for(objects[0], Scene(objects, TABLE, arm.workspace)).handle.id == "h"
    for sentence in ("open the drawer", "slide the lime drawer out of the cabinet", "pull the handle"):
        made, asked = plan(arm, sentence, *objects)
        assert made.skill == "pull"
        assert sound(made, asked)
        at = {w.stage: np.array(w.xyz) for w in made.trajectory}
        np.testing.assert_allclose(
            at["pull"] - at["close"], -BACK * made.parameters["pull_distance"], atol=1e-9
        )


def test_a_brick_between_bricks_is_drawn_out_by_its_free_end(arm):
    objects = tower()
    red = next(o for o in objects if o.id == "k")
    held = stuck(red, Scene(objects, TABLE, arm.workspace))
    np.testing.assert_allclose(held.way, [0.0, 1.0, 0.0], atol=1e-6)
    assert held.exposed == pytest.approx(0.06, abs=0.006)
    made, asked = plan(arm, "pull the red block out of the tower and put it on the blue circle", *objects)
    assert made.skill == "draw"
    assert sound(made, asked)
    at = {w.stage: np.array(w.xyz) for w in made.trajectory}
    drawn = at["pull"] - at["close"]
    np.testing.assert_allclose(drawn[[0, 2]], 0.0, atol=1e-9)
    assert drawn[1] >= held.hidden


@pytest.mark.parametrize("into", [0.0, 0.018])
def test_of_a_brick_in_a_tower_seen_as_one_the_rest_is_taken_to_be_inside(arm, into):
    whole = scene_object("t", "white tower", "box", (0.12, -0.1, 0.0825), (0.2, 0.2, 0.165))
    end = scene_object("k", "red brick", "box", (0.12, 0.03 - into, 0.114), (0.06, 0.06, 0.03))
    held = stuck(end, Scene((whole, end), TABLE, arm.workspace))
    np.testing.assert_allclose(held.way, [0.0, 1.0, 0.0], atol=1e-6)
    assert held.hidden == pytest.approx(0.2)
    assert held.theme.extents[1] == pytest.approx(0.16)


@pytest.mark.parametrize(
    ("sentence", "kind"),
    [
        ("close the box", "other"),  # it is closed
        ("open the red cube", "unknown_skill"),
        ("pull the red cube", "unknown_skill"),
        ("open the purple box", "nothing_matches"),
    ],
)
def test_what_cannot_be_worked_is_declined(arm, sentence, kind):
    cube = scene_object("a", "red cube", "box", (0.35, 0.3, 0.025), (0.05, 0.05, 0.05))
    made, _ = plan(arm, sentence, *box(0.0), cube)
    assert made.abstention is not None
    assert made.abstention.kind == kind
