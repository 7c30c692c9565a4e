"""Textured bodies on ray cast tables: geometry decides, paint does not; cameras that err are set right."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gvla2.geometry.raycast import Surface
from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Views
from gvla2.perception.registration import agreed
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.perceiver import ClassicalPerceiver
from tests.plugins.rendered_table import TABLE_TOP, WORKSPACE, put, render


def speckled(mesh: trimesh.Trimesh, at, seed=0, longest=0.008) -> Surface:
    """A surface whose faces have random colours, standing at (x, y)."""
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, longest)
    vertices = np.add(vertices, (at[0], at[1], TABLE_TOP - vertices[:, 2].min()))
    rgb = np.random.default_rng(seed).uniform(0.1, 0.9, (len(faces), 3))
    return Surface(vertices, faces, rgb, 7 + seed)


def perceive(surfaces, observation=None):
    observation = observation or render([], robot=surfaces)
    return ClassicalPerceiver(ClassicalConfig()).perceive(observation, "", WORKSPACE)


def crate(seed=0, at=(0.3, 0.0)):
    return speckled(trimesh.creation.box((0.12, 0.07, 0.09)), at, seed)


def test_a_textured_box_is_one_object_of_its_size():
    (found,) = perceive([crate()]).objects
    assert found.shape == "box"
    assert np.abs(np.sort(found.extents) - [0.07, 0.09, 0.12]).max() < 0.005
    assert np.linalg.norm(found.centre[:2] - [0.3, 0.0]) < 0.004


def test_textured_objects_a_finger_apart_are_two():
    scene = perceive([crate(0, (0.3, -0.05)), crate(1, (0.3, 0.045))])
    assert len(scene.objects) == 2


def test_the_floor_of_a_flat_dish_belongs_to_it():
    rim = trimesh.creation.annulus(0.08, 0.09, 0.02, sections=64)
    floor = trimesh.creation.cylinder(0.085, 0.002, sections=64).apply_translation((0, 0, -0.009))
    scene = perceive([speckled(trimesh.util.concatenate([rim, floor]), (0.3, 0.0))])
    assert len(scene.objects) == 1
    inside = np.linalg.norm(scene.objects[0].points[:, :2] - [0.3, 0.0], axis=1) < 0.06
    assert inside.sum() > 100


def erring(observation, seed=3):
    """The observation with every camera's pose off by 2 mm and 0.3 degrees."""
    rng = np.random.default_rng(seed)
    views = []
    for view in observation.views:
        axis, shift = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
        off = rigid(Rotation.from_rotvec(np.deg2rad(0.3) * axis).as_matrix(), 0.002 * shift)
        camera = replace(view.camera, world_from_camera=view.camera.world_from_camera @ off)
        views.append(replace(view, camera=camera))
    return replace(observation, views=Views(tuple(views)))


def _spread(views, clear) -> float:
    """Metres by which the cameras disagree about where what they see is: the deviation of their mean offsets."""
    offsets = []
    for view, true in zip(views, clear, strict=True):
        seen = np.isfinite(true.depth) & (true.points()[..., 2] > TABLE_TOP + 0.01)
        seen &= (true.points()[..., 2] < TABLE_TOP + 0.2) & ~true.robot_mask
        seen &= ((true.points() > WORKSPACE.low) & (true.points() < WORKSPACE.high)).all(axis=-1)
        if seen.sum() > 100:
            offsets.append(np.median(view.points()[seen] - true.points()[seen], axis=0))
    return float(np.linalg.norm(np.std(offsets, axis=0)))


@pytest.fixture(scope="module")
def three():
    return render([
        put("box", (0.06,) * 3, (0.2, -0.2), 0.4, "red", ("cube",)),
        put("box", (0.12, 0.07, 0.09), (0.35, 0.1), -0.9, "blue", ("box",)),
        put("box", (0.05, 0.05, 0.10), (0.1, 0.2), 1.1, "lime", ("box",)),
    ])  # fmt: skip


def test_cameras_that_err_are_made_to_agree(three):
    off = erring(three)
    before, after = _spread(off.views, three.views), _spread(agreed(off.views, WORKSPACE), three.views)
    assert before > 0.002
    assert after < 0.4 * before


def test_objects_are_found_by_cameras_that_err(three):
    scene = perceive([], erring(three))
    assert sorted(o.colour for o in scene.objects) == ["blue", "lime", "red"]
    assert any("disagreed" in note for note in scene.notes)


@pytest.mark.parametrize("height", [0.003, 0.0045])
def test_a_thin_board_is_one_object_as_large_as_it_is(height: float):
    """About the least height that counts noise puts each pixel on either side of it."""
    board = put("box", (0.2, 0.15, height), (0.3, -0.1), 0.3, "green")
    cube = put("box", (0.05, 0.05, 0.05), (0.32, -0.11), 0.7, "red", bottom=height)
    coaster = put("cylinder", (0.1, 0.1, height), (0.3, 0.2), 0.0, "blue")
    scene = perceive((), render([board, cube, coaster], noise=0.001, robot=[]))
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
    scene = perceive((), render([beside], robot=[surface], noise=0.0005))
    assert len(scene.objects) == 2
    found = next(o for o in scene.objects if o.colour != "blue")
    assert np.linalg.norm(found.centre - place[:3, 3]) < 0.003
    assert np.abs(np.sort(found.extents) - np.sort(size)).max() < 0.004
