"""Wholes and parts: perceived and true scenes name them alike, and a sentence means the right one in both."""

from functools import cache

import numpy as np
import pytest

from gvla2.planning.part_hierarchy import called
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.perceiver import ClassicalPerceiver
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots
from gvla2_plugins.skill.planner import read
from gvla2_plugins.tabletop import gvla2_tasks


@pytest.fixture(scope="module")
def robot():
    made = gvla2_robots()[0].build(SapienPandaConfig())
    yield made
    made.close()


@pytest.fixture(scope="module")
def scenes(robot):
    """The perceived and the true scene of a task's layout, seen once for all who ask."""

    @cache
    def of(name, seed=1):
        component = next(c for c in gvla2_tasks() if c.name == name)
        instance = robot.reset(component.build(component.config()), seed)
        seen = ClassicalPerceiver(ClassicalConfig()).perceive(
            robot.observe(), instance.instruction, robot.arm.workspace
        )
        return seen, robot.true_scene()

    return of


def meant(scene, words):
    found = read(f"take {words}", scene)
    assert isinstance(found, tuple), found.message
    return scene[found[0].theme]


@pytest.mark.parametrize(
    ("task", "words", "part", "within"),
    [
        ("open_drawer", "the drawer", "handle", 0.05),
        ("take_umbrella", "the umbrella", "handle", 0.02),
        ("open_wine", "the bottle", "lid", 0.01),
        ("open_box", "the box", "lid", 0.015),
        ("close_box", "the box", "lid", 0.015),
    ],
)
def test_an_object_and_its_part_are_where_they_are(scenes, task, words, part, within):
    places = []
    for scene in scenes(task):
        parts = [p for p in scene.parts_of(meant(scene, words).id) if called(p, part)]
        highest = max(parts, key=lambda p: p.top, default=None)
        assert highest is not None, [o.label for o in scene.objects]
        places.append(highest.centre)
    np.testing.assert_allclose(*places, atol=within)


@pytest.mark.parametrize(
    ("task", "words"),
    [
        ("sort_mustard", "the mustard bottle"),
        ("insert_block", "the ring"),
        ("put_knife", "the chopping board"),
        ("put_knife", "the knife block"),
    ],
)
def test_nouns_mean_the_same_object_in_both_scenes(scenes, task, words):
    places = [meant(scene, words).centre[:2] for scene in scenes(task)]
    np.testing.assert_allclose(*places, atol=0.02)


@pytest.mark.parametrize(("task", "words"), [("insert_block", "the ring"), ("sort_mustard", "the tray")])
def test_how_wide_hollow_objects_are_open(scenes, task, words):
    widths = [meant(scene, words).opening for scene in scenes(task)]
    assert widths[1] > 0.02
    assert widths[0] == pytest.approx(widths[1], rel=0.05)


def test_every_object_leaves_the_bins_out(scenes):
    for scene in scenes("sort_object"):
        found = read("put every object into the bin of its own colour", scene)
        assert isinstance(found, tuple), found.message
        assert len({call.theme for call in found}) == 3
        assert not any(scene[call.theme].opening for call in found)


def test_the_lid_of_one_of_two_jars(scenes):
    for scene in scenes("open_jar"):
        for jar in [o for o in scene.objects if o.label.endswith("jar")]:
            assert meant(scene, f"the lid of the {jar.colour} jar").parent == jar.id


def test_a_lid_is_not_in_the_space_of_its_jar(scenes):
    """Though its dark rim is taken for the black jar, which seems to be as high as the lid then."""
    for seen, true in (scenes("open_jar", seed) for seed in (301, 302)):
        for lid in (o for o in true.objects if called(o, "lid")):
            assert min(np.linalg.norm(o.centre - lid.centre) for o in seen.objects) < 0.07
        assert len(seen.objects) == 5
