"""How far a lid is open, from its plate and its box; and whether a lamp shines, by how it looked before."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.skills.mechanisms import opening_angle, shines


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
