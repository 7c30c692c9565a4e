import io

import numpy as np
import pytest
from PIL import Image

from gvla2.record.drawing import contact_sheet_of, png


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "P"])
def test_a_png_file_shows_the_picture_whatever_its_mode(mode: str):
    rgb = np.zeros((20, 30, 3), np.uint8)
    rgb[:, :10], rgb[:10, 10:] = (250, 10, 90), (20, 200, 40)
    picture = Image.fromarray(rgb).convert(mode)
    read = Image.open(io.BytesIO(png(picture)))
    assert read.size == (30, 20)
    np.testing.assert_array_equal(np.asarray(read.convert("RGBA")), np.asarray(picture.convert("RGBA")))


def test_a_sheet_holds_all_pictures_in_their_colours():
    tiles = {name: png(Image.new("RGB", (40, 30), name)) for name in ("red", "blue")}
    sheet = np.asarray(Image.open(io.BytesIO(contact_sheet_of(tiles))).convert("RGB"))
    for colour in ((255, 0, 0), (0, 0, 255)):
        assert (sheet == colour).all(axis=2).sum() == 1200
    assert contact_sheet_of({}) == b""
