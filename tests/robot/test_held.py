"""Bookkeeping of what the hand carries."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.robot.executor import CarriedScene

GRASP = rigid(Rotation.from_euler("x", np.pi).as_matrix(), (0.3, 0.0, 0.8))
TURN = rigid(Rotation.from_euler("z", 0.7).as_matrix(), (0.1, 0.2, 0.3)) @ GRASP


@pytest.fixture
def world(scene_of, block):
    lid = block("lid", (0.3, 0.0, 0.81), parent="block")
    return CarriedScene(scene_of(block(), lid, block("other", (0.5, 0.2, 0.777))))


def test_it_stays_where_it_is_let_go(world):
    before = world.scene
    world.carry("block", GRASP)
    world.carry("block", TURN)  # still carried: nothing new
    attached = world.attached
    world.release(TURN)
    assert world.attached is None
    block = world.scene["block"]
    np.testing.assert_allclose(block.world_from_object, TURN @ attached.tcp_from_object, atol=1e-12)
    np.testing.assert_allclose(block.points, block.world_from_object[None, :3, 3], atol=1e-12)
    apart = before["lid"].centre - before["block"].centre
    np.testing.assert_allclose(
        np.linalg.norm(world.scene["lid"].centre - block.centre), np.linalg.norm(apart), atol=1e-12
    )
    np.testing.assert_array_equal(world.scene["other"].centre, before["other"].centre)


def test_carrying_another_lets_go_of_the_first(world):
    world.carry("block", GRASP)
    world.carry("other", TURN)
    assert world.attached.object.id == "other"
    assert {o.id for o in world.scene.objects} == {"block", "lid"}
