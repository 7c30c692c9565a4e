import numpy as np
import pytest

from gvla2.perception.clusters import MaskCandidate, clusters, fuse, objects_of
from gvla2.perception.frames import frames_of, raised
from gvla2.perception.objects import numbered, object_of


def test_two_objects_are_two_clusters_in_all_views(world, two):
    frames, table, _ = frames_of(two.observation.views, world.WORKSPACE)
    found = clusters(frames, [raised(f, table, world.WORKSPACE) for f in frames])
    assert {k for image in found for k in np.unique(image)} == {-1, 0, 1}
    for groups, truth in zip(found, two.truth, strict=True):
        for k in range(2):
            inside = truth[groups == k]
            assert len(set(inside[inside > 0])) == 1


def test_nothing_above_the_table_is_no_cluster(world):
    frames, table, _ = frames_of(world.Seen([]).observation.views, world.WORKSPACE)
    found = clusters(frames, [raised(f, table, world.WORKSPACE) for f in frames])
    assert all((image == -1).all() for image in found)


@pytest.fixture
def frames(world, two):
    return frames_of(two.observation.views, world.WORKSPACE)


def test_masks_of_several_views_become_the_objects_that_they_show(two, frames):
    given = [
        MaskCandidate(v, truth == k, 0.9, f"object {k}") for v, truth in enumerate(two.truth) for k in (1, 2)
    ]
    objs = fuse(frames[0], given)
    assert len(objs) == 2
    assert all(len(obj.members) == 4 and obj.parent == -1 for obj in objs)
    assert {obj.label for obj in objs} == {"object 1", "object 2"}


def test_a_part_stays_a_part_and_is_not_merged_with_its_whole(two, frames):
    whole = [MaskCandidate(v, truth == 1, 0.9) for v, truth in enumerate(two.truth)]
    part = []
    for v, truth in enumerate(two.truth):
        colour = two.observation.views[v].image
        part.append(MaskCandidate(v, (truth == 1) & (colour[..., 1] > 120), 0.8, "painted end"))
    objs = fuse(frames[0], [*whole, *part])
    assert [obj.parent for obj in objs] == [-1, 0]
    objects, notes = objects_of(objs, frames[0], frames[1], 5)
    assert not notes
    assert objects[1].parent == objects[0].id
    assert objects[1].label == "painted end"
    assert objects[1].extents[:2].prod() < 0.5 * objects[0].extents[:2].prod()


def test_a_leak_onto_the_table_does_not_widen_an_object(two, frames):
    leaky = []
    for v, truth in enumerate(two.truth):
        mask = truth == 2
        mask |= np.roll(mask, 6, axis=1) | np.roll(mask, -6, axis=0)
        leaky.append(MaskCandidate(v, mask & (truth != 1), 0.9))
    (obj,), _ = objects_of(fuse(frames[0], leaky), *frames[:2], 5)
    assert max(obj.extents[:2]) < 0.078


def test_a_mask_without_depth_is_reported(two, frames):
    frames[0][0].points[:] = np.nan
    assert fuse(frames[0], [MaskCandidate(0, two.truth[0] == 1, 0.9)]) == []
    assert fuse(frames[0], []) == []


def box_points(size, yaw, at, rng, count=3000):
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = np.sign(points[np.arange(count), axis]) * 0.5
    c, s = np.cos(yaw), np.sin(yaw)
    return (points * size) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T + at


def test_a_box_is_measured_whatever_its_turn():
    points = box_points([0.12, 0.06, 0.05], 0.7, [0.3, 0.1, 0.525], np.random.default_rng(0))
    obj = object_of(points, np.full((len(points), 3), [0.9, 0.1, 0.1]), 0.5, 1.0)
    assert sorted(obj.extents) == pytest.approx([0.05, 0.06, 0.12], abs=0.003)
    assert obj.centre == pytest.approx([0.3, 0.1, 0.525], abs=0.003)
    assert (obj.colour, obj.shape) == ("red", "box")
    assert obj.label == "red box"


def test_numbers_follow_places_not_the_order_found():
    rng = np.random.default_rng(1)
    made = [
        object_of(box_points([0.05] * 3, 0, [x, 0, 0.025], rng), np.ones((3000, 3)), 0.0, 1.0)
        for x in (0.4, 0.2)
    ]
    assert [round(float(o.centre[0]), 1) for o in numbered(made)] == [0.2, 0.4]
