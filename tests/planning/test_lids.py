"""How far a lid is open, from its plate and its box."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import SceneObject
from gvla2.skills.mechanisms import hinged, opening_angle

BOX = SceneObject("b", "box", "box", "", rigid(translation=(0.3, 0.1, 0.075)), np.array([0.25, 0.35, 0.15]),
                  np.zeros((0, 3)))  # fmt: skip


def lid(angle: float, yaw: float = 0.0, scale: float = 1.0) -> tuple[SceneObject, SceneObject]:
    """A lid open by ``angle`` and its box, all turned by ``yaw``; the hinge is at the box's +x side."""
    turned = Rotation.from_euler("z", yaw).as_matrix()
    swung = Rotation.from_euler("y", angle).as_matrix()
    size, reach = BOX.extents * scale, 0.268 * scale
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


def test_lid_and_box_are_found_from_either():
    plate, box = lid(1.0)
    handle = SceneObject(
        "h", "handle", "bar", "", np.eye(4), np.array([0.1, 0.01, 0.01]), np.zeros((0, 3)), parent="b"
    )
    objects = (box, handle, plate)
    assert hinged(box, objects) == (plate, box)
    assert hinged(plate, objects) == (plate, box)
    assert hinged(handle, (handle,)) == (None, handle)
