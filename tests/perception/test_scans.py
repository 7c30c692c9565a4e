import os

import numpy as np
import pytest
import trimesh

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.perception.scans import read_scan, read_scans, scan_files


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def folder_of(tmp_path, **meshes):
    folder = tmp_path / "scans"
    for name, mesh in meshes.items():
        path = folder / name.replace("__", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        mesh.export(path.with_suffix(".glb" if "__" not in name else ".ply"))
    return folder


def test_names_are_the_files_or_their_folders(tmp_path, world):
    folder = folder_of(tmp_path, red_brick=world.brick(), spray_bottle__textured=world.bottle())
    assert set(scan_files(folder)) == {"red brick", "spray bottle"}


def test_a_scan_has_colours_sizes_and_ways_to_lie(tmp_path, world):
    (scan,) = read_scans(folder_of(tmp_path, brick=world.brick()))
    assert sorted(np.ptp(scan.points, axis=0)) == pytest.approx([0.04, 0.07, 0.12], abs=0.003)
    assert scan.diameter == pytest.approx(0.144, abs=0.004)
    painted = scan.rgb[scan.points[:, 0] > 0.05]
    assert painted[:, 1].mean() > 0.8 > 0.4 > scan.rgb[scan.points[:, 0] < 0][:, 1].mean()
    heights = sorted({round(float(np.ptp(scan.points @ turn.T, axis=0)[2]), 2) for turn in scan.rests})
    assert heights == [0.04, 0.07, 0.12]


def test_what_was_prepared_is_kept_and_follows_the_file(tmp_path, world):
    path = folder_of(tmp_path, brick=world.brick()) / "brick.glb"
    first = read_scan("brick", path)
    assert list((tmp_path / "cache").rglob("*.npz"))
    assert np.array_equal(read_scan("brick", path).points, first.points)
    world.brick(size=(0.2, 0.1, 0.1)).export(path)
    assert read_scan("brick", path).diameter > 1.3 * first.diameter


def test_millimetres_are_reported(tmp_path, world):
    large = world.brick(size=(120, 70, 40))
    (scan,) = read_scans(folder_of(tmp_path, brick=large))
    assert (scan.scale, scan.diameter) == (0.001, pytest.approx(0.144, abs=0.004))


@pytest.mark.parametrize("case", ["absent", "empty", "twice", "no mesh"])
def test_folders_that_are_no_gallery(tmp_path, world, case):
    folder = tmp_path / "scans"
    said = {"absent": "no such folder", "empty": "no mesh", "twice": "two scans", "no mesh": "Cannot read"}[
        case
    ]
    if case != "absent":
        folder.mkdir()
    if case == "twice":
        folder_of(tmp_path, red_brick=world.brick(), **{"red-brick__model": world.brick()})
    if case == "no mesh":
        (folder / "brick.glb").write_bytes(b"glTF")
    with pytest.raises((ConfigurationError, GeometryError), match=said):
        read_scans(folder)


def test_a_gallery_does_without_what_it_cannot_read_and_says_so(tmp_path, world, caplog):
    folder = folder_of(tmp_path, brick=world.brick())
    trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]], [[0, 1, 2]]).export(folder / "sheet.ply")
    (folder / "cup.glb").write_bytes(b"glTF")
    (folder / "box.urdf").write_text("<robot")
    os.mkfifo(folder / "brick.png")
    assert [scan.name for scan in read_scans(folder)] == ["brick", "sheet"]
    left = [record.getMessage() for record in caplog.records]
    assert [message.split()[0] for message in left if "is left out" in message] == ["'box'", "'cup'"]


def test_what_systems_leave_behind_is_no_object_and_a_scan_in_two_formats_is_one(tmp_path):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    for name in ("mug.obj", "mug.stl", "__MACOSX/tea.ply", ".git/pack.ply", "pan/pan.off"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        box.export(tmp_path / name)
    for name in ("._mug.ply", "pan/._pan.obj", "__MACOSX/._cup.ply"):
        (tmp_path / name).write_bytes(b"\x00\x05\x16\x07")
    assert {name: file.name for name, file in scan_files(tmp_path).items()} == {
        "mug": "mug.obj",
        "pan": "pan.off",
    }
