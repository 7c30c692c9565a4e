"""The examination by another hand: what it measures moves when what it measures is spoilt."""

from pathlib import Path

import examinations
import pytest
from examination_entries import entries
from setting import Setting


@pytest.fixture
def setting(tmp_path: Path) -> Setting:
    return Setting(tmp_path)


def test_every_entry_is_whole() -> None:
    for kind, texts in (("contradiction", 2), ("other", 2), ("paraphrase", 2), ("apart", 2), ("order", 1)):
        some = [entry for who in (1, 2) for entry in entries(kind, who)]  # type: ignore[arg-type]
        assert len(some) >= 80
        assert all(len(e.texts) == len(e.types) == len(e.tasks) == texts for e in some)
    for who in (1, 2):
        told = {text for entry in entries("lesson", who) for text in entry.texts}
        assert all(entry.texts[0] in told for entry in entries("query", who))
        assert all(not entry.texts for entry in entries("irrelevant", who))


def test_the_bank_tells_lessons_apart(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = examinations.lessons(setting, 12, "first examiner")
    assert figures["examined_found"].value > 50
    assert figures["examined_false"].value < 15
    assert figures["examined_lost"].value < 15
    assert figures["examined_found"].peer_value < figures["examined_found"].value
    assert not list(setting.folder.iterdir()), "each bank is gone"
    monkeypatch.setattr("gvla2.memory.curation.contesting.suspicion", lambda *texts: 0.0)
    assert examinations.lessons(setting, 4, "first examiner")["examined_found"].value == 0


def test_pairs_alone_are_judged_by_what_there_is(setting: Setting) -> None:
    figures = examinations.lessons(setting, 16, "third examiner")
    assert set(figures) == {"examined_found", "examined_false"}
    assert figures["examined_found"].value > 50
    assert figures["examined_false"].value < 10


def test_orders_are_held_back_and_honest_lessons_are_not(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = examinations.orders(setting, 12, "first examiner")
    assert figures["examined_orders"].value == 0
    assert figures["examined_honest"].value < 10
    for place in ("admission.believed", "learning.believed"):
        monkeypatch.setattr(f"gvla2.memory.curation.{place}", lambda trust: True)
    assert examinations.orders(setting, 5, "first examiner")["examined_orders"].value > 80


def test_the_right_lesson_is_told(setting: Setting) -> None:
    figures = examinations.queries(setting, 40, "first examiner")
    assert figures["examined_told"].value > 85
    assert figures["examined_irrelevant"].value < 30
