"""What all tasks of the suite share: words, sizes, places, and not being done before they begin."""

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.robot.solids import extent
from tests.plugins.tabletop_layouts import TASKS, sample, task

SUITE = (
    "put_block", "push_block", "play_jenga", "open_jar", "close_box", "open_box", "pickup_cup", "take_umbrella",
    "sort_mustard", "open_wine", "lamp_on", "put_knife", "pick_and_lift", "insert_block",
)  # fmt: skip
TABLETOP = ("open_drawer", "open_jar", "sort_object")
NAMED = {"open_jar": ("jar_", "jar"), "pickup_cup": ("cup_", "cup"), "insert_block": ("pillar_", "pillar")}


def size_of(body) -> np.ndarray:
    low, high = extent(body.solids)
    return high - low


@pytest.mark.parametrize("name", TASKS)
def test_scale_changes_sizes(name):
    scale = 0.8
    plain, scaled = (sample(name, 3, scale=k).layout.bodies for k in (1.0, scale))
    pairs = [(size_of(one), size_of(other)) for one, other in zip(plain, scaled, strict=True)]
    ratios = np.concatenate([other / one for one, other in pairs])
    assert np.isclose(ratios, scale, atol=0.01).any()
    assert (np.abs(ratios - 1) <= abs(scale - 1) + 0.06).all()  # boards and walls keep their thickness


@pytest.mark.parametrize("name", TASKS)
@pytest.mark.parametrize("scale", [0.5, 1.3, float("nan")])
def test_a_scale_beyond_the_hand_is_refused(name, scale):
    with pytest.raises(ConfigurationError, match=f"task={name} takes task.scale"):
        task(name, scale=scale)


@pytest.mark.parametrize("name", NAMED)
def test_a_sentence_chooses_by_colour(name):
    prefix, noun = NAMED[name]
    own = sample(name, 5)
    palette = [b.label.removesuffix(f" {noun}") for b in own.layout.bodies if b.name.startswith(prefix)]
    assert len(palette) == len(set(palette)) >= 2
    assert set(palette) <= set(COLOURS)
    assert len(set(colours_in(own.instruction)) & set(palette)) == 1
    goals = {colour: sample(name, 5, f"the {colour.upper()} one").goal for colour in palette}
    for colour, goal in goals.items():
        assert f" {colour} " in goal
        assert not any(f" {other} " in goal for other in set(palette) - {colour})
    assert "names none" in sample(name, 5, "any of them").goal


def test_defaults_are_the_published_sizes():
    def of(name, body):
        layout = sample(name, 1).layout
        return size_of(layout[body])

    near = {"atol": 1e-9, "rtol": 0}
    np.testing.assert_allclose(of("put_block", "block"), 0.0608, **near)
    np.testing.assert_allclose(of("play_jenga", "brick_0_0"), (0.2, 0.067, 0.033), **near)
    np.testing.assert_allclose(of("play_jenga", "loose"), (0.18, 0.0603, 0.0297), **near)
    np.testing.assert_allclose(of("open_jar", "lid_0"), (0.074, 0.074, 0.021), **near)
    np.testing.assert_allclose(of("close_box", "box"), (0.25, 0.35, 0.15), **near)
    np.testing.assert_allclose(of("open_box", "lid"), (0.268, 0.35, 0.01), **near)
    np.testing.assert_allclose(of("take_umbrella", "stand"), (0.10, 0.10, 0.20), **near)
    np.testing.assert_allclose(of("sort_mustard", "tray"), (0.318, 0.318, 0.05), **near)
    np.testing.assert_allclose(of("open_wine", "cap"), (0.028, 0.028, 0.008), **near)
    np.testing.assert_allclose(of("put_knife", "board"), (0.408, 0.26, 0.015), **near)
    np.testing.assert_allclose(of("insert_block", "ring"), (0.05, 0.05, 0.01), **near)
    masses = {"lid": ("open_box", 0.938), "loose": ("play_jenga", 0.327), "ring": ("insert_block", 0.02)}
    for body, (name, mass) in masses.items():
        assert sample(name, 1).layout[body].mass == pytest.approx(mass, abs=5e-4)
