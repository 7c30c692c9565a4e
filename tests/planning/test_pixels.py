"""Pixels against a scene whose geometry is known: two cubes on a table, seen by ray casting."""

from dataclasses import replace

import numpy as np
import pytest

from gvla2.errors import PlanningError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import look_along
from gvla2.geometry.views import Views
from gvla2.planning.pixels import (
    Pixel,
    depth_at,
    object_at,
    object_near,
    path_in_air,
    sight,
    view_of,
)
from gvla2.testing import inputs

TOP = {b.label: b.world_from_block[:3] @ [0, 0, 0.5 * b.side, 1] for b in (inputs.RED, inputs.BLUE)}


@pytest.fixture(scope="module")
def observation():
    return inputs.observation(144)


@pytest.fixture(scope="module")
def scene():
    return inputs.scene()


def raised(point, dz, dx=0.0):
    return np.asarray(point) + np.array([dx, 0.0, dz])


def pixel_of(view, point):
    (u, v), _ = view.camera.project(np.asarray(point))
    return Pixel(view.name, float(u), float(v))


def with_depth(observation, depth, **changes):
    view = replace(observation.views[0], depth=depth, **changes)
    return replace(observation, views=Views((view, *observation.views.views[1:])))


@pytest.mark.parametrize("camera", ["camera_0", "camera_2"])
@pytest.mark.parametrize("label", ["red cube", "blue cube"])
def test_a_pixel_on_a_cube_is_that_cube(observation, scene, camera, label):
    seen = sight(pixel_of(view_of(observation, camera), TOP[label]), observation, scene)
    assert seen.object == label.replace(" ", "_")
    assert np.linalg.norm(seen.point - TOP[label]) < 0.006


def test_a_pixel_on_the_table_is_no_object_and_lies_on_it(observation, scene):
    place = np.array([0.32, 0.02, inputs.TABLE])
    seen = sight(pixel_of(observation.views[0], place), observation, scene)
    assert seen.object == ""
    assert np.linalg.norm(seen.point - place) < 0.005


def test_holes_are_filled_from_the_nearest_surface(observation, scene):
    view = observation.views[0]
    pixel = pixel_of(view, TOP["red cube"])
    depth = view.depth.copy()
    row, column = int(pixel.v), int(pixel.u)
    depth[row - 1 : row + 2, column - 1 : column + 2] = np.nan
    seen = sight(pixel, with_depth(observation, depth), scene)
    assert seen.object == "red_cube"
    assert np.linalg.norm(seen.point - TOP["red cube"]) < 0.015


def test_a_flying_pixel_is_outvoted_and_a_thin_object_is_not(observation):
    view = observation.views[0]
    pixel = pixel_of(view, TOP["red cube"])
    row, column = int(pixel.v), int(pixel.u)
    true = float(view.depth[row, column])
    flying = view.depth.copy()
    flying[row, column] = 0.2
    assert depth_at(replace(view, depth=flying), pixel) == pytest.approx(true, abs=0.01)
    wire = view.depth.copy()
    wire[row - 4 : row + 5, column] = true - 0.1
    assert depth_at(replace(view, depth=wire), pixel) == pytest.approx(true - 0.1)


def test_what_is_missing_is_named(observation, scene):
    with pytest.raises(PlanningError, match="outside the picture of 'camera_0', 144 by 144 pixels"):
        sight(Pixel("camera_0", float("nan"), 40.0), observation, scene)
    with pytest.raises(PlanningError, match="no camera 'wrist'; the observation has camera_0"):
        sight(Pixel("wrist", 4.0, 4.0), observation, scene)
    with pytest.raises(PlanningError, match="measures no depth"):
        sight(Pixel("camera_0", 4.0, 4.0), with_depth(observation, None), scene)
    blind = with_depth(observation, np.full_like(observation.views[0].depth, np.nan))
    with pytest.raises(PlanningError, match="No depth was measured within 12 pixels"):
        sight(Pixel("camera_0", 4.0, 4.0), blind, scene)


def test_a_part_is_meant_rather_than_its_whole(scene):
    cube = scene["red_cube"]
    knob = replace(cube, id="knob", label="knob", parent="red_cube", extents=0.3 * cube.extents)
    both = replace(scene, objects=(*scene.objects, replace(knob, points=cube.points)))
    assert object_at(cube.centre, both) == "knob"
    assert object_at(raised(cube.centre, 0.2), both) == ""


def front(target, distance=0.9, size=200):
    """A camera before the table that looks along -y: paths along x run across its picture."""
    position = np.asarray(target) + np.array([0.0, distance, 0.5])
    return Camera.from_fov(0.8, look_along(position, target - position), size, size, "front")


def test_a_path_drawn_across_the_picture_gets_its_height_back(scene):
    """The picture of an arc in the air, anchored at its ends, gives the arc."""
    a, b = np.array([0.2, 0.0, inputs.TABLE + 0.03]), np.array([0.45, 0.0, inputs.TABLE + 0.03])
    camera = front(0.5 * (a + b))
    t = np.linspace(0.0, 1.0, 9)
    arc = a + t[:, None] * (b - a) + np.outer(np.sin(np.pi * t) * 0.2, [0, 0, 1.0])
    pixels = [Pixel("front", *uv) for uv in camera.project(arc)[0]]
    found = path_in_air(camera, pixels, {0: a, 8: b}, scene, a)
    np.testing.assert_allclose(found, arc, atol=1e-9)


def test_after_the_last_event_up_in_the_picture_is_up(scene):
    a = np.array([0.3, 0.0, inputs.TABLE + 0.05])
    camera = front(a)
    way = np.array([a, raised(a, 0.1), raised(a, 0.2, dx=0.05)])
    pixels = [Pixel("front", *uv) for uv in camera.project(way)[0]]
    found = path_in_air(camera, pixels, {0: a}, scene, a)
    np.testing.assert_allclose(found, way, atol=1e-9)


def test_a_near_miss_finds_the_object_beside_it(observation, scene):
    view = observation.views[0]
    on = pixel_of(view, TOP["red cube"])
    beside = Pixel(view.name, on.u - 8, on.v)
    assert object_near(on, view, scene, 4.0) == "red_cube"
    assert object_near(beside, view, scene, 8.0) == "red_cube"
    assert object_near(beside, view, scene, 1.0) == ""
