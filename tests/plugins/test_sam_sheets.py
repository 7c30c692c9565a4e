import numpy as np
import pytest

from gvla2.perception.clicks import Segments
from gvla2_plugins.sam.perceiver import MARGIN, about, packed, sheets_of

SIZE = (256, 256)


def marked(*boxes, size=SIZE):
    """Marks 0, 1, ... in boxes of (top, left, bottom, right)."""
    marks = np.full(size, -1)
    for mark, (top, left, bottom, right) in enumerate(boxes):
        marks[top:bottom, left:right] = mark
    return marks


def picture(seed, size=SIZE):
    return np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)


def test_small_things_of_four_pictures_share_a_sheet():
    marks = [np.where(marked((100, 90, 130, 120)) >= 0, k, -1) for k in range(4)]
    images = [picture(k) for k in range(4)]
    (sheet,) = sheets_of(images, marks)
    for tile in sheet.tiles:
        assert (sheet.image[tile.place] == images[tile.picture][tile.area]).all()
    assert [int((sheet.marks == k).sum()) for k in range(4)] == [900] * 4


def test_an_answer_goes_back_to_where_it_was_asked():
    marks = [marked((10, 10, 40, 60)), np.where(marked((200, 150, 240, 200)) >= 0, 1, -1)]
    (sheet,) = sheets_of([picture(0), picture(1)], marks)
    logits = np.where(sheet.marks == 1, 5.0, -5.0).astype(np.float32)[None, None]
    answer = Segments(logits, np.array([[0.9]]))
    assert (sheet.back(1, answer).masks()[0, 0] == (marks[1] == 1)).all()
    assert sheet.back(1, answer).scores.tolist() == [[0.9]]
    assert not sheet.back(0, answer).masks().any()


def test_where_sheets_save_nothing_pictures_stay_whole():
    full = marked((5, 5, 250, 250), (252, 5, 255, 9))
    images = [picture(0), picture(1)]
    sheets = sheets_of(images, [full, np.where(full >= 0, full + 2, -1)])
    assert [sorted(tile.mark for tile in sheet.tiles) for sheet in sheets] == [[0, 1], [2, 3]]
    assert [(s.image == i).all() for s, i in zip(sheets, images, strict=True)] == [True, True]


def test_pictures_of_two_sizes_have_sheets_of_their_own_and_empty_ones_none():
    images = [picture(0), picture(1, (120, 160)), picture(2)]
    marks = [marked((5, 5, 20, 20)), marked((5, 5, 20, 20), size=(120, 160)), marked()]
    assert sorted(s.image.shape[:2] for s in sheets_of(images, marks)) == [(120, 160), SIZE]
    assert sheets_of(images[2:], marks[2:]) == []


def test_neighbours_in_sight_are_not_asked_for_twice():
    marks = marked((100, 100, 110, 110), (100, 115, 110, 140))
    (sheet,) = sheets_of([picture(0), picture(1)], [marks, np.where(marks >= 0, marks + 2, -1)])
    assert [int((sheet.marks == k).sum()) for k in range(4)] == [100, 250, 100, 250]


def test_a_part_has_a_margin_inside_the_picture():
    first, wide = marked((100, 100, 110, 130)) == 0, marked((0, 0, 256, 256)) == 0
    margin = round(256 * MARGIN)
    assert about(first) == (slice(100 - margin, 110 + margin), slice(100 - margin, 130 + margin))
    assert about(wide) == (slice(0, 256), slice(0, 256))


@pytest.mark.parametrize("seed", range(5))
def test_tiles_lie_on_their_sheets_and_not_on_one_another(seed):
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(12):
        low, long = rng.integers(0, 100, 2), rng.integers(20, 150, 2)
        parts.append((k, k, tuple(slice(int(a), int(a + b)) for a, b in zip(low, long, strict=True))))
    sheets = packed(parts, SIZE)
    assert sorted(t.picture for tiles in sheets for t in tiles) == list(range(12))
    for tiles in sheets:
        taken = np.zeros(SIZE, int)
        for tile in tiles:
            assert all(0 <= side.start < side.stop <= 256 for side in tile.place)
            taken[tile.place] += 1
        assert taken.max() == 1
