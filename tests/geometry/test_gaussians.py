from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians, read_gaussians, write_gaussians

FIELDS = [
    *("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"),
    *("opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"),
]
TYPES = {"f4": "float", "f8": "double", "u1": "uchar", "i2": "short"}


def random_gaussians(n: int) -> Gaussians:
    rng = np.random.default_rng(0)
    values = [rng.normal(size=(n, k)) for k in (3, 3, 4, 1, 3)]
    return Gaussians(values[0], values[1], values[2], values[3][:, 0], values[4])


def foreign_file(
    path: Path,
    fields: list[tuple[str, str]],
    order: str = "<",
    n: int = 5,
    seed: int = 0,
    trailer: bytes = b"",
) -> np.ndarray:
    """A file as some other tool might write it, byte by byte; returns its records."""
    rng = np.random.default_rng(seed)
    records = np.zeros(n, dtype=[(name, order + kind) for name, kind in fields])
    for name, kind in fields:
        records[name] = rng.normal(size=n) if kind[0] == "f" else rng.integers(0, 100, n)
    header = [
        "ply",
        f"format binary_{'little' if order == '<' else 'big'}_endian 1.0",
        "comment  made elsewhere ",
    ]
    header += ["obj_info  odd   spacing", f"element vertex {n}"]
    header += [f"property {TYPES[kind]} {name}" for name, kind in fields]
    if trailer:
        header += ["element face 1", "property list uchar int vertex_indices"]
    path.write_bytes("\n".join([*header, "end_header", ""]).encode() + records.tobytes() + trailer)
    return records


@settings(max_examples=15, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    shuffle=st.randoms(use_true_random=False),
    extra=st.lists(st.sampled_from(["f4", "f8", "u1", "i2"]), max_size=4),
    order=st.sampled_from("<>"),
)
def test_files_of_other_tools_are_read_whatever_their_order_and_further_properties(
    tmp_path_factory: pytest.TempPathFactory, seed, shuffle, extra, order
) -> None:
    path = tmp_path_factory.mktemp("ply") / "in.ply"
    fields = [(name, "f4") for name in FIELDS] + [(f"mine_{i}", kind) for i, kind in enumerate(extra)]
    shuffle.shuffle(fields)
    trailer = b"\x03\0\0\0\0\x01\0\0\0\x02\0\0\0" if order == "<" else b""
    records = foreign_file(path, fields, order, seed=seed, trailer=trailer)
    found = read_gaussians(path)
    for axis, name in enumerate("xyz"):
        np.testing.assert_array_equal(found.centres[:, axis], records[name])
    np.testing.assert_array_equal(found.opacity_logits, records["opacity"])


def test_what_is_written_is_read(tmp_path: Path) -> None:
    gaussians = random_gaussians(7)
    write_gaussians(tmp_path / "g.ply", gaussians)
    back = read_gaussians(tmp_path / "g.ply")
    for name in ("centres", "log_scales", "rotations", "opacity_logits", "sh_dc"):
        assert np.array_equal(getattr(back, name), getattr(gaussians, name))


def test_the_layout_is_the_one_of_the_field(tmp_path: Path) -> None:
    write_gaussians(tmp_path / "g.ply", random_gaussians(2))
    ply = PlyData.read(tmp_path / "g.ply")
    names = list(ply["vertex"].data.dtype.names)
    assert names == FIELDS
    assert (ply.text, ply.byte_order) == (False, "<")
    assert {str(ply["vertex"].data.dtype[name]) for name in names} == {"float32"}


def test_broken_files_are_named_and_explained(tmp_path: Path) -> None:
    path, fields = tmp_path / "g.ply", [(name, "f4") for name in FIELDS]
    foreign_file(path, fields)
    whole = path.read_bytes()
    for content, words in (
        (whole[:-10], "end-of-file"),
        (b"hello", "expected 'ply'"),
        (b"", "expected 'ply'"),
        (whole.replace(b"element vertex", b"element points"), "lack x, y"),
        (whole.replace(b" opacity", b" opaqueness"), "lack opacity"),
        (whole[: -5 * 17 * 4] + b"\0\0\xc0\x7f" + whole[4 - 5 * 17 * 4 :], "centres contains NaN"),
    ):
        path.write_bytes(content)
        with pytest.raises(GeometryError, match=f"(?s)g.ply.*{words}"):
            read_gaussians(path)
    foreign_file(path, fields, n=0)
    with pytest.raises(GeometryError, match="no Gaussians"):
        read_gaussians(path)


def test_colour_opacity_and_scale_are_decoded() -> None:
    gaussians = Gaussians(
        np.zeros((3, 3)),
        np.log([[1, 2, 3]] * 3),
        [[1, 0, 0, 0]] * 3,
        [0, np.inf, -np.inf],
        [[0, 1, -1]] * 3,
    )
    assert np.allclose(gaussians.rgb[0], [0.5, 0.7820948, 0.2179052])
    assert gaussians.opacities.tolist() == [0.5, 1.0, 0.0]
    assert np.allclose(gaussians.scales, [[1, 2, 3]])
    assert len(gaussians) == 3


def test_with_centres_changes_xyz_alone() -> None:
    gaussians = random_gaussians(5)
    moved = gaussians.with_centres(gaussians.centres + 1)
    assert np.array_equal(moved.centres, gaussians.centres + 1)
    for name in ("log_scales", "rotations", "opacity_logits", "sh_dc"):
        assert getattr(moved, name) is getattr(gaussians, name)
    with pytest.raises(GeometryError, match="5 Gaussians"):
        gaussians.with_centres(np.zeros((4, 3)))
    with pytest.raises(GeometryError, match="not finite"):
        gaussians.with_centres(np.full((5, 3), np.nan))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("centres", np.zeros((2, 2)), "centres"),
        ("centres", np.array([[0, 0, np.inf], [0, 0, 0]]), "a centre.* is infinite"),
        ("log_scales", np.full((2, 3), np.inf), "infinite"),
        ("rotations", np.zeros((2, 4)), "length zero"),
        ("opacity_logits", np.array([0, np.nan]), "opacity_logits contains NaN"),
    ],
)
def test_malformed_arrays_are_refused(name: str, value: np.ndarray, words: str) -> None:
    good = {
        "centres": np.zeros((2, 3)),
        "log_scales": np.zeros((2, 3)),
        "rotations": np.ones((2, 4)),
        "opacity_logits": np.zeros(2),
        "sh_dc": np.zeros((2, 3)),
    }
    with pytest.raises(GeometryError, match=words):
        Gaussians(**{**good, name: value})
