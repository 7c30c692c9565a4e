"""Pictures for vision models, and the points that they answer with, sound and otherwise."""

import io
import time

import numpy as np
import pytest
from PIL import Image

from gvla2.errors import ConfigurationError
from gvla2.planning.pictures import (
    MAX_CHARACTERS,
    MAX_POINTS,
    PictureOptions,
    Stroke,
    encoded,
    read_path,
    read_points,
)
from gvla2.testing import inputs

PATH = (
    "<ans>[(0.25, 0.32), (0.3, 0.5), <action>Close Gripper</action>, (0.7, 0.2), "
    "<action>Open Gripper</action>]</ans>"
)


def test_a_path_carries_the_hands_state_and_where_it_changes():
    assert read_path(PATH) == (
        Stroke(0.25, 0.32, 1.0),
        Stroke(0.3, 0.5, 0.0, event=True),
        Stroke(0.7, 0.2, 1.0, event=True),
    )
    path = read_path("<ans>[<action>Close Gripper</action>, (0.1, 0.2), (0.3, 0.4)]</ans>")
    assert path == (Stroke(0.1, 0.2, 0.0), Stroke(0.3, 0.4, 0.0)), "closed from the start"


@pytest.mark.parametrize(
    "text",
    [
        "[(0.25, 0.5), (1, .5)]",
        "Sure! Here you go:\n[(0.25, 0.5), (1.0, 0.5)]\nAnything else?",
        "<ans>[(0.25,0.5),(1.,0.5),]</ans>",
        "The cube at (0.9, 0.9) is first. [(0.25, 0.5), (1, 0.5)]",
        "[(0.25, 0.5), (1, 0.5)] and once more [(0.25, 0.5), (1, 0.5)]",
    ],
)
def test_points_are_found_in_what_surrounds_them(text):
    assert read_points(text) == ((0.25, 0.5), (1.0, 0.5))


def test_models_count_to_what_they_were_taught():
    assert read_points("[(250, 500)]", scale=1000) == ((0.25, 0.5),)
    for wrong in ({"scale": 0.0}, {"scale": float("nan")}, {"longest": 63}, {"longest": 5000}):
        with pytest.raises(ConfigurationError, match=f"{next(iter(wrong))} is"):
            PictureOptions(**wrong)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no list of points"),
        ("[(x1, y1), (x2, y2)]", "no list of points"),
        ("<ans>[]</ans>", "no point"),
        ("<ans>[<action>Open Gripper</action>]</ans>", "no point"),
        ("[(0.2, 0.3), (1.2, 0.3)]", "outside the picture; coordinates are 0 to 1"),
        ("[(nan, 0.3)]", "outside the picture"),
        ("[(0.2,)]", "1 numbers; a point has two"),
        ("[(0.2, 0.3)] or [(0.4, 0.3)]", "several lists"),
        ("<ans>[(0.2, 0.3)]</ans> <ans>[(0.3, 0.3)]</ans>", "several lists"),
        ("<ans>[(0.2, 0.3), <action>Explode</action>]</ans>", "'<action>Explode</action>' is neither"),
        (f"[{', '.join(['(0.5, 0.5)'] * (MAX_POINTS + 1))}]", f"more than {MAX_POINTS} points"),
        (f"[{', '.join(['(0.5, 0.5)'] * 10_000)}]", "characters; give the list alone"),
    ],
)
def test_everything_else_is_refused_with_its_reason(text, said):
    with pytest.raises(ValueError, match=said.replace("(", r"\(")):
        read_path(text)


@pytest.mark.parametrize(
    "piece", ["[", "(", " ", "1", "[(1,1)" + " " * 50, "(0.1, 0.1), ", "<ans>", "<action>"]
)
def test_no_answer_takes_long_to_read(piece):
    text = (piece * MAX_CHARACTERS)[:MAX_CHARACTERS]
    began = time.perf_counter()
    with pytest.raises(ValueError, match=r"."):
        read_path(text)
    assert time.perf_counter() - began < 1.0


@pytest.fixture(scope="module")
def view():
    return inputs.observation(160).views[0]


def decoded(png):
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def test_a_picture_keeps_its_shares_when_it_shrinks(view):
    small = decoded(encoded(view, 80))
    assert small.shape == (80, 80, 3)
    red = [
        np.argwhere(a[..., 0] - a[..., 2] > 100).mean(axis=0) / len(a)
        for a in (small, view.image.astype(int))
    ]
    np.testing.assert_allclose(red[0], red[1], atol=0.01)
