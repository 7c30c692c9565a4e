"""Selecting by place and size."""

from __future__ import annotations

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.planning.selecting import SELECTORS, extreme, located


def thing(name, xy, size=(0.05, 0.05, 0.05), parent=""):
    pose = rigid(translation=(*xy, 0.8))
    return SceneObject(name, name, "box", "", pose, np.array(size), np.zeros((0, 3)), parent=parent)


A, B, C = thing("a", (0.2, 0.2)), thing("b", (0.3, 0.0), (0.1, 0.1, 0.02)), thing("c", (0.4, -0.3))
SCENE = Scene((A, B, C), 0.75, Box(np.array([0.0, -0.5, 0.75]), np.array([0.8, 0.5, 1.7])))


@pytest.mark.parametrize(
    ("by", "names"),
    [
        ("left", "a"), ("right", "c"), ("near", "a"), ("far", "c"), ("middle", "b"), ("big", "b"),
        ("small", "ac"), ("tall", "ac"), ("short", "b"),
    ],
)  # fmt: skip
def test_the_extreme_ones_and_all_that_cannot_be_told_from_them(by, names):
    assert [o.id for o in extreme(SCENE.objects, by, SCENE)] == list(names)


def test_of_nothing_there_is_no_extreme_and_words_must_be_known():
    assert all(extreme((), by, SCENE) == [] for by in SELECTORS)
    with pytest.raises(ValueError, match="left, right"):
        extreme(SCENE.objects, "nice", SCENE)


@pytest.mark.parametrize(
    ("relation", "names"),
    [("left_of", "a"), ("right_of", "c"), ("behind", "c"), ("front_of", "a"), ("on", ""), ("beside", "a")],
)
def test_where_things_lie_to_another(relation, names):
    assert [o.id for o in located(SCENE.objects, relation, B)] == list(names)


def test_on_it_means_over_its_footprint_or_a_part_of_it():
    on, part = thing("on", (0.31, 0.01)), thing("part", (0.3, 0.2), parent="b")
    assert {o.id for o in located((on,), "on", B)} == {"on"}
    assert {o.id for o in located((part, A), "on", B)} == {"part"}
