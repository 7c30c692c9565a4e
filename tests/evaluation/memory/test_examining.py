"""The examination by another hand: what it measures moves when what it measures is spoilt."""

from pathlib import Path

import pytest

from gvla2.evaluation.memory import examining
from gvla2.evaluation.memory.setting import Setting
from gvla2.evaluation.memory_data.examination import entries


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
    figures = examining.lessons(setting, 20, "first examiner")
    assert figures["examined_found"].value > 70
    assert figures["examined_false"].value < 15
    assert figures["examined_lost"].value < 15
    assert figures["examined_found"].peer_value < figures["examined_found"].value
    assert not list(setting.folder.iterdir()), "each bank is gone"
    monkeypatch.setattr("gvla2.memory.curation.consolidation.conflict", lambda first, second: None)
    assert examining.lessons(setting, 8, "first examiner")["examined_found"].value == 0


def test_pairs_alone_are_judged_by_what_there_is(setting: Setting) -> None:
    figures = examining.lessons(setting, 30, "third examiner")
    assert set(figures) == {"examined_found", "examined_false"}
    assert figures["examined_found"].value > 40
    assert figures["examined_false"].value < 10


def test_orders_are_held_back_and_honest_lessons_are_not(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = examining.orders(setting, 20, "first examiner")
    assert figures["examined_orders"].value < 15
    assert figures["examined_honest"].value < 10
    for name in ("reads_like_instructions", "effect_reads_like_instructions"):
        monkeypatch.setattr(f"gvla2.memory.curation.admission.{name}", lambda text: False)
    assert examining.orders(setting, 8, "first examiner")["examined_orders"].value > 80


def test_the_right_lesson_is_told(setting: Setting) -> None:
    figures = examining.queries(setting, 60, "first examiner")
    assert figures["examined_told"].value > 85
    assert figures["examined_irrelevant"].value < 30
