import numpy as np
import pytest

from gvla2.perception.prompting import Segments
from gvla2_plugins.sam.sheets import MARGIN, areas, packed, sheets_of

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
    back = sheet.back(1, Segments(logits, np.array([[0.9]])))
    assert (back.masks()[0, 0] == (marks[1] == 1)).all()
    assert back.scores.tolist() == [[0.9]]
    assert not sheet.back(0, Segments(logits, np.array([[0.9]]))).masks().any()


def test_where_sheets_save_nothing_pictures_stay_whole():
    full = marked((5, 5, 250, 250))
    images = [picture(0), picture(1)]
    sheets = sheets_of(images, [full, full])
    assert [(s.image == i).all() for s, i in zip(sheets, images, strict=True)] == [True, True]


def test_pictures_of_two_sizes_have_sheets_of_their_own_and_empty_ones_none():
    images = [picture(0), picture(1, (120, 160)), picture(2)]
    marks = [marked((5, 5, 20, 20)), marked((5, 5, 20, 20), size=(120, 160)), marked()]
    assert sorted(s.image.shape[:2] for s in sheets_of(images, marks)) == [(120, 160), SIZE]
    assert sheets_of(images[2:], marks[2:]) == []


def test_things_side_by_side_are_one_part_with_a_margin():
    marks = marked((100, 100, 110, 110), (100, 120, 110, 140), (200, 30, 220, 50))
    found = areas(marks)
    assert len(found) == 2
    assert (slice(100 - MARGIN, 110 + MARGIN), slice(100 - MARGIN, 140 + MARGIN)) in found
    assert areas(marked((0, 0, 256, 256))) == [(slice(0, 256), slice(0, 256))]


@pytest.mark.parametrize("seed", range(5))
def test_tiles_lie_on_their_sheets_and_not_on_one_another(seed):
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(12):
        low, long = rng.integers(0, 100, 2), rng.integers(20, 150, 2)
        parts.append((k, tuple(slice(int(a), int(a + b)) for a, b in zip(low, long, strict=True))))
    sheets = packed(parts, SIZE)
    assert sorted(t.picture for tiles in sheets for t in tiles) == list(range(12))
    for tiles in sheets:
        taken = np.zeros(SIZE, int)
        for tile in tiles:
            assert all(0 <= side.start < side.stop <= 256 for side in tile.place)
            taken[tile.place] += 1
        assert taken.max() == 1
