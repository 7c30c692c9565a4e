"""Diagnosed causes: of slips and orders in general, and of lids, drawers, caps and rings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from gvla2.episode.failure_diagnosis import diagnose
from gvla2.episode.record import EpisodeRecord
from gvla2.planning.contracts import Candidate, Plan
from gvla2.planning.scene import SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint
from tests import objects
from tests.objects import box, reported, scene, scene_object

move = partial(objects.move, gripper=0.0, allowed_contacts=frozenset({"a"}))


def episode(
    skill: str, before: Sequence[SceneObject], after: Sequence[SceneObject] | None, waypoints: Sequence[Waypoint],
    theta: dict[str, float], *, changes: dict[int, dict[str, Any]] | None = None, roles: dict[str, str] | None = None,
    width: float = 0.02, held: bool | None = True, **plan: Any,
) -> EpisodeRecord:  # fmt: skip
    """Executed as planned but for ``changes`` of reports; the closed hand measures ``width`` and ``held``."""
    made = Plan(Trajectory(tuple(waypoints)), skill, roles or {"theme": "a"}, theta, **plan)
    report = reported(waypoints, changes, width=width, held=held, opened=0.08)
    seen = None if after is None else scene(*after)
    return EpisodeRecord(
        "run/1", "do it", "", 0, {}, scene=scene(*before), plan=made, report=report, after_scene=seen
    )


def signals_of(record: EpisodeRecord) -> list[tuple[Any, ...]]:
    """Kind, and parameter, op and value of the effect, of each signal."""
    return [
        (s.kind, s.effect.parameter, s.effect.op, pytest.approx(s.effect.value, abs=1e-9))
        if s.effect
        else (s.kind,)
        for s in diagnose(record)
    ]


CUBE = (scene_object("a", (0.3, 0, 0.025), (0.05, 0.05, 0.05)),)
PLACE = (
    move("grasp", (0.3, 0, 0.02), gripper=1.0),
    move("close", (0.3, 0, 0.02)),
    move("lift", (0.3, 0, 0.2), carries="a"),
    move("place", (0.5, 0, 0.02), carries="a"),
    move("release", (0.5, 0, 0.02), gripper=1.0, carries="a"),
    move("retreat", (0.5, 0, 0.2), gripper=1.0),
)


def test_opening_the_hand_where_it_is_to_be_opened_is_no_slip() -> None:
    assert signals_of(episode("place", CUBE, None, PLACE, {"grasp_depth": 0.02})) == []
    slipped = episode("place", CUBE, None, PLACE, {"grasp_depth": 0.02}, changes={3: {"held": False}})
    assert signals_of(slipped) == [("slip", "grasp_depth", ">=", 0.025)]


def test_a_bound_goes_with_the_objects_size_where_the_plan_says_so() -> None:
    slipped = episode("place", CUBE, None, PLACE, {"grasp_depth": 0.02}, changes={3: {"held": False}},
                      scales={"grasp_depth": ("height", 0.05)})  # fmt: skip
    (signal,) = diagnose(slipped)
    assert signal.effect is not None
    assert (signal.effect.scale, signal.effect.value) == ("height", pytest.approx(0.5))


SWING = (
    move("reach", (0.16, 0, 0.155), gripper=1.0),
    move("close", (0.16, 0, 0.155)),
    move("swing", (0.3, 0, 0.3), carries="l"),
    move("swing", (0.45, 0, 0.42), carries="l"),
    move("release", (0.45, 0, 0.42), gripper=1.0, carries="l"),
)


@pytest.mark.parametrize("role", ["b", "l"])
@pytest.mark.parametrize(
    ("angle", "width", "expected"),
    [
        (1.9, 0.01, []),
        (0.0, 0.01, [("undershoot", "open_angle", ">=", 1.5)]),
        (0.0, 0.0, [("missed_grasp", "lip_depth", ">=", 0.011)]),
    ],
)
def test_a_lid_that_fell_shut_is_swung_further(
    angle: float, width: float, expected: list[Any], role: str
) -> None:
    theta = {"open_angle": 1.3, "lip_depth": 0.006}
    record = episode(
        "open", box(0.0), box(angle), SWING, theta, width=width, held=False, roles={"theme": role}
    )
    assert signals_of(record) == expected


PULL = (
    move("close", (0.16, 0, 0.12)),
    move("pull", (0.01, 0, 0.12), carries="h"),
    move("release", (0.01, 0, 0.12), gripper=1.0, carries="h"),
)


@pytest.mark.parametrize(
    ("out", "width", "expected"),
    [
        (0.148, 0.01, []),
        (0.12, 0.01, [("undershoot", "pull_distance", ">=", 0.18)]),
        (0.02, 0.01, [("undershoot", "pull_distance", ">=", 0.2)]),  # no more at a time
        (0.02, 0.0, [("slip", "grasp_depth", ">=", 0.011)]),
    ],
)
def test_a_drawer_that_came_short_is_pulled_further(out: float, width: float, expected: list[Any]) -> None:
    before, after = (
        (scene_object("d", (0.2 - x, 0, 0.08), (0.012, 0.25, 0.12), "blue"),) for x in (0.0, out)
    )
    theta = {"pull_distance": 0.15, "grasp_depth": 0.006}
    record = episode("pull", before, after, PULL, theta, width=width, held=None, roles={"theme": "d"})
    assert signals_of(record) == expected


TWIST = (
    move("close", (0.3, 0, 0.28)),
    move("turn", (0.3, 0, 0.28)),
    move("lift", (0.3, 0, 0.4), carries="k"),
)


@pytest.mark.parametrize(
    ("z", "width", "expected"),
    [
        (0.285, 0.026, [("undershoot", "turn", ">=", 2.285)]),
        (0.285, 0.0, []),  # nothing was between the fingers while they turned
        (0.4, 0.026, []),
    ],
)
def test_a_cap_that_stayed_on_is_turned_further(z: float, width: float, expected: list[Any]) -> None:
    before, after = (
        (scene_object("k", (0.3, 0, h), (0.028, 0.028, 0.01), "red", "disc"),) for h in (0.285, z)
    )
    record = episode(
        "twist", before, after, TWIST, {"turn": 1.5}, width=width, held=None, roles={"theme": "k"}
    )
    assert signals_of(record) == expected


def test_an_approach_is_forbidden_when_another_one_is_left() -> None:
    stuck = {0: {"abort": "unreachable", "message": "no IK"}}
    top = Candidate("from above", 1.0, approaches=("approach:top",))
    lean = Candidate("leaning", 0.9, approaches=("approach:top", "approach:leaning"))
    side = Candidate("from the side", 0.5, approaches=("approach:side",))
    for candidates, expected in (
        ((top, side), "approach:top"),
        ((lean, top, side), "approach:leaning"),
        ((top, replace(side, rejected="out of reach")), None),
        ((top, top), None),  # every way left is the same approach
    ):
        record = episode("pick", CUBE, None, PLACE[:3], {}, changes=stuck, candidates=candidates)
        (signal,) = diagnose(record)
        assert (signal.effect.parameter if signal.effect else None) == expected


def test_what_the_mechanism_held_back_is_no_slip() -> None:
    lost = {"held": False, "gripper_width": 0.0, "abort": "slipped"}
    cap = (scene_object("k", (0.3, 0, 0.285), (0.028, 0.028, 0.01), "red", "disc"),)
    theta = {"turn": 1.5, "grasp_depth": 0.005}
    for after, expected in (
        (cap, [("undershoot", "turn", ">=", 2.285)]),
        (
            (scene_object("k", (0.4, 0, 0.005), (0.028, 0.028, 0.01), "red", "disc"),),
            [("slip", "grasp_depth", ">=", 0.01)],
        ),
    ):
        record = episode("twist", cap, after, TWIST, theta, changes={2: lost}, roles={"theme": "k"})
        assert signals_of(record) == expected
    for out, expected in (
        (0.12, [("overshoot", "pull_distance", "<=", 0.12)]),
        (0.03, [("slip", "grasp_depth", ">=", 0.018)]),
    ):
        before, after = (
            (scene_object("d", (0.2 - x, 0, 0.08), (0.012, 0.25, 0.12), "blue"),) for x in (0.0, out)
        )
        theta = {"pull_distance": 0.15, "grasp_depth": 0.006}
        record = episode("pull", before, after, PULL, theta, changes={1: lost}, roles={"theme": "d"})
        assert signals_of(record) == expected


PRESS = (move("approach", (0, 0, 0.1)), move("press", (0, 0, 0.02)), move("retreat", (0, 0, 0.1)))


DARK = (0.3, 0.3, 0.3)


@pytest.mark.parametrize(
    ("shade", "status", "error", "depth", "seconds", "expected"),
    [
        ((0.9, 0.9, 0.6), "linear", 0.0, 0.01, 0.0, []),
        (DARK, "linear", 0.0001, 0.01, 0.0, [("undershoot", "press_depth", ">=", 0.013)]),
        (DARK, "guarded", 0.0, 0.01, 0.0, [("overshoot", "press_depth", "<=", 0.007)]),
        (DARK, "linear", 0.0006, 0.01, 0.0, [("overshoot", "press_depth", "<=", 0.007)]),
        (DARK, "guarded", 0.001, 0.013, 0.0, [("undershoot", "press_seconds", ">=", 1.5)]),
        (DARK, "linear", 0.001, 0.013, 1.5, [("undershoot", "press_seconds", ">=", 3.0)]),
        (DARK, "linear", 0.001, 0.013, 3.0, [("overshoot", "press_depth", "<=", 0.010)]),
        (DARK, "guarded", 0.004, 0.013, 0.0, [("overshoot", "press_depth", "<=", 0.010)]),
    ],
)
def test_a_lamp_that_stayed_dark_is_pressed_deeper_less_deep_or_longer(
    shade: Any, status: str, error: float, depth: float, seconds: float, expected: list[Any]
) -> None:
    def lamp(rgb: Any) -> tuple[SceneObject, ...]:
        base = replace(
            scene_object("l", (0.05, 0, 0.005), (0.16, 0.08, 0.01), "gray"), label="gray lamp base"
        )
        top = replace(
            scene_object("s", (0.1, 0, 0.08), (0.06, 0.06, 0.03), "gray", parent="l"), rgb=np.array(rgb)
        )
        return base, top, scene_object("b", (0, 0, 0.02), (0.03, 0.03, 0.03), "red", "cylinder", parent="l")

    changes = {1: {"status": status, "error": error}}
    record = episode(
        "press", lamp(DARK), lamp(shade), PRESS, {"press_depth": depth, "press_seconds": seconds},
        changes=changes, roles={"theme": "b", "part": "b"},
    )  # fmt: skip
    assert signals_of(record) == expected


@pytest.mark.parametrize(
    ("widths", "turn", "expected"),
    [
        ((0.026, 0.0265), 2.88, ("undershoot", "turn", ">=", 2.88 + 0.785)),
        ((0.038, 0.026), 2.88, ("stalled", "turn", "<=", -2.88)),
        ((0.0235, 0.026), -2.88, ("stalled", "turn", ">=", 2.88)),
        ((0.038, 0.026), 4.3, ("stalled", "turn", "<=", -np.pi)),
        ((0.026, 0.026), -2.88, ("undershoot", "turn", "<=", -2.88 - 0.785)),
    ],
)
def test_fingers_that_were_forced_apart_tell_that_a_cap_opens_the_other_way(
    widths: tuple[float, float], turn: float, expected: tuple[Any, ...]
) -> None:
    bottle = scene_object("g", (0, 0, 0.1), (0.07, 0.07, 0.2), "blue", "cylinder")
    cap = scene_object("k", (0, 0, 0.21), (0.028, 0.028, 0.008), "gray", "disc", parent="g")
    way = (
        move("close", (0, 0, 0.21)), move("turn", (0, 0, 0.21)), move("turn", (0, 0, 0.21)),
        move("lift", (0, 0, 0.33), carries="k"),
    )  # fmt: skip
    changes: dict[int, dict[str, Any]] = {i + 1: {"gripper_width": width} for i, width in enumerate(widths)}
    changes[3] = {"abort": "slipped", "held": False, "gripper_width": 0.0}
    record = episode(
        "twist",
        (bottle, cap),
        (bottle, cap),
        way,
        {"turn": turn},
        width=0.026,
        changes=changes,
        roles={"theme": "k"},
    )
    (found,) = signals_of(record)
    assert found == (*expected[:3], pytest.approx(expected[3]))


@pytest.mark.parametrize(
    ("error", "expected"),
    [(0.0, ("held_fast", "unlatch_lift", ">=", 0.018)), (0.004, ("overshoot", "unlatch_lift", "<=", 0.002))],
)
def test_a_drawer_that_a_catch_holds_is_lifted_first(error: float, expected: tuple[Any, ...]) -> None:
    cabinet = scene_object("c", (0.5, 0, 0.1), (0.2, 0.3, 0.2), "blue")
    front = scene_object("a", (0.38, 0, 0.1), (0.02, 0.25, 0.1), "red", parent="c")
    way = (
        move("close", (0.35, 0, 0.1)), move("unlatch", (0.35, 0, 0.11), carries="a"),
        move("pull", (0.2, 0, 0.11), carries="a"),
    )  # fmt: skip
    changes = {1: {"error": error}, 2: {"abort": "slipped", "held": False, "gripper_width": 0.0}}
    record = episode(
        "pull",
        (cabinet, front),
        (cabinet, front),
        way,
        {"pull_distance": 0.15, "unlatch_lift": 0.01},
        changes=changes,
    )
    (found,) = signals_of(record)
    assert found == (*expected[:3], pytest.approx(expected[3]))
