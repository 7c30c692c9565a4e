import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.view_folders import (
    parse_view_spec,
    read_views,
    resized,
    subject_of,
    write_plain,
)
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.silhouette import mask_agreement, mask_silhouettes
from tests.scanning import write_gso

ELEPHANT = Path(__file__).parents[1] / "data" / "gso30_elephant"


@pytest.fixture(scope="module")
def carved_elephant():
    views = read_views(ELEPHANT, "0-24")
    return views, carve(views)


@pytest.fixture
def views(masked_views, jug):
    return masked_views(jug, count=3, size=64)


def _same(one: View, other: View, exact: bool = True) -> None:
    np.testing.assert_allclose(one.camera.K, other.camera.K, atol=1e-6)
    np.testing.assert_allclose(one.camera.world_from_camera, other.camera.world_from_camera, atol=1e-6)
    for name in ("image", "depth", "mask", "robot_mask"):
        a, b = getattr(one, name), getattr(other, name)
        assert (a is None) == (b is None), name
        if a is not None:
            assert a.dtype == b.dtype
            np.testing.assert_allclose(a, b, atol=0 if exact else 1 / 255)


# The real object.


def test_all_views_of_a_real_object_carve_a_hull_that_fits_them(carved_elephant):
    views, made = carved_elephant
    assert len(views) == 25
    assert views[0].camera.width == views[0].camera.height == 256
    assert made.status == "ok"
    assert mask_agreement(made.mesh, mask_silhouettes(views)[0]) == pytest.approx(0.99, abs=0.01)
    assert np.ptp(made.mesh.bounds, axis=0).max() == pytest.approx(1.0, abs=0.03)


def test_the_default_is_the_protocol():
    views = read_views(ELEPHANT)
    assert [v.name for v in views] == ["000", "001", "002", "003", "004"]
    assert views[0].image[0, 0].tolist() == [255, 255, 255]  # transparent pixels are laid on white
    assert views[0].mask[0, 0] == 0
    assert read_views(ELEPHANT / "render_mvs_25" / "model", "3", 512)[0].camera.K[0, 0] == 560.0


# Round trips.


def test_plain_round_trip(views, tmp_path):
    robot = np.zeros((64, 64), dtype=bool)
    robot[:, :5] = True
    given = Views(
        (replace(views[0], robot_mask=robot), replace(views[1], depth=None), replace(views[2], mask=None))
    )
    write_plain(tmp_path / "views", given, "yellow bottle")
    for folder in (tmp_path / "views", tmp_path):  # the folder itself, or the run's
        for one, other in zip(given, read_views(folder), strict=True):
            _same(one, other)
            assert one.name == other.name
        assert subject_of(folder) == "yellow bottle"
    assert [v.name for v in read_views(tmp_path, "2,0")] == [views[2].name, views[0].name]
    assert subject_of(tmp_path / "nowhere") == ""


def test_gso_round_trip(views, tmp_path):
    write_gso(tmp_path / "toy" / "render_mvs_25" / "model", views)
    for one, other in zip(views, read_views(tmp_path / "toy", "0-2", 64), strict=True):
        _same(replace(one, depth=None), replace(other, image=one.image), exact=False)
        inside = one.mask > 0.5
        assert np.abs(one.image[inside].astype(int) - other.image[inside]).max() <= 1


def test_cameras_in_the_convention_of_opengl(views, tmp_path):
    write_plain(tmp_path, views)
    document = json.loads((tmp_path / "cameras.json").read_text())
    document["convention"] = "opengl"
    for entry in document["views"]:
        entry["T"] = (np.diag([1.0, -1.0, -1.0, 1.0]) @ entry["T"]).tolist()
    (tmp_path / "cameras.json").write_text(json.dumps(document))
    for one, other in zip(views, read_views(tmp_path), strict=True):
        _same(one, other)


def test_alpha_is_the_mask_when_there_is_no_other(views, tmp_path):
    write_plain(tmp_path, views)
    for number, view in enumerate(views):
        (tmp_path / "masks" / f"{number}.png").unlink()
        rgba = np.dstack([view.image, np.rint(255 * view.mask).astype(np.uint8)])
        Image.fromarray(rgba).save(tmp_path / "images" / f"{number}.png")
    for one, other in zip(views, read_views(tmp_path), strict=True):
        np.testing.assert_array_equal(one.mask, other.mask)
        assert (other.image[one.mask == 0] == 255).all()


