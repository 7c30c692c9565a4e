"""``gvla2 objects teach``: what one run saw is recognised in the next, elsewhere and turned."""

import numpy as np
import pytest
import trimesh

from gvla2.cli import main
from gvla2.episode.record import EpisodeRecord
from gvla2.geometry.mesh_files import read_mesh
from gvla2.geometry.transform import rigid
from gvla2.geometry.views import Views
from gvla2.record.recorder import RunRecorder
from tests.perception.conftest import WORKSPACE, Seen, bottle, brick, standing
from tests.quick import BLINK


def crate():
    """An open box: 16 x 12 x 8 cm, walls of 6 mm, the floor of another colour."""
    walls = [((0.16, 0.006, 0.08), (0, side * 0.057, 0.04), (60, 160, 60)) for side in (-1, 1)]
    walls += [((0.006, 0.12, 0.08), (side * 0.077, 0, 0.04), (60, 160, 60)) for side in (-1, 1)]
    parts = []
    for size, at, rgb in (*walls, ((0.16, 0.12, 0.006), (0, 0, 0.003), (90, 60, 200))):
        parts.append(trimesh.creation.box(size, rigid(translation=at)))
        parts[-1].visual.vertex_colors = np.array([*rgb, 255], dtype=np.uint8)
    return trimesh.util.concatenate(parts)


def write_run(folder, observation, scene):
    """The folder that a run leaves which got as far as its scene."""
    record = EpisodeRecord("e", "lift it", "none", 0, {}, observation=observation, scene=scene)
    recorder = RunRecorder(folder, "")
    recorder.stage(record, "perceive")
    recorder.settle()
    return scene


def look(placed, parts_of, *overrides, views=slice(0, 2)):
    seen = Seen(placed, size=256).observation
    some = Views(tuple(seen.views)[views])
    observation = type(seen)(some, seen.world_from_tcp, seen.joints, seen.gripper, seen.gripper_width)
    perceiver = parts_of("memory=none", *BLINK, *overrides).perceiver
    return observation, perceiver.perceive(observation, "", WORKSPACE)


@pytest.fixture
def run(tmp_path, parts_of):
    """The folder of a run that saw a brick, a bottle and a crate, and its scene."""
    placed = [
        (brick(), standing(brick(), 0.12, -0.2, 0.2)),
        (bottle(), standing(bottle(), 0.15, 0.2)),
        (crate(), standing(crate(), 0.35, 0.0, 0.3)),
    ]
    return tmp_path / "run", write_run(tmp_path / "run", *look(placed, parts_of))


def at(scene, x, y):
    """The id of the scene's object that stands there."""
    return min(scene.objects, key=lambda o: float(np.linalg.norm(o.centre[:2] - [x, y]))).id


def teach(name, folder, one, *more):
    return main(["objects", "teach", name, f"run={folder}", f"object={one}", *more])


def test_what_one_run_saw_is_recognised_elsewhere_and_turned(run, tmp_path, parts_of, capsys):
    folder, scene = run
    gallery = tmp_path / "gallery"
    for name, x, y in (("painted brick", 0.12, -0.2), ("Ketchup", 0.15, 0.2), ("crate", 0.35, 0.0)):
        assert teach(name, folder, at(scene, x, y), f"to={gallery}") == 0
    assert "crate.glb" in capsys.readouterr().out
    assert {file.name for file in gallery.iterdir()} == {"painted_brick.glb", "ketchup.glb", "crate.glb"}
    placed = [
        (crate(), standing(crate(), 0.15, 0.15, 1.9)),
        (brick(), standing(brick(), 0.4, 0.05, 2.4)),
        (bottle(), standing(bottle(), 0.15, -0.2)),
    ]
    _, again = look(placed, parts_of, f"perceiver.gallery={gallery}")
    by_name = {obj.label: obj for obj in again.objects if obj.named_by == "gallery"}
    for name, size, where in (
        ("painted brick", (120, 70, 40), (0.4, 0.05)),
        ("ketchup", (70, 70, 160), (0.15, -0.2)),
        ("crate", (160, 120, 80), (0.15, 0.15)),
    ):
        obj = by_name[name]
        assert sorted(1e3 * obj.extents) == pytest.approx(sorted(size), abs=8)
        assert obj.centre[:2] == pytest.approx(where, abs=0.006)
    assert by_name["crate"].opening > 0.08
    assert by_name["painted brick"].opening == 0


