"""What is written on an object, read by the real RapidOCR in pictures drawn here."""

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageFont

from gvla2.errors import MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.views import Observation, View, Views
from gvla2.perception.labels import labelled
from gvla2.perception.options import NamingOptions, labellers
from gvla2.perception.text import TextReader, words_in
from gvla2.planning.scene import Box, Scene, SceneObject

SIZE, HALF, AWAY = 480, 0.5, 1.0  # pixels, metres that half a picture shows, metres
WORKSPACE = Box(np.array([-1.0, -1.0, -0.2]), np.array([1.0, 1.0, 1.0]))


@pytest.fixture(scope="module")
def reader():
    pytest.importorskip("rapidocr")
    return TextReader()


def drawn(*labels, size=SIZE):
    """A level picture of boxes in a row from above, each with its lines of text (text, height as a share)."""
    image = Image.new("RGB", (size, size), (120, 100, 80))
    width = size // len(labels)
    for k, (lines, turn, light) in enumerate(labels):
        side = int(0.84 * width)
        tile = Image.new("RGB", (side, side), light)
        pen, y = ImageDraw.Draw(tile), 4
        for text, share in lines:
            pen.text((6, y), text, fill=(0, 0, 0), font=ImageFont.load_default(share * side))
            y += int(1.3 * share * side)
        image.paste(tile.rotate(turn), (k * width + (width - side) // 2, (size - side) // 2))
    return np.asarray(image)


def seen(image, count):
    """The picture as an observation, and the boxes in it as a scene of nameless boxes."""
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    down[2, 3] = AWAY
    field = 2 * np.arctan(HALF / AWAY)
    camera = Camera.from_fov(field, down, SIZE, SIZE, "above")
    depth = np.full((SIZE, SIZE), AWAY, np.float32)
    coarse = np.asarray(Image.fromarray(image).resize((SIZE, SIZE)))
    fine = View(Camera.from_fov(field, down, len(image), len(image), "above"), image)
    views, objects = Views((View(camera, coarse, depth),)), []
    points, width = views[0].points(), SIZE // count
    for k in range(count):
        side = int(0.84 * width)
        left, top = k * width + (width - side) // 2, (SIZE - side) // 2
        own = points[top : top + side : 4, left : left + side : 4].reshape(-1, 3)
        pose = np.eye(4)
        pose[:3, 3] = own.mean(axis=0)
        extents = np.maximum(np.ptp(own, axis=0), 0.01)
        objects.append(SceneObject(f"o{k}", "gray box", "box", "gray", pose, extents, own))
    finer = (lambda _: fine) if len(image) > SIZE else None
    return Observation(views, np.eye(4), np.zeros(7), 1.0, 0.08, finer), Scene(tuple(objects), 0.0, WORKSPACE)


def named(reader, *labels, size=SIZE):
    observation, scene = seen(drawn(*labels, size=size), len(labels))
    return labelled(scene, observation, [reader]).objects


PALE, DARK, DIM = (230, 225, 200), (60, 55, 45), (12, 12, 12)


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_words_are_read_in_all_turns_and_belong_to_the_object_that_carries_them(reader, turn):
    ketchup, plain = named(reader, ([("KETCHUP", 0.18)], turn, PALE), ([], 0, PALE))
    assert (ketchup.label, ketchup.named_by) == ("ketchup box", "text")
    assert ketchup.sureness > 0.8
    assert (plain.label, plain.named_by) == ("gray box", "")


def test_the_name_is_in_the_largest_print_also_in_the_shadow(reader):
    (obj,) = named(reader, ([("PUDDING", 0.15), ("add milk", 0.06), ("then stir well", 0.1)], 0, DARK))
    assert obj.label == "pudding box"


def test_too_dim_or_too_small_print_names_nothing(reader):
    dim, small = named(reader, ([("MUSTARD", 0.18)], 0, (1, 1, 1)), ([("HONEY", 0.01)], 0, PALE))
    assert (dim.named_by, small.named_by) == ("", "")


def test_finer_pictures_are_read_where_there_are_some(reader):
    label = [("PEACHES", 0.03)], 0, PALE
    coarse = named(reader, *4 * [label])
    fine = named(reader, *4 * [label], size=4 * SIZE)
    assert [o.label for o in fine] == 4 * ["peaches box"]
    assert sum(o.label == "peaches box" for o in coarse) < 4


def test_lines_become_words():
    assert words_in("CreamCheese 250g") == ["cream", "cheese"]
    assert words_in("72 %, 牛奶") == []


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rapidocr", None)
    with pytest.raises(MissingDependencyError, match=r"gvla2\[text\]"):
        labellers(NamingOptions(read_text=True))