# Sizes.


def test_resizing_keeps_what_pixels_see(views):
    view = resized(views[0], 32)
    assert (view.camera.width, view.camera.height) == (32, 32)
    assert view.mask.sum() == pytest.approx(views[0].mask.sum() / 4, rel=0.05)
    point = np.array([[0.1, 0.05, -0.1]])
    np.testing.assert_allclose(view.camera.project(point)[0], views[0].camera.project(point)[0] / 2)
    assert np.isin(view.depth[np.isfinite(view.depth)], views[0].depth).all()


# What goes wrong is named.


def test_a_folder_of_no_known_kind(tmp_path):
    (tmp_path / "holiday.jpg").touch()
    with pytest.raises(GeometryError, match=r"cameras\.json.*holiday\.jpg"):
        read_views(tmp_path)
    with pytest.raises(GeometryError, match="no such folder"):
        read_views(tmp_path / "nowhere")
    with pytest.raises(GeometryError, match="resized to 3"):
        read_views(tmp_path, size=3)


def test_gso_trouble_names_the_file(views, tmp_path):
    model = tmp_path / "render_mvs_25" / "model"
    write_gso(model, views)
    with pytest.raises(GeometryError, match=r"no view 3 in .*model: it has the views 0 to 2"):
        read_views(tmp_path)
    mirrored = np.eye(4)
    mirrored[:3] = np.diag([1.0, 1.0, -1.0]) @ np.load(model / "000.npy")
    np.save(model / "001.npy", mirrored)
    with pytest.raises(GeometryError, match=r"001\.npy.*mirrored \(determinant -1\)"):
        read_views(tmp_path, "0-2")
    (model / "001.npy").write_bytes(b"not numpy")
    with pytest.raises(GeometryError, match=r"001\.npy"):
        read_views(tmp_path, "1")
    (model / "002.png").write_bytes(b"not a picture")
    with pytest.raises(GeometryError, match=r"002\.png"):
        read_views(tmp_path, "2")


def _palette(shape):
    picture = Image.fromarray(shape.astype(np.uint8), "P")
    picture.putpalette([0, 0, 0, 128, 0, 0] + [0] * 762)
    return picture


@pytest.mark.parametrize(
    "encode",
    [
        lambda shape: Image.fromarray(shape.astype(np.uint8)),
        lambda shape: Image.fromarray(shape),
        lambda shape: Image.fromarray(shape.astype(np.uint16)),
        lambda shape: Image.fromarray(shape.astype(np.uint16) * 65535),
        lambda shape: Image.fromarray(np.stack([255 * shape, 0 * shape, 0 * shape], -1).astype(np.uint8)),
        lambda shape: Image.fromarray(np.stack([255 * shape, 0 * shape + 255], -1).astype(np.uint8), "LA"),
        lambda shape: Image.fromarray(np.stack([0 * shape, 255 * shape], -1).astype(np.uint8), "LA"),
        _palette,
    ],
    ids=["0/1", "bits", "16 bits 0/1", "16 bits", "red", "opaque alpha", "alpha", "palette"],
)
def test_masks_as_other_tools_write_them(views, tmp_path, encode):
    write_plain(tmp_path, views)
    shape = np.zeros(views[0].image.shape[:2], dtype=bool)
    shape[2:6, 3:9] = True
    encode(shape).save(tmp_path / "masks" / "0.PNG", "PNG")
    (tmp_path / "masks" / "0.png").unlink()
    cameras = tmp_path / "cameras.json"
    cameras.write_bytes(b"\xef\xbb\xbf" + cameras.read_bytes().replace(b"\n", b"\r\n"))
    assert (read_views(tmp_path)[0].mask == shape).all()


def test_pictures_and_masks_named_as_colmap_does(views, tmp_path):
    folder = _broken(views, tmp_path, lambda d: d["views"][0].update(name="0.png"))
    (folder / "masks" / "0.png").rename(folder / "masks" / "0.png.png")
    np.testing.assert_array_equal(read_views(folder)[0].mask, views[0].mask)


def test_a_picture_that_lies_on_its_side_is_refused(views, tmp_path):
    folder = _broken(views, tmp_path, lambda d: d["views"][0].update(K=[[60, 0, 32], [0, 60, 24], [0, 0, 1]]))
    Image.new("RGB", (48, 64)).save(folder / "images" / "0.png")
    with pytest.raises(GeometryError, match=r"view '0'.*turned by 90 degrees"):
        read_views(folder)


