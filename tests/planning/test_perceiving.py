"""What a perceiver returns is checked before anyone works with it."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import PerceptionError
from gvla2.planning.asking import perceive
from gvla2.testing import inputs

WHO = "The perceiver 'mine' of plugin 'yours'"


class Perceiver:
    def __init__(self, answer):
        self.answer = answer

    def perceive(self, observation, instruction, workspace):
        return self.answer


def changed(**fields):
    scene = inputs.scene()
    return replace(scene, objects=(replace(scene.objects[0], **fields), *scene.objects[1:]))


def ask(answer):
    return perceive(Perceiver(answer), inputs.observation(8), "", inputs.WORKSPACE, WHO)


@pytest.mark.parametrize(
    ("answer", "reported"),
    [
        (None, "must be Scene, got NoneType"),
        ([], "must be Scene, got list"),
        (replace(inputs.scene(), objects=("a", "b")), "must be SceneObject, got str"),
        (replace(inputs.scene(), objects=list(inputs.scene().objects)), "must be tuple, got list"),
        (replace(inputs.scene(), objects=inputs.scene().objects[:1] * 2), "Ids of objects must be unique"),
        (replace(inputs.scene(), table_height=float("nan")), "table_height must be finite"),
        (changed(id=""), "Ids of objects must be unique"),
        (changed(world_from_object=np.full((4, 4), np.nan)), "'red_cube': world_from_object has entries"),
        (changed(world_from_object="here"), "could not convert string to float"),
        (changed(extents=np.full(3, np.nan)), "'red_cube': extents has entries that are not finite"),
        (changed(extents=np.full(3, -1.0)), "'red_cube': extents must not be negative"),
        (changed(points=np.full((5, 3), np.nan)), "'red_cube': points has entries that are not finite"),
        (changed(points=[[1.0, 2.0], [3.0]]), "inhomogeneous"),
    ],
)  # fmt: skip
def test_what_is_no_scene_is_reported_with_its_perceiver(answer, reported):
    with pytest.raises(PerceptionError, match=f"{WHO} gave no valid scene. .*{reported}"):
        ask(answer)


def test_a_scene_is_handed_on_read_only():
    given = changed(points=np.zeros((5, 3)))
    scene = ask(given)
    assert [o.id for o in scene.objects] == [o.id for o in given.objects]
    assert not scene.objects[0].points.flags.writeable
    assert given.objects[0].points.flags.writeable