def test_objects_of_a_simulated_world_are_known_in_its_next_layout(tmp_path, parts_of):
    given = ("task=sort_mustard", "memory=none", "robot.cameras=[front,left_shoulder]", "robot.video_size=16")

    def seen(seed, *overrides):
        made = parts_of(*given, *overrides)
        made.robot.reset(made.task, seed)
        observation = made.robot.observe()
        return observation, made.perceiver.perceive(observation, "", made.robot.arm.workspace)

    scene = write_run(tmp_path / "run", *seen(1))
    tray = next(obj for obj in scene.objects if obj.opening)
    tall = max(scene.objects, key=lambda obj: obj.top)
    for name, obj in (("parts bin", tray), ("yellow sauce", tall)):
        assert teach(name, tmp_path / "run", obj.id, f"to={tmp_path / 'gallery'}") == 0
    after = {obj.label: obj for obj in seen(2, f"perceiver.gallery={tmp_path / 'gallery'}")[1].objects}
    assert sorted(after["parts bin"].extents) == pytest.approx(sorted(tray.extents), abs=0.012)
    assert after["parts bin"].opening == pytest.approx(tray.opening, abs=0.02)
    assert after["yellow sauce"].extents[2] == pytest.approx(tall.extents[2], abs=0.01)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"run": "absent"}, "no folder"),
        ({"run": "."}, "scene.json"),
        ({"object": "o77"}, "It saw: o1 ("),
        ({"name": "??"}, "cannot name"),
        ({"name": "mesh"}, "cannot name"),
    ],
)
def test_what_cannot_be_taught_is_said_and_nothing_is_written(run, tmp_path, capsys, asked, said):
    given = {"name": "cup", "run": str(run[0]), "object": "o1"} | asked
    given["run"] = str(tmp_path / given["run"])
    assert teach(given["name"], given["run"], given["object"], f"to={tmp_path / 'gallery'}") == 1
    assert said in capsys.readouterr().err
    assert not (tmp_path / "gallery").exists()


def test_a_name_that_exists_is_only_replaced_on_request(run, tmp_path, capsys):
    folder, scene = run
    gallery, brick_id, bottle_id = f"to={tmp_path / 'gallery'}", at(scene, 0.12, -0.2), at(scene, 0.15, 0.2)
    assert teach("toy", folder, brick_id, gallery) == 0
    before = (tmp_path / "gallery" / "toy.glb").read_bytes()
    assert teach("Toy", folder, bottle_id, gallery) == 1
    assert "replace=true" in capsys.readouterr().err
    assert (tmp_path / "gallery" / "toy.glb").read_bytes() == before
    assert teach("toy", folder, bottle_id, gallery, "replace=true") == 0
    assert np.ptp(read_mesh(tmp_path / "gallery" / "toy.glb").bounds[:, 2]) == pytest.approx(0.16, abs=0.006)


def test_an_object_of_which_too_little_is_seen_is_refused(run, tmp_path, capsys, parts_of):
    speck = trimesh.creation.box((0.012, 0.012, 0.012))
    scene = write_run(tmp_path / "far", *look([(speck, standing(speck, 0.2, 0.0))], parts_of))
    assert teach("speck", tmp_path / "far", at(scene, 0.2, 0.0), f"to={tmp_path / 'gallery'}") == 1
    assert "are needed to teach" in capsys.readouterr().err
    assert not (tmp_path / "gallery").exists()


def test_a_crate_on_which_something_stands_is_taught_without_it(tmp_path, parts_of, capsys):
    block = trimesh.creation.box((0.05, 0.05, 0.05))
    block.visual.vertex_colors = np.array([220, 40, 40, 255], dtype=np.uint8)
    low = brick((0.16, 0.12, 0.05), (0.2, 0.3, 0.8))
    on_top = standing(block, 0.2, 0.0) @ rigid(translation=(0, 0, 0.05))
    placed = [(low, standing(low, 0.2, 0.0)), (block, on_top)]
    scene = write_run(tmp_path / "run", *look(placed, parts_of))
    upper = max(scene.objects, key=lambda obj: obj.bottom).id
    assert teach("both", tmp_path / "run", upper, f"to={tmp_path / 'gallery'}") == 0
    assert "Taken with it" in capsys.readouterr().out
    assert teach("block", tmp_path / "run", upper, f"to={tmp_path / 'gallery'}", "alone=true") == 0
    assert np.ptp(read_mesh(tmp_path / "gallery" / "block.glb").bounds, axis=0) == pytest.approx(
        0.05, abs=0.006
    )
    assert np.ptp(read_mesh(tmp_path / "gallery" / "both.glb").bounds, axis=0)[2] == pytest.approx(
        0.1, abs=0.006
    )