def test_a_lens_without_distortion_is_a_pinhole(views, tmp_path):
    none = {"distortion_model": "plumb_bob", "D": [0.0] * 5, "k1": 0, "p2": None}
    assert len(read_views(_broken(views, tmp_path, lambda d: d.update(none)))) == len(views)


def test_depth_in_integers_is_refused(views, tmp_path):
    write_plain(tmp_path, views)
    np.save(tmp_path / "depth" / "0.npy", np.full(views[0].image.shape[:2], 850, np.uint16))
    with pytest.raises(GeometryError, match=r"depth/0\.npy has integers.*metres"):
        read_views(tmp_path)


def test_a_mask_of_several_labels_is_refused(views, tmp_path):
    write_plain(tmp_path, views)
    labels = np.arange(views[0].image[..., 0].size).reshape(views[0].image.shape[:2]) % 3
    Image.fromarray(labels.astype(np.uint8)).save(tmp_path / "masks" / "0.png")
    with pytest.raises(GeometryError, match=r"masks/0\.png has the values 0, 1, 2"):
        read_views(tmp_path)


def _broken(views, tmp_path, change):
    write_plain(tmp_path, views)
    document = json.loads((tmp_path / "cameras.json").read_text())
    change(document)
    (tmp_path / "cameras.json").write_text(json.dumps(document))
    return tmp_path


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda d: d["views"][1].update(K=[[0, 0, 0], [0, 1, 0], [0, 0, 1]]), "view '1'.*singular"),
        (lambda d: d["views"][1].update(T=np.diag([1.0, 1, -1, 1]).tolist()), r"view '1'.*determinant -1"),
        (lambda d: d["views"][2].update(T=np.diag([2.0, 2, 2, 1]).tolist()), "view '2'.*orthonormal"),
        (lambda d: d["views"][0].pop("T"), "view '0'.*needs K, and T"),
        (lambda d: d["views"][0].update(name="9"), "view '9'.*no .*9.png"),
        (lambda d: d["views"][0].update(name="../images/0"), "view '../images/0'.*out of the folder"),
        (lambda d: d["views"][0].update(name="/etc/0"), "view '/etc/0'.*out of the folder"),
        (lambda d: d.update(convention="directx"), "'directx' is unknown.*opencv, opengl"),
        (lambda d: d["views"][0].update(K=[[100, 0, 48], [0, 100, 48], [0, 0, 1]]), "view '0'.*96x96 pixels"),
        (lambda d: d["views"][0].update(K=[[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]]), "view '0'.*shares"),
        (lambda d: d["views"][1].update(distortion=[0, 0.1, 0, 0, 0]), "view '1'.*distorted .distortion."),
        (lambda d: d.update(k1=-0.3), "view '0'.*distorted .k1.*undistort"),
        (lambda d: d["views"][1].update(name="0"), "two views are called '0'"),
        (lambda d: d.update(views=[]), "lists 0 views"),
        (lambda d: d.update(views=[3]), "list 'views'"),
        (lambda d: d.pop("views"), "list 'views'"),
    ],
)
def test_plain_trouble_is_named(views, tmp_path, change, what):
    with pytest.raises(GeometryError, match=what):
        read_views(_broken(views, tmp_path, change))


@pytest.mark.parametrize(
    ("spec", "numbers"),
    [
        ("0-4", (0, 1, 2, 3, 4)),
        ("0-4,7", (0, 1, 2, 3, 4, 7)),
        (" 3 , 1 - 2 ", (3, 1, 2)),
        ("12", (12,)),
        ("5-5", (5,)),
    ],
)
def test_specs(spec, numbers):
    assert parse_view_spec(spec) == numbers


@pytest.mark.parametrize(
    ("spec", "what"),
    [
        ("", "''"),
        ("0-4,", "''"),
        ("a", "'a'"),
        ("4-0", "4-0"),
        ("-3", "'-3'"),
        ("0-2,1", "1 twice"),
        ("0-9999999", "0-9999999"),
    ],
)
def test_what_is_no_spec_is_named(spec, what):
    with pytest.raises(ConfigurationError, match=what):
        parse_view_spec(spec)
