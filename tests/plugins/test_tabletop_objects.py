import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError
from gvla2.robot.task import TaskSite
from gvla2.testing.robot import check_task
from gvla2_plugins.tabletop_objects import ObjectsConfig, TabletopObjectsConfig
from gvla2_plugins.tabletop_objects.task import TabletopObjects, fallen
from tests.scanning import bowl, box, painted, write

SITE = TaskSite((0.25, 0.0), (0.65, 0.91), 0.752, lambda point: True)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("scans")
    write(root, "soup_can", painted(trimesh.creation.cylinder(0.03, 0.1)))
    write(root, "pudding_box", painted(box(0.03, 0.08, 0.11)))
    write(root, "sugar_box", painted(box(0.04, 0.09, 0.17)))
    write(root, "bowl", painted(bowl()))
    return root


def task(folder, ask="lift", **objects):
    return TabletopObjects(TabletopObjectsConfig(ask=ask, objects=ObjectsConfig(root=str(folder), **objects)))


def sample(made, seed, instruction=None):
    return made.sample(np.random.default_rng(seed), SITE, instruction)


@pytest.mark.parametrize("pose", ["upright", "fallen"])
@pytest.mark.parametrize("ask", ["lift", "put_in"])
def test_the_contract_is_kept(folder, ask, pose):
    check_task(task(folder, ask, count=4, pose=pose if ask != "put_in" else "upright"), SITE)


def test_a_given_sentence_decides_what_is_judged(folder):
    made = task(folder, count=4)
    given = sample(made, 3, "please pick up the sugar box")
    assert "sugar box is lower" in given.goal
    assert "over the bowl" in sample(made, 3, "put the soup can into the bowl").goal
    assert "seed's own goal" in sample(made, 3, "lift the mug").goal


class Moved:
    """The state of a layout of which some bodies were moved, and one is held."""

    def __init__(self, layout, moved, held=""):
        self.poses = {body.name: body.world_from_body for body in layout.bodies} | moved
        self._held = held

    def pose(self, name):
        return self.poses[name]

    def held(self, name):
        return name == self._held

    def resting(self, name):
        return name != self._held

    def touching(self, name):
        return frozenset({"bowl"})


def shifted(body, by):
    pose = body.world_from_body.copy()
    pose[:3, 3] += by
    return pose


def test_lifting_is_judged_by_the_lowest_point(folder):
    instance = sample(task(folder, names=["sugar_box"]), 0)
    body = instance.layout["sugar_box"]
    for height, held, relaxed, strict in (
        (0.02, True, 0, 0),
        (0.05, True, 1, 0),
        (0.1, True, 1, 1),
        (0.1, False, 1, 0),
    ):
        state = Moved(instance.layout, {body.name: shifted(body, (0, 0, height))}, body.name if held else "")
        assert instance.succeeded["relaxed"](state) == relaxed
        assert instance.succeeded["strict"](state) == strict


def test_inside_is_judged_where_objects_lie(folder):
    instance = sample(task(folder, "put_in", count=4), 0, "put the soup can into the bowl")
    can = instance.layout["soup_can"].world_from_body.copy()
    can[:3, 3] = instance.layout["bowl"].world_from_body[:3, 3] + (0, 0, 0.03)
    inside = Moved(instance.layout, {"soup_can": can})
    assert instance.succeeded["strict"](inside)
    assert not instance.succeeded["relaxed"](Moved(instance.layout, {"soup_can": can}, held="soup_can"))
    assert not instance.succeeded["relaxed"](Moved(instance.layout, {}))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"names": ["mug"]}, "no object 'mug'"),
        ({"names": ["bowl", "bowl"]}, "named twice"),
        ({"count": 9}, "count is 9"),
        ({"count": 5}, "no more than the 4"),
        ({"pose": "standing"}, "upright, fallen"),
        ({"ask": "juggle"}, "lift, put_in"),
    ],
)
def test_bad_options_are_named(folder, options, message):
    with pytest.raises(ConfigurationError, match=message):
        task(folder, **options)


def test_what_cannot_be_asked_or_does_not_fit_is_named(folder, tmp_path):
    with pytest.raises(ConfigurationError, match="open at its top"):
        sample(task(folder, "put_in", names=["sugar_box", "soup_can"]), 0)
    write(tmp_path, "door", painted(box(0.9, 1.6, 0.02)))
    with pytest.raises(ConfigurationError, match=r"more than the 0\.65 x 0\.91 m of the table"):
        sample(task(tmp_path), 0)


def test_it_rolls_off_a_face_that_its_weight_does_not_stand_on():
    wedge = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [3, 0, 1], [3, 1, 1.0]]) * 0.05
    rng = np.random.default_rng(1)
    centre = np.array([2.9, 0.5, 0.95]) * 0.05
    for _ in range(50):
        turned = (wedge - centre) @ fallen(wedge, centre, rng).T
        low = turned[:, 2] < turned[:, 2].min() + 1e-6
        assert low.sum() >= 3
        assert (turned[low, :2].min(axis=0) <= 1e-6).all()
        assert (turned[low, :2].max(axis=0) >= -1e-6).all()
