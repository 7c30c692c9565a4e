"""A bank keeps its index beside its database: a faster start, the same answers, and nothing left after forgetting."""

import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import gvla2.memory.indexing.index as index_module
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson
from gvla2.memory.storage.location import snapshot_path
from gvla2.memory.storage.store import Store

Open = Callable[..., Any]
SECRET = "The vault is behind the zebra painting."


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(index_module, "_WORTH_SAVING", 20)


def filled(url: str, verdicts: Any, many_lessons: Any, **options: Any) -> KnowledgeBank:
    bank = KnowledgeBank.open(url, **options)
    bank.admit_many([(lesson, verdicts["success"], task, "") for lesson, task in many_lessons(40)])
    bank.admit(Lesson("procedural_hint", SECRET), verdicts["success"], task="open the vault")
    return bank


def beside(url: str) -> Path:
    return snapshot_path(url.removeprefix("sqlite:///"), "default")


def test_the_next_start_is_from_the_snapshot_and_answers_the_same(
    url: str, verdicts: Any, many_lessons: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with filled(url, verdicts, many_lessons, clock=lambda: 2e9) as bank:
        before = [bank.recall(task) for _, task in many_lessons(40)]
    assert beside(url).is_file()
    assert stat.S_IMODE(beside(url).stat().st_mode) == 0o600
    asked: list[int] = []
    changes = index_module.Index.apply
    monkeypatch.setattr(
        index_module.Index, "apply", lambda self, found: asked.append(len(found)) or changes(self, found)
    )
    with KnowledgeBank.open(url, clock=lambda: 2e9) as bank:
        assert [bank.recall(task) for _, task in many_lessons(40)] == before
        assert asked == []  # nothing was read from the store
        bank.admit(Lesson("procedural_hint", "Salt the soup."), verdicts["success"], task="soup")
    stamp = beside(url).stat().st_mtime_ns
    with KnowledgeBank.open(url, clock=lambda: 2e9) as bank:
        assert bank.recall("salt the soup").items  # what is newer than the snapshot comes from the store
    assert beside(url).stat().st_mtime_ns == stamp  # a few changes are not worth another file


def test_forgetting_deletes_it_whoever_forgets(url: str, verdicts: Any, many_lessons: Any) -> None:
    with filled(url, verdicts, many_lessons) as bank:
        (id,) = [r.id for r in bank.records() if r.content == SECRET]
    assert b"zebra" in beside(url).read_bytes()
    with Store.open(url) as store, store.writing("default", actor="someone else", now=2e9) as transaction:
        assert transaction.forget(id)
    assert not beside(url).exists()
    folder = beside(url).parent
    assert not [path for path in folder.iterdir() if b"zebra" in path.read_bytes()]


def test_it_can_be_done_without_or_kept_elsewhere(
    url: str, tmp_path: Path, verdicts: Any, many_lessons: Any
) -> None:
    filled(url, verdicts, many_lessons, snapshot=False).close()
    assert not beside(url).exists()
    with KnowledgeBank.open(url, snapshot=tmp_path / "deep" / "file") as bank:
        assert bank.recall("open the vault").items
    assert (tmp_path / "deep" / "file").is_file()
    assert not beside(url).exists()


def test_a_snapshot_that_cannot_be_written_or_read_is_done_without(
    url: str, tmp_path: Path, verdicts: Any, many_lessons: Any
) -> None:
    (tmp_path / "file").write_text("no folder")
    bank = filled(url, verdicts, many_lessons, snapshot=tmp_path / "file" / "index")
    bank.close()
    bank.close()
    beside(url).write_bytes(b"not a snapshot\n" * 100)
    with KnowledgeBank.open(url) as bank:
        assert bank.recall("open the vault").items


def test_a_server_has_no_folder_so_the_users_cache_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    one, two = (snapshot_path("postgresql://me@host/db", bank) for bank in ("one", "two"))
    assert one.parent == two.parent == tmp_path / "gvla2"
    assert one != two
