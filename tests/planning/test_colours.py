import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from skimage.color import rgb2lab

from gvla2.planning.colours import (
    COLOURS,
    DISTINCT,
    appearance,
    colour_distance,
    colours_in,
    meant_by,
    nearest_colours,
)


def test_looks_are_of_cielab_and_free_of_shading():
    rgb = np.vstack([np.zeros(3), np.ones(3), np.random.default_rng(0).random((50, 3)) ** 3])
    L, a, b = rgb2lab(rgb).T
    expected = np.stack([100 * a / (L + 16), 100 * b / (L + 16), 0.5 * L], axis=-1)
    np.testing.assert_allclose(appearance(rgb), expected, atol=1e-9)


def test_there_are_twenty_words_and_each_is_nearest_to_itself():
    assert len(COLOURS) == 20
    for name, rgb in COLOURS.items():
        assert nearest_colours(rgb, 1) == ((name, pytest.approx(0.0)),)


@pytest.mark.parametrize(
    ("seen", "name"),
    [
        ((0.80, 0.09, 0.09), "red"), ((0.09, 0.19, 0.79), "blue"),  # bright, in slightly white light
        ((0.45, 0.04, 0.05), "maroon"), ((0.04, 0.05, 0.45), "navy"), ((0.06, 0.03, 0.03), "black"),
    ],
)  # fmt: skip
def test_dark_shades_differ_from_bright_ones_by_brightness(seen, name):
    assert nearest_colours(seen, 1)[0][0] == name


@settings(max_examples=60, deadline=None)
@given(name=st.sampled_from(sorted(COLOURS)), shade=st.floats(0.6, 1.0))
def test_shading_never_turns_a_colour_into_a_distinct_one(name, shade):
    seen = nearest_colours(np.array(COLOURS[name]) * shade, 1)[0][0]
    assert colour_distance(COLOURS[seen], COLOURS[name]) < DISTINCT


@pytest.mark.parametrize(
    ("sentence", "words"),
    [
        ("Pick up the RED cube, not the blue one.", ("red", "blue")),
        ("the grey block and the gray block", ("gray",)),
        ("covered in a reddish evergreen", ()),
        ("olive, navy; teal!", ("olive", "navy", "teal")),
    ],
)
def test_colours_in_a_sentence(sentence, words):
    assert colours_in(sentence) == words


@pytest.mark.parametrize(
    ("word", "present", "meant"),
    [
        ("blue", ["azure", "blue"], "blue"),
        ("blue", ["azure", "navy"], ""),
        ("pink", ["magenta", "gray"], "magenta"),
        ("dark blue", ["navy", "azure"], "navy"),
        ("red", ["maroon"], ""),
        ("white", ("silver", "red"), "silver"),
        ("white", ("gray",), ""),
    ],
)
def test_people_mean_a_shade_by_its_basic_term_where_there_is_only_one(word, present, meant):
    assert meant_by(word, present) == meant
