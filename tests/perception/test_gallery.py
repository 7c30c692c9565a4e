from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Views
from gvla2.perception.clusters import cloud_of, clusters
from gvla2.perception.fitting import coarse_starts, seen_surface, sights_of
from gvla2.perception.frames import frames_of, raised
from gvla2.perception.gallery import Gallery
from gvla2.perception.labels import labelled
from gvla2.perception.objects import object_of
from gvla2.perception.scans import read_scans
from gvla2.planning.scene import Scene


@pytest.fixture
def folder(tmp_path, world):
    world.brick().export(tmp_path / "painted_brick.glb")
    world.brick(size=(0.16, 0.05, 0.05), rgb=(0.3, 0.6, 0.3)).export(tmp_path / "green_bar.glb")
    world.bottle().export(tmp_path / "blue_bottle.glb")
    world.bottle((0.8, 0.1, 0.1)).export(tmp_path / "ketchup.glb")
    return tmp_path


@pytest.fixture(autouse=True, scope="module")
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def scene_of(world, observation):
    frames, table, _ = frames_of(observation.views, world.WORKSPACE)
    found = clusters(frames, [raised(f, table, world.WORKSPACE) for f in frames])
    objs = []
    for k in range(1 + max(int(image.max()) for image in found)):
        cloud = cloud_of(frames, [image == k for image in found])
        objs.append(object_of(*cloud, world.TABLE, 1.0, f"o{k}"))
    return Scene(tuple(objs), world.TABLE, world.WORKSPACE, "test")


def test_known_objects_get_their_names_poses_and_meshes(world, folder):
    brick, bottle = world.brick(), world.bottle()
    lying = rigid([[0, 0, -1], [0, 1, 0], [1, 0, 0]], (0.3, 0.1, world.TABLE + 0.035))
    seen = world.Seen([(brick, world.standing(brick, 0.15, -0.12, 0.8)), (bottle, lying)], noise=0.0008)
    scene = labelled(scene_of(world, seen.observation), seen.observation, [Gallery.read(folder)])
    by_name = {o.label: o for o in scene.objects}
    assert set(by_name) == {"painted brick", "blue bottle"}
    for name, mesh, pose in (
        ("painted brick", brick, world.standing(brick, 0.15, -0.12, 0.8)),
        ("blue bottle", bottle, lying),
    ):
        obj = by_name[name]
        assert (obj.named_by, obj.known.name) == ("gallery", name)
        assert obj.sureness > 0.8
        true = trimesh.transform_points(np.asarray(mesh.vertices), pose)
        placed = obj.known.mesh().vertices
        gaps = np.linalg.norm(placed[:, None] - true[None], axis=-1).min(axis=1)
        assert np.median(gaps) < 0.004
        assert gaps.max() < 0.012


def test_the_painted_end_tells_which_way_round_it_lies(world, folder):
    brick = world.brick()
    for yaw in (0.3, 0.3 + np.pi):
        seen = world.Seen([(brick, world.standing(brick, 0.25, 0.0, yaw))], noise=0.0008)
        (obj,) = labelled(scene_of(world, seen.observation), seen.observation, [Gallery.read(folder)]).objects
        found = obj.known.world_from_scan[:2, 0]
        assert found @ [np.cos(yaw), np.sin(yaw)] > 0.95


@pytest.mark.parametrize("change", ["larger", "colour", "other"])
def test_what_is_not_in_the_gallery_is_unknown(world, folder, change):
    strange = {
        "larger": world.brick(size=(0.17, 0.10, 0.056)),
        "colour": world.bottle((0.9, 0.85, 0.2)),
        "other": trimesh.creation.cone(0.05, 0.12),
    }[change]
    if change == "other":
        strange.visual.vertex_colors = (90, 90, 200, 255)
    seen = world.Seen([(strange, world.standing(strange, 0.25, 0.0))], noise=0.0008)
    scene = labelled(scene_of(world, seen.observation), seen.observation, [Gallery.read(folder)])
    assert scene.objects[0].named_by == ""
    assert scene.objects[0].known is None
    assert any("unknown to the gallery" in note for note in scene.notes)


def test_a_camera_without_depth_and_an_object_of_few_points_do_not_stop_it(world, folder, two):
    views = list(two.observation.views)
    views[0] = replace(views[0], depth=None)
    views[1] = replace(views[1], depth=np.full_like(views[1].depth, np.nan))
    blind = replace(two.observation, views=Views(tuple(views)))
    scene = scene_of(world, blind)
    speck = replace(scene.objects[0], id="speck", points=scene.objects[0].points[:5])
    scene = labelled(replace(scene, objects=(*scene.objects, speck)), blind, [Gallery.read(folder)])
    assert {o.label for o in scene.objects if o.named_by} == {"painted brick", "blue bottle"}
    assert any(note.startswith("speck: unknown") and "5 points" in note for note in scene.notes)


def test_a_plate_cut_off_by_the_picture_a_little_above_the_table_is_still_a_plate(world, tmp_path):
    plate = trimesh.creation.revolve(
        [[0, 0], [0.04, 0], [0.07, 0.012], [0.07, 0.016], [0.04, 0.005], [0, 0.005]], sections=48
    )
    book = trimesh.creation.box((0.14, 0.11, 0.03))
    for mesh, name in ((plate, "plate"), (book, "book")):
        mesh.visual.vertex_colors = np.tile([230, 230, 225, 255], (len(mesh.vertices), 1)).astype(np.uint8)
        mesh.export(tmp_path / f"{name}.glb")
    place = rigid(None, (0.25, 0.235, world.TABLE + 0.015))  # where a picture from above ends at y = .27
    seen = world.Seen([(plate, place)], size=240, noise=0.0005)
    observation = replace(seen.observation, views=Views(seen.observation.views.views[3:]))
    (found,) = labelled(scene_of(world, observation), observation, [Gallery.read(tmp_path)]).objects
    assert found.label == "plate"
    assert found.known.world_from_scan[:3, 3] == pytest.approx(place[:3, 3], abs=0.012)


def test_what_fits_nearly_as_well_on_its_head_starts_either_way_up(world, tmp_path):
    """Shape hardly tells a can from itself on its lid; its colours do, once it is laid there."""
    can = trimesh.creation.cylinder(0.033, 0.08, sections=32).subdivide()
    can.vertices[:, :2] *= np.where(can.vertices[:, 2] > 0.0, 1.0, 0.9)[:, None]
    can.visual.vertex_colors = np.tile([200, 90, 40, 255], (len(can.vertices), 1)).astype(np.uint8)
    can.export(tmp_path / "can.glb")
    seen = world.Seen([(can, world.standing(can, 0.2, 0.0))], noise=0.0005)
    (body,) = scene_of(world, seen.observation).objects
    surface = seen_surface(body.points, sights_of(seen.observation.views), world.TABLE)
    (scan,) = read_scans(tmp_path)
    _, poses = coarse_starts(scan, surface)
    ups = [pose[2, :3] for pose in poses]
    assert min(one @ other for one in ups for other in ups) < -0.99
