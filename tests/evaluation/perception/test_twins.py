"""Episodes that cannot be answered: the named thing has a twin."""

import numpy as np
import pytest

from gvla2.evaluation.perception.twins import TwinTask, with_twins
from gvla2.robot.task import Layout, TaskInstance, TaskSite
from gvla2_plugins.tabletop import gvla2_tasks

SITE = TaskSite((0.25, 0.0), (0.65, 0.91), 0.752, lambda point: True, (0.76, 0.61, 0.43))


def task(name: str):
    component = next(c for c in gvla2_tasks() if c.name == name)
    return component.build(component.config())


@pytest.mark.parametrize(
    ("name", "prefix"), [("pickup_cup", "cup_"), ("open_jar", "jar_"), ("pick_and_lift", "cube_")]
)
def test_everything_of_the_named_shape_looks_and_is_called_alike(name, prefix):
    plain = task(name).sample(np.random.default_rng(3), SITE)
    twins = TwinTask(task(name)).sample(np.random.default_rng(3), SITE)
    assert twins.instruction == plain.instruction
    of_kind = [body for body in twins.layout.bodies if body.name.startswith(prefix)]
    assert len(of_kind) >= 2
    assert len({body.label for body in of_kind}) == 1
    assert len({solid.rgb for body in of_kind for solid in body.solids}) == 1
    assert of_kind[0].label.split()[0] in plain.instruction
    for body in twins.layout.bodies:
        np.testing.assert_array_equal(body.world_from_body, plain.layout[body.name].world_from_body)


def test_without_a_shape_beside_it_there_is_no_twin(body):
    def instance(sentence, *bodies):
        return TaskInstance(Layout(bodies), sentence, {})

    red, blue = body("a", 0.2), body("b", -0.2, label="blue cube")
    larger = body("c", -0.2, size=(0.12, 0.1, 0.1), label="blue cube")
    assert with_twins(instance("lift the red cube", red, larger)) is None
    assert with_twins(instance("lift the cube", red, blue)) is None, "no colour is named"
    assert with_twins(instance("lift it", red)) is None
    assert with_twins(instance("sort the red and the blue cubes", red, blue)) is None, "both are meant"
    made = with_twins(instance("lift the red cube", red, blue))
    assert made is not None
    assert [one.label for one in made.layout.bodies] == ["red cube", "red cube"]
