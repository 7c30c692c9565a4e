"""Typed effects contradict each other exactly, or not."""

from typing import Any

import pytest

from gvla2.memory.curation.contesting import effects_conflict


def bound(op: str, value: float, **more: Any) -> dict[str, Any]:
    return {"kind": "bound", "parameter": "lift", "op": op, "value": value, **more}


def prior(value: float, count: int = 1, sd: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"kind": "prior", "parameter": "lift", "value": value, "count": count, "sd": sd, **more}


PROGRAM = {"kind": "program", "skill": "pick", "language": "calls", "steps": ["lift 5 cm"]}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (bound(">=", 0.3), bound("<=", 0.2)),
        (prior(0.3, 5, 0.01), prior(0.1, 5, 0.01)),
        (prior(0.3), prior(0.1)),
        ({"kind": "forbid", "parameter": "lift"}, prior(0.1)),
    ],
)
def test_effects_that_leave_nothing_between_them(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert "lift" in effects_conflict(first, second)
    assert effects_conflict(second, first)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (bound(">=", 0.1), bound("<=", 0.2)),
        (bound(">=", 0.3), bound(">=", 0.1)),
        (bound(">=", 0.3, scale="height"), bound("<=", 0.2)),
        (bound(">=", 0.3, object="cup"), bound("<=", 0.2, object="jar")),
        (bound(">=", 0.3, skill="pick"), bound("<=", 0.2, skill="push")),
        (prior(0.3, 2, 0.1), prior(0.2, 2, 0.1)),
        (bound(">=", 0.3), {**bound("<=", 0.2), "parameter": "depth"}),
        (bound(">=", float("nan")), bound("<=", 0.2)),
        (bound(">=", 0.3), {"kind": "bound", "parameter": "lift", "op": "<=", "value": "much"}),
        (PROGRAM, {**PROGRAM, "steps": ["lift 50 cm"]}),
        (PROGRAM, prior(0.3)),
        ({"kind": "forbid", "parameter": "lift"}, {"kind": "forbid", "parameter": "lift"}),
    ],
)
def test_effects_that_fit_or_cannot_be_compared(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert effects_conflict(first, second) == ""
    assert effects_conflict(second, first) == ""
