"""Twins keep their identities over two perceptions that word and measure them a little differently."""

from dataclasses import replace

import numpy as np

from gvla2.episode.evidence import correspond
from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Box, KnownShape, Scene, SceneObject

SPACE = Box(np.array([-1, -1, 0.0]), np.array([1, 1, 2.0]))


def lid(id_: str, label: str, x: float, z: float, height: float) -> SceneObject:
    return SceneObject(id_, label, "disc", "gray", rigid(translation=(x, 0.0, z)), np.array([0.074, 0.074, height]),
                       np.zeros((0, 3)), np.full(3, 0.5))  # fmt: skip


def test_what_stays_where_it_was_is_itself_whatever_it_is_called_the_second_time() -> None:
    before = Scene(
        (lid("stays", "gray disc", 0.0, 0.13, 0.021), lid("goes", "gray lid", 0.3, 0.13, 0.024)), 0.0, SPACE
    )
    after = Scene(
        (lid("p", "gray lid", 0.0, 0.13, 0.024), lid("q", "gray disc", 0.35, 0.01, 0.021)), 0.0, SPACE
    )
    found = correspond(before, after)
    assert {name: later.id for name, later in found.items()} == {"stays": "p", "goes": "q"}


def test_a_moved_thing_is_found_by_its_looks_even_where_another_one_stood() -> None:
    def cube(id_: str, x: float, rgb: tuple[float, float, float], colour: str) -> SceneObject:
        return SceneObject(id_, f"{colour} cube", "box", colour, rigid(translation=(x, 0, 0.025)), np.full(3, 0.05),
                           np.zeros((0, 3)), np.array(rgb))  # fmt: skip

    red, blue = (0.8, 0.1, 0.1), (0.1, 0.1, 0.8)
    before = Scene((cube("r", 0.0, red, "red"), cube("b", 0.3, blue, "blue")), 0.0, SPACE)
    after = Scene((cube("p", 0.0, blue, "blue"), cube("q", 0.3, red, "red")), 0.0, SPACE)
    assert {k: v.id for k, v in correspond(before, after).items()} == {"r": "q", "b": "p"}


def test_of_known_objects_the_names_decide_not_their_looks() -> None:
    def bowl(id_: str, label: str, x: float, rgb: float) -> SceneObject:
        known = KnownShape(label, f"{label}.glb", rigid(translation=(x, 0, 0.03)))
        return SceneObject(id_, label, "cylinder", "gray", rigid(translation=(x, 0, 0.03)), np.full(3, 0.06),
                           np.zeros((0, 3)), np.full(3, rgb), known=known)  # fmt: skip

    before = Scene((bowl("a", "black bowl", 0.0, 0.5), bowl("b", "ramekin", 0.3, 0.5)), 0.0, SPACE)
    # The bowl was moved into a shadow, beside a ramekin that looks as the bowl did.
    after = Scene((bowl("p", "ramekin", 0.3, 0.5), bowl("q", "black bowl", 0.4, 0.1)), 0.0, SPACE)
    assert {k: v.id for k, v in correspond(before, after).items()} == {"a": "q", "b": "p"}
    gone = Scene((bowl("p", "ramekin", 0.0, 0.5),), 0.0, SPACE)
    assert "a" not in correspond(before, gone)
    # Nor is it the body of a stove that the same gallery names, of whose parts none has a scan of its own.
    stove = replace(gone.objects[0], label="flat stove", known=None)
    assert "a" not in correspond(before, replace(gone, objects=(stove,)))


def test_what_was_read_on_an_object_tells_it_from_another_of_its_looks() -> None:
    def package(id_: str, label: str, x: float) -> SceneObject:
        return SceneObject(id_, label, "box", "red", rigid(translation=(x, 0.0, 0.05)), np.array([0.05, 0.07, 0.1]),
                           np.zeros((0, 3)), np.array([0.8, 0.1, 0.1 + 0.2 * abs(x)]), named_by="text")  # fmt: skip

    before = Scene(
        (package("pudding", "chocolate pudding box", 0.0), package("k", "tomato ketchup box", 0.3)),
        0.0,
        SPACE,
    )
    after = Scene((package("p", "fomato etchup box", 0.45),), 0.0, SPACE)
    assert {k: v.id for k, v in correspond(before, after).items()} == {"k": "p"}
    misread = Scene((package("p", "dding box", 0.0),), 0.0, SPACE)
    assert correspond(before, misread)["pudding"].id == "p"
