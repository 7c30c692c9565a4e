"""Collision checks of the Panda against perceived solids."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.geometry.transform import invert_rigid, rigid
from gvla2.planning.arm import Attachment
from gvla2.planning.scene import KnownShape


@pytest.fixture
def over(arm, down):
    """Joints that put the tool 0.15 m over the table at (0.3, 0)."""
    return arm.inverse(down((0.3, 0.0, 0.902))).joints


@pytest.mark.parametrize("gap", [-0.015, -0.004, 0.004, 0.02])
def test_distance_to_a_box_under_the_fingertips(arm, scene_of, block, over, gap):
    tip = 0.902 - arm.hand.tip_beyond_tcp
    for shape in ("box", "cylinder", "disc"):
        obj = block(at=(0.3, 0.0, tip - gap - 0.02), size=(0.12, 0.12, 0.04), shape=shape)
        clearance = arm.clearance(over, 0.3, scene_of(obj))
        assert clearance.distance == pytest.approx(gap, abs=1e-3)
        assert clearance.robot_part in ("panda_leftfinger", "panda_rightfinger")
        assert clearance.other == "block"


def test_allowed_contacts_are_for_the_hand_only(arm, scene_of, block, over):
    at_hand = scene_of(block(at=(0.3, 0.0, 0.902), size=(0.02, 0.08, 0.02)))
    assert arm.clearance(over, 0.5, at_hand).distance < 0
    assert arm.clearance(over, 0.5, at_hand, frozenset({"block"})).distance > 0.02
    elbow = arm.kinematics.model.createData()
    import pinocchio as pin

    pin.framesForwardKinematics(arm.kinematics.model, elbow, arm.kinematics.full(over, 1.0))
    place = elbow.oMf[arm.kinematics.model.getFrameId("panda_link4")].translation
    at_elbow = scene_of(block(at=tuple(place), size=(0.05, 0.05, 0.05)))
    clearance = arm.clearance(over, 1.0, at_elbow, frozenset({"block"}))
    assert clearance.distance < 0
    assert clearance.robot_part.startswith("panda_link")


def test_what_is_attached_moves_with_the_hand(arm, scene_of, block, over):
    held = block(at=(0.3, 0.0, 0.892), size=(0.04, 0.04, 0.06))
    attached = Attachment(held, invert_rigid(arm.forward(over)) @ held.world_from_object)
    scene = scene_of(held)
    assert arm.clearance(over, 0.5, scene).distance <= 1e-3
    clearance = arm.clearance(over, 0.5, scene, attached=attached)
    assert clearance.distance == pytest.approx(0.892 - 0.03 - 0.752, abs=1e-3)
    assert (clearance.robot_part, clearance.other) == ("block", "table")
    other = block("other", at=(0.3, 0.0, 0.852), size=(0.2, 0.2, 0.04))
    assert arm.clearance(over, 0.5, scene_of(held, other), attached=attached).distance < 0
    free = arm.clearance(over, 0.5, scene_of(held, other), frozenset({"other"}), attached)
    assert free.distance > 0.005


def test_the_hand_fits_into_a_known_object_whose_box_it_is_in(arm, scene_of, block, over, tmp_path):
    sides = [trimesh.creation.box((0.02, 0.02, 0.3)) for _ in range(2)]
    sides += [trimesh.creation.box((0.02, 0.5, 0.02))]
    for side, at in zip(sides, [(0, -0.24, 0), (0, 0.24, 0), (0, 0, -0.14)], strict=True):
        side.apply_translation(at)
    file = tmp_path / "gate.obj"
    trimesh.util.concatenate(sides).export(file)
    boxed = block("gate", at=(0.3, 0.0, 0.902), size=(0.02, 0.5, 0.3))
    known = replace(boxed, known=KnownShape("gate", str(file), boxed.world_from_object))
    assert arm.clearance(over, 0.5, scene_of(boxed)).distance < 0
    assert arm.clearance(over, 0.5, scene_of(known)).distance > 0.04
    moved = known.moved(rigid(None, (0.0, 0.24, 0.0)))
    clearance = arm.clearance(over, 0.5, scene_of(moved))
    assert (clearance.distance < 0, clearance.other) == (True, "gate")
    gone = replace(known, known=replace(known.known, path=str(tmp_path / "gone.obj")))
    assert arm.clearance(over, 0.5, scene_of(gone)).distance < 0


def test_the_arm_can_hit_itself(arm, scene_of):
    low, high = arm.limits
    rng = np.random.default_rng(1)
    found = [arm.clearance(q, 1.0, scene_of(table=-5.0)) for q in rng.uniform(low, high, (300, 7))]
    touching = [c for c in found if c.distance < 0]
    assert 0 < len(touching) < 100
    assert all(c.other.startswith("panda_") for c in touching)


def test_checker_and_distances_agree(arm, scene_of, block):
    scene = scene_of(block(size=(0.2, 0.2, 0.2)), block("pole", (0.2, 0.3, 1.0), (0.1, 0.1, 0.6), "cylinder"))
    low, high = arm.limits
    checker = arm.checker(scene, 1.0)
    world = np.arange(len(checker.pairs)) < checker.n_world
    for margin in (-0.01, 0.0, 0.01, 0.05):
        checker.set_margins(margin)
        for joints in np.random.default_rng(3).uniform(low, high, (150, 7)):
            slack = (checker.distances(joints) - np.where(world, margin, 0.0)).min()
            if abs(slack) > 1e-4:
                assert checker.free(joints) == (slack > 0)
