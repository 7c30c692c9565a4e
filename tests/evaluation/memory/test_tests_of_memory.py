"""The tests of the memory suite tell good from bad: what they measure moves when what they measure is spoilt."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory import poison, suite
from gvla2.evaluation.memory.figure import Figure, NotMeasuredError, passed
from gvla2.evaluation.memory.setting import Setting
from gvla2.memory.embedding import StaticEmbedder

QUICK = ("retrieval", "start", "store", "consolidation", "governance")


@pytest.fixture
def setting(tmp_path: Path) -> Iterator[Setting]:
    yield Setting(tmp_path, scale=0.001)
    assert not list(tmp_path.glob("copy-*")), "copies are gone"


def measured(setting: Setting, name: str, on: str = "") -> list[dict[str, Figure]]:
    tests = [test for test in suite.TESTS if test.name == name and (not on or test.on == on)]
    assert tests
    return [dict(test.measure(setting, test.least, test.on)) for test in tests]


@pytest.mark.parametrize("name", QUICK)
def test_every_row_of_a_test_is_measured_beside_a_peer(setting: Setting, name: str) -> None:
    for test in suite.TESTS:
        if test.name != name:
            continue
        figures = test.measure(setting, test.least, test.on)
        assert set(figures) == {row.name for row in test.rows}
        for row in test.rows:
            figure = figures[row.name]
            assert figure.value is not None
            assert figure.value >= 0
            if row.name not in ("rev", "verify"):
                assert figure.peer
                assert figure.peer_value is not None


def test_admits_are_counted_and_both_ways_measured(setting: Setting) -> None:
    one, many = measured(setting, "admits")
    assert one["admits_single"].value > 1
    assert many["admits_batched"].value > 1


def test_poison_is_kept_out_by_admission_and_gets_in_without(setting: Setting) -> None:
    with_it = poison.poison(setting, 30, "unverified")
    without = poison.poison(setting, 30, "no admission")
    assert with_it["poison_hit"].value == with_it["poison_collateral"].value == 0
    assert without["poison_hit"].peer_value > 50
    assert poison.poison(setting, 30, "verifier fooled")["poison_hit"].value == 0, "it comes from outside"
    vouched = poison.poison(setting, 30, "vouched for")
    assert vouched["poison_hit"].value > 0, "the measure sees poison that is shown"


def test_quality_without_and_with_a_question_set(setting: Setting, tmp_path: Path) -> None:
    with pytest.raises(NotMeasuredError, match=r"no locomo10\.json"):
        measured(setting, "quality", "static")
    setting.question_file = tmp_path / "locomo10.json"
    setting.question_file.write_text(QUESTIONS)
    setting.embedders = {"static": StaticEmbedder}
    (figures,) = measured(setting, "quality", "static")
    assert figures["evidence"].value == 1.0
    assert figures["evidence"].peer_value == 1.0
    assert figures["evidence"].n == 1


QUESTIONS = """[{"conversation": {"session_1": [
  {"dia_id": "D1:1", "speaker": "Ann", "text": "I bought a green kettle."},
  {"dia_id": "D1:2", "speaker": "Bob", "text": "My dog likes the rain."}]},
  "qa": [{"question": "Which colour has the kettle?", "evidence": ["D1:1"]}]}]"""


def test_names_choose_tests_or_rows() -> None:
    assert [test.size for test in suite.chosen_tests(["retrieval"])] == [1000, 10_000, 100_000]
    assert [test.name for test in suite.chosen_tests(["evidence", "start"])] == [
        "start",
        "quality",
        "quality",
    ]
    assert suite.chosen_tests([]) == list(suite.TESTS)
    with pytest.raises(ConfigurationError, match="No test 'retreival'"):
        suite.chosen_tests(["retreival"])


@pytest.mark.parametrize(
    ("value", "goal", "better", "verdict"),
    [(1.0, 2.0, "lower", True), (3.0, 2.0, "lower", False), (2.0, 2.0, "higher", True), (None, 2.0, "lower", None),
     (1.0, None, "lower", None)],
)  # fmt: skip
def test_a_goal_is_reached_or_not(value: Any, goal: Any, better: Any, verdict: Any) -> None:
    assert passed(value, goal, better) is verdict


def test_rows_are_told_apart_and_sizes_shrink() -> None:
    tests = suite.TESTS
    places = [(row.name, test.on, test.size) for test in tests for row in test.rows]
    assert len(set(places)) == len(places)
    for test in tests:
        assert test.scaled(1.0) == test.size
        assert test.least <= test.scaled(1e-9) <= test.size
    assert 100_000 in {test.size for test in tests}
