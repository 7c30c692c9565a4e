import numpy as np

from gvla2.perception.clicks import Segments
from gvla2_plugins.sam.perceiver import sheets_of

SIZE = (256, 256)


def marked(*boxes, size=SIZE):
    """Marks 0, 1, ... in boxes of (top, left, bottom, right)."""
    marks = np.full(size, -1)
    for mark, (top, left, bottom, right) in enumerate(boxes):
        marks[top:bottom, left:right] = mark
    return marks


def picture(seed, size=SIZE):
    return np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8)


def test_small_objects_of_four_pictures_share_a_sheet():
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
