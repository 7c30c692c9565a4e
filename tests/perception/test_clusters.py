from gvla2.perception.clusters import clusters
from gvla2.perception.frames import frames_of, raised


def test_two_objects_are_two_clusters_in_all_views(world, two):
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
