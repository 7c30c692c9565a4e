"""The terms of S, against the constants they were released with."""

import math
from typing import Any

import numpy as np
import pytest

from gvla2.memory.options import ScoreWeights
from gvla2.memory.retrieval import scene_distance, score_terms
from gvla2.testing.memory import candidates


def terms(relevance: float = 0.5, distance: float = math.nan, **changed: Any) -> dict[str, float]:
    bank = candidates(
        ["lift it"], **{name: [value] for name, value in ({"confidence": 0.8} | changed).items()}
    )
    found = score_terms(
        ScoreWeights(),
        bank,
        np.array([0]),
        relevance=np.array([relevance]),
        distance=np.array([distance]),
    )
    return {name: float(term[0]) for name, term in found.items()}


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
    assert terms(ages=age)["recency"] == pytest.approx(bonus)


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
    assert terms(type=type_, ages=age, usage=usage)["stale"] == pytest.approx(penalty)


def test_applicability_rewards_the_same_scene_and_counts_against_another() -> None:
    assert terms(distance=0.0)["applicability"] == pytest.approx(0.25)
    assert terms()["applicability"] == 0.0
    assert terms(distance=2.0)["applicability"] == pytest.approx(-0.25, abs=0.01)


def test_scenes_are_compared_by_the_numbers_that_both_have() -> None:
    scenes = [{"w": 0.05, "h": 1.0}, {"w": 0.1}, {}, {"h": 2.0}]
    bank = candidates(["lift it"] * len(scenes), signature=scenes)
    for asked, expected in (
        ({"w": 0.05}, [0.0, 0.5, math.nan, math.nan]),
        ({"w": 0.05, "h": 2.0}, [0.25, 0.5, math.nan, 0.0]),
        ({"w": math.nan}, [math.nan] * 4),
    ):
        found = scene_distance(asked, bank, np.arange(len(scenes)))
        np.testing.assert_allclose(found, expected, atol=1e-12)
