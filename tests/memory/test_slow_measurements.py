"""The slow measurements, small: what they measure moves when what they measure is spoilt."""

from collections.abc import Iterator
from pathlib import Path

import concurrency
import damage
import pytest
from crash_harness import in_processes, lesson, whole_lines
from figure import Figure
from plain_peer import FILE, PeerLesson, PlainPeer
from setting import Setting

from gvla2.errors import Gvla2Error
from gvla2.memory.bank import KnowledgeBank


@pytest.fixture
def setting(tmp_path: Path) -> Iterator[Setting]:
    yield Setting(tmp_path, scale=0.001)
    assert not list(tmp_path.glob("copy-*")), "copies are gone"


def measured(setting: Setting, name: str, on: str = "") -> list[dict[str, Figure]]:
    parts = (concurrency, damage)
    tests = [
        test for part in parts for test in part.tests() if test.name == name and (not on or test.on == on)
    ]
    assert tests
    return [dict(test.measure(setting, test.least, test.on)) for test in tests]


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
    said = [id for id, _ in in_processes(job)["said"]]
    kept = {record.id for record in whole_lines(setting.folder / FILE)}
    assert len(said) == len(set(said)) == 320
    assert kept <= set(said)
    assert len(kept) < 320


def test_a_writer_that_fails_is_an_error_not_a_row(tmp_path: Path) -> None:
    with pytest.raises(Gvla2Error, match="writers' process ended"):
        in_processes({"do": "crowd", "kind": "nobody's", "place": "", "processes": "many", "each": 1})


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
    monkeypatch.setattr(KnowledgeBank, "verify", lambda self, *, head="": [])
    assert damage.quarantine(setting, 50, "")["quarantine_named"].value < 50
