"""The tests of the memory suite tell good from bad: what they measure moves when what they measure is spoilt."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.memory import contradicting, faults, poison, suite
from gvla2.evaluation.memory.figure import Figure, NotMeasuredError, passed
from gvla2.evaluation.memory.nursery import in_nursery, lesson, whole_lines
from gvla2.evaluation.memory.peers import PeerLesson
from gvla2.evaluation.memory.plain_peer import FILE, PlainPeer
from gvla2.evaluation.memory.setting import Setting
from gvla2.evaluation.memory_data.contradictions import pairs
from gvla2.memory.storage.store import Store

QUICK = ("retrieval", "exactness", "start", "store", "consolidation", "governance")


@pytest.fixture
def setting(tmp_path: Path) -> Iterator[Setting]:
    yield Setting(tmp_path, scale=0.001)
    assert not list(tmp_path.glob("copy-*")), "copies are gone"


def measured(setting: Setting, name: str, on: str = "") -> list[dict[str, Figure]]:
    tests = [test for test in suite.all_tests() if test.name == name and (not on or test.on == on)]
    assert tests
    return [dict(test.measure(setting, test.least, test.on)) for test in tests]


@pytest.mark.parametrize("name", QUICK)
def test_every_row_of_a_test_is_measured_beside_a_peer(setting: Setting, name: str) -> None:
    for test in suite.all_tests():
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


def test_recall_at_ten_is_exact(setting: Setting) -> None:
    (figures,) = measured(setting, "exactness")
    assert figures["recall_at_10"].value == 1.0


def test_admits_are_counted_and_both_ways_measured(setting: Setting) -> None:
    one, many = measured(setting, "admits")
    assert one["admits_single"].value > 1
    assert many["admits_batched"].value > 1


def test_nothing_is_lost_by_many_writers_or_by_kills(setting: Setting) -> None:
    (crowd,) = measured(setting, "writers", "sqlite")
    assert crowd["writers_lost"].value == crowd["writers_duplicated"].value == 0
    assert crowd["writers_lost"].n == 80
    assert crowd["writers_p99"].value > 0
    (killed,) = measured(setting, "kills", "sqlite")
    assert killed["kills_lost"].value == 0
    assert "acknowledged" in killed["kills_lost"].note


def test_writers_that_lose_are_seen_to(setting: Setting) -> None:
    """The plain peer's file is read and written whole by each process: the count of what is left must show it."""
    job = {"do": "crowd", "kind": "plain", "place": str(setting.folder), "processes": 4, "each": 80}
    said = [id for id, _ in in_nursery(job)["said"]]
    kept = {record.id for record in whole_lines(setting.folder / FILE)}
    assert len(said) == len(set(said)) == 320
    assert kept <= set(said)
    assert len(kept) < 320


def test_a_writer_that_fails_is_an_error_not_a_row(tmp_path: Path) -> None:
    with pytest.raises(Gvla2Error, match="writers' process ended"):
        in_nursery({"do": "crowd", "kind": "nobody's", "place": "", "processes": "many", "each": 1})


def test_half_lines_are_passed_over(tmp_path: Path) -> None:
    PlainPeer().fill(tmp_path, [PeerLesson.of(lesson("a")), PeerLesson.of(lesson("b"))])
    text = (tmp_path / FILE).read_text()
    (tmp_path / FILE).write_text(text[: len(text) - 30])
    assert [record.id for record in whole_lines(tmp_path / FILE)] == ["a"]


def test_damage_is_named_and_the_rest_is_served(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    (figures,) = measured(setting, "quarantine")
    assert figures["quarantine_served"].value == figures["quarantine_named"].value == 100
    assert figures["quarantine_shown"].value == 0
    assert figures["quarantine_served"].peer_value == 0, "one damaged line stops the peer"
    monkeypatch.setattr(Store, "verify", lambda self, bank, *, head="": [])
    assert faults.quarantine(setting, 50, "")["quarantine_named"].value == 0


def test_contradictions_are_counted_on_each_set(setting: Setting) -> None:
    for figures in measured(setting, "contradictions"):
        assert figures["contradictions_found"].value >= 90
        assert figures["contradictions_false"].value <= 10
        assert figures["contradictions_found"].peer_value < 50
    judged = [(pair.first, pair.second, pair.conflict) for pair in pairs()]
    assert contradicting.rates(lambda a, b: True, judged) == (100, 100)
    assert contradicting.rates(lambda a, b: False, judged) == (0, 0)


def test_poison_is_kept_out_by_admission_and_gets_in_without(setting: Setting) -> None:
    with_it = poison.poison(setting, 50, "unverified")
    without = poison.poison(setting, 50, "no admission")
    assert with_it["poison_hit"].value == with_it["poison_collateral"].value == 0
    assert without["poison_hit"].peer_value > 50
    fooled = poison.poison(setting, 50, "verifier fooled")
    assert fooled["poison_hit"].value > 0, "the measure sees poison that is shown"


def test_the_flood_stays_within_its_budget(setting: Setting) -> None:
    told: list[tuple[float, str]] = []
    setting.tell = lambda share, what: told.append((share, what))
    (figures,) = measured(setting, "flood")
    active = figures["flood_active"]
    assert active.goal == 50
    assert 0 < active.value <= active.goal
    assert figures["flood_rate"].value > 0
    assert told[-1] == (1.0, "500 of 500 admits")
    assert not list(setting.folder.glob("flood*"))


def test_the_flood_needs_room(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    full = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("gvla2.evaluation.memory.endurance.shutil.disk_usage", lambda path: full)
    with pytest.raises(NotMeasuredError, match="need 0 GB of disk"):
        measured(setting, "flood")


def test_quality_without_and_with_a_question_set(setting: Setting, tmp_path: Path) -> None:
    with pytest.raises(NotMeasuredError, match=r"no locomo10\.json"):
        measured(setting, "quality", "BM25")
    setting.question_file = tmp_path / "locomo10.json"
    setting.question_file.write_text(QUESTIONS)
    setting.embedders = {"BM25": lambda: None}
    alone, around = measured(setting, "quality", "BM25")
    assert alone["evidence"].value == 1.0
    assert alone["evidence"].peer_value == 1.0
    assert alone["evidence"].n == 1
    assert around["evidence_neighbours"].value == 1.0
    with pytest.raises(NotMeasuredError, match="not installed"):
        measured(setting, "quality", "BM25 + MiniLM")


QUESTIONS = """[{"conversation": {"session_1": [
  {"dia_id": "D1:1", "speaker": "Ann", "text": "I bought a green kettle."},
  {"dia_id": "D1:2", "speaker": "Bob", "text": "My dog likes the rain."}]},
  "qa": [{"question": "Which colour has the kettle?", "evidence": ["D1:1"]}]}]"""


def test_names_choose_tests_or_rows() -> None:
    assert [test.size for test in suite.chosen_tests(["retrieval"])] == [1000, 10_000, 100_000]
    assert [test.name for test in suite.chosen_tests(["kills_lost", "flood"])] == ["kills", "kills", "flood"]
    assert suite.chosen_tests([]) == list(suite.all_tests())
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
    tests = suite.all_tests()
    places = [(row.name, test.on, test.size) for test in tests for row in test.rows]
    assert len(set(places)) == len(places)
    for test in tests:
        assert test.scaled(1.0) == test.size
        assert test.least <= test.scaled(1e-9) <= test.size
    assert {100_000, 1_000_000} <= {test.size for test in tests}
