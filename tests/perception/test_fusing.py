import numpy as np
import pytest

from gvla2.perception.clusters import MaskCandidate, fuse, iou, objects_of
from gvla2.perception.frames import frames_of


@pytest.fixture
def frames(world, two):
    return frames_of(two.observation.views, world.WORKSPACE)


def test_masks_of_several_views_become_the_things_that_they_show(two, frames):
    given = [
        MaskCandidate(v, truth == k, 0.9, f"thing {k}") for v, truth in enumerate(two.truth) for k in (1, 2)
    ]
    things = fuse(frames[0], given)
    assert len(things) == 2
    assert all(len(thing.members) == 4 and thing.parent == -1 for thing in things)
    assert {thing.label for thing in things} == {"thing 1", "thing 2"}


def test_a_part_stays_a_part_and_is_not_merged_with_its_whole(two, frames):
    whole = [MaskCandidate(v, truth == 1, 0.9) for v, truth in enumerate(two.truth)]
    part = []
    for v, truth in enumerate(two.truth):
        colour = two.observation.views[v].image
        part.append(MaskCandidate(v, (truth == 1) & (colour[..., 1] > 120), 0.8, "painted end"))
    things = fuse(frames[0], [*whole, *part])
    assert [thing.parent for thing in things] == [-1, 0]
    objects, notes = objects_of(things, frames[0], frames[1], 5)
    assert not notes
    assert objects[1].parent == objects[0].id
    assert objects[1].label == "painted end"
    assert objects[1].extents[:2].prod() < 0.5 * objects[0].extents[:2].prod()


def test_the_same_mask_twice_counts_once_and_the_surer_is_kept(two, frames):
    mask = two.truth[0] == 1
    (thing,) = fuse(frames[0], [MaskCandidate(0, mask, 0.6), MaskCandidate(0, mask, 0.8)])
    assert thing.score == pytest.approx(0.8)


def test_candidates_of_one_seed_are_one_thing_whatever_they_share(two, frames):
    left, right = (np.where(two.truth[v] == 2, True, False) for v in (0, 1))
    left[:, : int(np.nonzero(left)[1].mean())] = False
    assert (
        len(fuse(frames[0], [MaskCandidate(0, left, 0.9, seed=4), MaskCandidate(1, right, 0.9, seed=4)])) == 1
    )


def test_a_leak_onto_the_table_does_not_widen_a_thing(two, frames):
    leaky = []
    for v, truth in enumerate(two.truth):
        mask = truth == 2
        mask |= np.roll(mask, 6, axis=1) | np.roll(mask, -6, axis=0)
        leaky.append(MaskCandidate(v, mask & (truth != 1), 0.9))
    (thing,), _ = objects_of(fuse(frames[0], leaky), *frames[:2], 5)
    assert max(thing.extents[:2]) < 0.078


def test_a_mask_without_depth_is_told(two, frames):
    frames[0][0].points[:] = np.nan
    assert fuse(frames[0], [MaskCandidate(0, two.truth[0] == 1, 0.9)]) == []
    assert fuse(frames[0], []) == []


def test_iou_of_nothing_is_nothing():
    assert iou(np.zeros((2, 2), bool), np.zeros((2, 2), bool)) == 0.0
