"""The terms of S, against the constants they were released with."""

import math
from typing import Any

import pytest

from gvla2.memory.retrieval.scoring import ScoreWeights, score_terms, signature_distance


def terms(**changed: Any) -> dict[str, float]:
    facts: dict[str, Any] = {
        "relevance": 0.5, "confidence": 0.8, "outcome": "verified_success", "type": "procedural_hint",
        "age": 0.0, "usage": 0, "conflicts": 0,
    }  # fmt: skip
    return score_terms(ScoreWeights(), **{**facts, **changed})


def test_a_fresh_success() -> None:
    assert sum(terms().values()) == pytest.approx(0.5 + 0.8 + 0.30 + 0.25)


@pytest.mark.parametrize(
    ("outcome", "type_", "bonus"),
    [
        ("verified_success", "procedural_hint", 0.30),
        ("verified_fail", "failure_avoidance", 0.30),
        ("verified_fail", "tool_usage", -0.10),
        ("uncertain", "procedural_hint", -0.25),
        ("unavailable", "procedural_hint", 0.05),
    ],
)
def test_success(outcome: str, type_: str, bonus: float) -> None:
    assert terms(outcome=outcome, type=type_)["success"] == bonus


@pytest.mark.parametrize(("age", "bonus"), [(0, 0.25), (9, 0.15), (22.5, 0.0), (400, 0.0), (-3, 0.25)])
def test_recency(age: float, bonus: float) -> None:
    assert terms(age=age)["recency"] == pytest.approx(bonus)


@pytest.mark.parametrize(("usage", "bonus"), [(0, 0.0), (1, math.log(2) / 8), (1000, 0.2)])
def test_usage(usage: int, bonus: float) -> None:
    assert terms(usage=usage)["usage"] == pytest.approx(bonus)


@pytest.mark.parametrize(("conflicts", "penalty"), [(0, 0.0), (1, -0.15), (3, -0.45), (9, -0.45)])
def test_conflict(conflicts: int, penalty: float) -> None:
    assert terms(conflicts=conflicts)["conflict"] == pytest.approx(penalty)


@pytest.mark.parametrize(
    ("type_", "age", "usage", "penalty"),
    [
        ("failure_avoidance", 13, 0, -13 / 365),
        ("failure_avoidance", 15, 0, -0.25),
        ("failure_avoidance", 15, 1, 0.0),
        ("procedural_hint", 400, 0, -0.2),
        ("procedural_hint", 400, 1000, -0.1),
    ],
)
def test_stale(type_: str, age: float, usage: int, penalty: float) -> None:
    assert terms(type=type_, age=age, usage=usage)["stale"] == pytest.approx(penalty)


def test_applicability_rewards_the_same_scene_and_counts_against_another() -> None:
    assert terms(distance=0.0)["applicability"] == pytest.approx(0.25)
    assert terms(distance=None)["applicability"] == 0.0
    assert terms(distance=2.0)["applicability"] == pytest.approx(-0.25, abs=0.01)


def test_signature_distance() -> None:
    assert signature_distance({"w": 0.05, "h": 1}, {"w": 0.05}) == 0.0
    assert signature_distance({"w": 0.1}, {"w": 0.05}) == pytest.approx(0.5)
    assert signature_distance({"w": 0.1}, {"h": 0.1}) is None
    assert signature_distance({"w": math.nan}, {"w": 0.1}) is None
    assert signature_distance({"w": 0.0}, {"w": 0.0}) == 0.0
