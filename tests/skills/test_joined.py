"""Pieces of one object that were seen apart, objects that share a container, and candidates kept in reserve."""

from __future__ import annotations

import numpy as np
import pytest

from gvla2.planning.part_hierarchy import joined
from gvla2.planning.scene import SceneObject
from tests.skills.scenes import TABLE, asked, named, request


def umbrella(xy=(0.15, -0.07)) -> tuple[SceneObject, ...]:
    """Folds, shaft and handle, each seen as an object of its own, in a stand."""
    return (
        named("f", "magenta bottle", "cylinder", (*xy, 0.097), (0.056, 0.056, 0.194)),
        named("h", "magenta umbrella", "cylinder", (*xy, 0.255), (0.024, 0.024, 0.064)),
        named("s", "silver stick", "box", (*xy, 0.117), (0.012, 0.010, 0.213)),
        named("d", "gray stand", "box", (*xy, 0.098), (0.10, 0.10, 0.196), opening=0.087),
    )


@pytest.mark.parametrize("name", ["s", "h"])
def test_what_is_on_the_end_of_a_stick_is_of_it(name):
    objects = umbrella()
    scene = request(*objects).scene
    main, after = joined(scene[name], scene)
    assert main.id == "h"  # what can be got hold of
    assert after["s"].parent == "h"
    assert after["d"].parent == ""  # it stands in the stand, it is not of it
    made, _ = asked("take the silver stick out of the stand", *objects)
    assert made.roles["theme"] == "h"
    close, lift = (next(w for w in made.trajectory if w.stage == s) for s in ("close", "lift"))
    assert close.xyz[2] > TABLE + 0.213
    assert lift.xyz[2] - close.xyz[2] > 0.196


def test_the_shaded_side_of_a_bottle_is_the_bottle():
    lit = named("a", "yellow bottle", "box", (0.2, -0.2, 0.068), (0.08, 0.047, 0.137))
    shaded = named("b", "olive box", "box", (0.2, -0.187, 0.068), (0.08, 0.021, 0.136))
    tray = named("t", "gray tray", "box", (0.25, 0.15, 0.025), (0.3, 0.3, 0.05), opening=0.28)
    made, _ = asked("put the yellow bottle in the tray", lit, shaded, tray)
    assert made.trajectory is not None, made.abstention


def test_what_stands_beside_on_or_in_something_stays_an_object_of_its_own():
    cube = named("a", "red cube", "box", (0.2, 0.0, 0.025), (0.05, 0.05, 0.05))
    on_top = named("b", "blue cube", "box", (0.2, 0.0, 0.075), (0.05, 0.05, 0.05))
    beside = named("c", "lime cube", "box", (0.2, 0.051, 0.025), (0.05, 0.05, 0.05))
    tray = named("t", "gray tray", "box", (0.2, 0.0, 0.03), (0.3, 0.3, 0.06), opening=0.28)
    knife = named("k", "red knife", "box", (0.4, 0.0, 0.19), (0.02, 0.015, 0.08))
    block = named("w", "brown block", "box", (0.4, 0.0, 0.075), (0.08, 0.05, 0.15))
    scene = request(cube, on_top, beside, tray, knife, block).scene
    for each in scene.objects:
        assert joined(each, scene) == (each, scene)


def test_objects_that_share_a_bin_lie_across_the_line_between_them():
    bins = named("r", "rose tray", "box", (0.33, 0.02, 0.025), (0.17, 0.17, 0.05), 0.4, opening=0.158)
    other = named("m", "lime tray", "box", (0.06, 0.30, 0.025), (0.17, 0.17, 0.05), opening=0.158)
    bar = named("b", "rose box", "box", (0.2, -0.26, 0.024), (0.084, 0.042, 0.048), 1.0)
    cube = named("c", "rose cube", "box", (0.4, -0.34, 0.027), (0.054, 0.054, 0.054), -0.6)
    made, _ = asked("put every object into the bin that has its colour", bins, other, bar, cube)
    assert made.trajectory is not None, made.abstention
    assert {made.roles["theme_1"], made.roles["theme_2"]} == {"b", "c"}


def test_the_first_of_two_objects_for_one_place_leaves_room_for_the_other():
    board = named("p", "gray board", "box", (0.3, 0.1, 0.01), (0.24, 0.18, 0.02))
    red = named("a", "red cube", "box", (0.2, -0.2, 0.025), (0.05, 0.05, 0.05))
    blue = named("b", "blue cube", "box", (0.4, -0.2, 0.025), (0.05, 0.05, 0.05))

    def left(sentence: str) -> float:
        made, _ = asked(sentence, board, red, blue)
        assert made.trajectory is not None, made.abstention
        (let_go,) = (w for w in made.trajectory if w.stage == "release")
        return float(np.linalg.norm(np.subtract(let_go.xyz, board.centre)[:2]))

    assert left("put the red cube on the gray board") < 0.01
    assert 0.03 < left("put the red cube and the blue cube on the gray board") < 0.07


def test_what_is_kept_in_reserve_is_not_asked_for_while_something_else_does():
    def drawer(x: float, y: float) -> tuple[SceneObject, ...]:
        return (
            named("c", "azure cabinet", "box", (x, y, 0.08), (0.24, 0.28, 0.16)),
            named("d", "lime drawer", "box", (x - 0.114, y, 0.08), (0.012, 0.248, 0.128), parent="c"),
            named("h", "gray handle", "bar", (x - 0.16, y, 0.125), (0.012, 0.11, 0.012), parent="d"),
        )

    near, far = (asked("open the drawer", *drawer(*xy))[0] for xy in ((0.14, -0.1), (0.30, 0.15)))
    beside = [any("beside" in c.description for c in made.candidates) for made in (near, far)]
    assert beside == [True, False]
