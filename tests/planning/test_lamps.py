"""Whether a lamp shines, by how it looked before and looks now."""

import numpy as np

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.skills.mechanisms import shines


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


def test_without_a_lamp_there_is_no_telling():
    dark, lit = lamp(0.27), lamp(0.85)
    lone = part("bell", "red button", 0.0, 0.4, "")
    assert shines(lone, Scene((lone,), 0.75, dark.workspace), lit) is None
    assert shines(dark["button"], dark, Scene((), 0.75, dark.workspace)) is None, "it was not seen again"
