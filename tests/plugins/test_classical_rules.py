"""Rules of the classical perceiver, each on what it was made for: hidden sides, thin boards, tilted tables, glass."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Observation, Views
from gvla2.planning.scene import Scene
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.perceiver import ClassicalPerceiver
from tests.table_tops import TABLE_TOP, WORKSPACE, put, render


def perceive(observation: Observation) -> Scene:
    return ClassicalPerceiver(ClassicalConfig()).perceive(observation, "", WORKSPACE)


@pytest.mark.parametrize("height", [0.003, 0.0045])
def test_a_thin_board_is_one_object_as_large_as_it_is(height: float):
    """About the least height that counts noise puts each pixel on either side of it."""
    board = put("box", (0.2, 0.15, height), (0.3, -0.1), 0.3, "green")
    cube = put("box", (0.05, 0.05, 0.05), (0.32, -0.11), 0.7, "red", bottom=height)
    coaster = put("cylinder", (0.1, 0.1, height), (0.3, 0.2), 0.0, "blue")
    scene = perceive(render([board, cube, coaster], noise=0.001, robot=[]))
    assert sorted(o.colour for o in scene.objects) == ["blue", "green", "red"]
    for truth in (board, cube, coaster):
        found = next(o for o in scene.objects if o.colour == truth.colour)
        assert np.linalg.norm(found.centre - truth.centre) < 0.003
        assert np.abs(found.extents - truth.size).max() < 0.004


def test_solids_in_the_same_space_are_one_object_of_two_colours():
    """A red box whose edges are painted black: the frame's solid and the box's are the same."""
    size = np.array([0.12, 0.08, 0.06])
    mesh = trimesh.creation.box(size)
    for _ in range(4):
        mesh = mesh.subdivide()
    near_sides = (np.abs(mesh.triangles_center) > 0.32 * size).sum(axis=1)
    rgb = np.where((near_sides >= 2)[:, None], (0.05, 0.05, 0.05), (0.8, 0.1, 0.1))
    place = rigid([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]], (0.3, 0.0, TABLE_TOP + 0.03))
    surface = Surface(trimesh.transform_points(mesh.vertices, place), np.asarray(mesh.faces), rgb, 7)
    beside = put("box", (0.05, 0.05, 0.05), (0.3, 0.25), 0.2, "blue")
    scene = perceive(render([beside], robot=[surface], noise=0.0005))
    assert len(scene.objects) == 2
    found = next(o for o in scene.objects if o.colour != "blue")
    assert np.linalg.norm(found.centre - place[:3, 3]) < 0.003
    assert np.abs(np.sort(found.extents) - np.sort(size)).max() < 0.004


def test_objects_of_one_colour_that_touch_come_apart_where_one_is_higher():
    low = put("box", (0.06, 0.06, 0.06), (0.3, 0.0), 0.0, "red")
    high = put("box", (0.06, 0.06, 0.12), (0.3, 0.0605), 0.0, "red")
    scene = perceive(render([low, high], noise=0.0005, robot=[]))
    assert len(scene.objects) == 2
    for truth, found in zip((low, high), sorted(scene.objects, key=lambda o: o.top), strict=True):
        assert np.linalg.norm(found.centre - truth.centre) < 0.003
        assert np.abs(found.extents - truth.size).max() < 0.004
        assert not found.parent


def test_what_has_no_depth_on_the_bare_table_is_noted():
    glass = put("cylinder", (0.07, 0.07, 0.12), (0.3, 0.2), 0.0, "silver")
    cube = put("box", (0.06, 0.06, 0.06), (0.3, -0.15), 0.3, "red")
    seen, bare = (render(objs, robot=[]) for objs in ([glass, cube], [cube]))
    views = tuple(
        replace(view, depth=np.where(view.depth == other.depth, view.depth, np.float32(np.nan)))
        for view, other in zip(seen.views, bare.views, strict=True)
    )
    scene = perceive(replace(seen, views=Views(views)))
    assert [o.label for o in scene.objects] == ["red cube"]
    (note,) = [note for note in scene.notes if "No depth" in note]
    x, y = (float(part.split("=")[1]) for part in note.replace(",", "").split() if "=" in part)
    assert np.hypot(x - 0.3, y - 0.2) < 0.08
    assert not [note for note in perceive(bare).notes if "No depth" in note]
