import numpy as np
import pytest

from gvla2.perception.clusters import MaskCandidate, fuse, objects_of
from gvla2.perception.frames import frames_of


@pytest.fixture
def frames(world, two):
    return frames_of(two.observation.views, world.WORKSPACE)


def test_masks_of_several_views_become_the_objects_that_they_show(two, frames):
    given = [
        MaskCandidate(v, truth == k, 0.9, f"thing {k}") for v, truth in enumerate(two.truth) for k in (1, 2)
    ]
    objs = fuse(frames[0], given)
    assert len(objs) == 2
    assert all(len(obj.members) == 4 and obj.parent == -1 for obj in objs)
    assert {obj.label for obj in objs} == {"thing 1", "thing 2"}


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


def test_the_same_mask_twice_counts_once_and_the_surer_is_kept(two, frames):
    mask = two.truth[0] == 1
    (obj,) = fuse(frames[0], [MaskCandidate(0, mask, 0.6), MaskCandidate(0, mask, 0.8)])
    assert obj.score == pytest.approx(0.8)


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
