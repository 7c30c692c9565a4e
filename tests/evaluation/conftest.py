"""Small textured meshes, and a cache of the test's own."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


def write_block(folder: Path, extents: tuple[float, float, float] = (0.2, 0.1, 0.05)) -> Path:
    """A block whose every face shows the whole texture: left half red, right half green, top row of it blue."""
    folder.mkdir(parents=True, exist_ok=True)
    image = np.zeros((8, 8, 3), dtype=np.uint8)
    image[:, :4], image[:, 4:], image[0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    Image.fromarray(image).save(folder / "texture.png")
    (folder / "textured.mtl").write_text("newmtl paint\nmap_Kd texture.png\n")
    half = np.array(extents) / 2
    corners = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    lines = ["mtllib textured.mtl", "usemtl paint"]
    lines += ["v " + " ".join(f"{value:.6f}" for value in half * corner) for corner in corners]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    for a, b, c, d in ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)):
        lines += [f"f {a}/1 {b}/2 {c}/3", f"f {a}/1 {c}/3 {d}/4"]
    (folder / "textured.obj").write_text("\n".join(lines) + "\n")
    return folder / "textured.obj"


@pytest.fixture
def block() -> Callable[..., Path]:
    return write_block


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GVLA2_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"
