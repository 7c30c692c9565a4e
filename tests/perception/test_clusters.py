import numpy as np

from gvla2.perception.clusters import clusters, components, without_specks
from gvla2.perception.frames import frames_of, raised


def test_two_things_are_two_clusters_in_all_views(world, two):
    frames, table, _ = frames_of(two.observation.views, world.WORKSPACE)
    found = clusters(frames, [raised(f, table, world.WORKSPACE) for f in frames])
    assert found.count == 2
    for groups, truth in zip(found.maps, two.truth, strict=True):
        for k in range(2):
            inside = truth[groups == k]
            assert len(set(inside[inside > 0])) == 1


def test_nothing_above_the_table_is_no_cluster(world):
    frames, table, _ = frames_of(world.Seen([]).observation.views, world.WORKSPACE)
    assert clusters(frames, [raised(f, table, world.WORKSPACE) for f in frames]).count == 0


def test_points_apart_are_components_of_their_own():
    line = np.linspace(0, 0.05, 30)[:, None] * [1.0, 0, 0]
    parts = components(np.concatenate([line, line + np.array([0, 0.03, 0])]))
    assert len(set(parts)) == 2
    assert len(set(parts[:30])) == 1


def test_flying_pixels_are_specks():
    mask = np.zeros((20, 20), dtype=bool)
    mask[5:9, 5:9], mask[15, 15] = True, True
    assert not without_specks(mask)[15, 15]
    assert without_specks(mask)[6, 6]
