"""The governed memory in a run's place: opened late, degraded when its database fails, wired by name."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from gvla2.errors import ConfigurationError
from gvla2.memory.contracts import Evidence, Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.late import LateMemory
from gvla2_plugins import embedders, governed, hybrid

TASK = MemoryTask("Pick up the red cube", "pick")
LESSON = Lesson("procedural_hint", "Pick up a small box: grasp it deep.")
EPISODE = MemoryEpisode(TASK, (LESSON,), source="run/1")
SUCCESS = Verdict.from_criteria({"task_completion": 1.0})


class Unavailable:
    """A verifier that cannot judge."""

    def verify(self, evidence: Evidence) -> Verdict:
        return Verdict.unavailable(f"nothing is known about '{evidence.instruction}'")


def build(**options: Any) -> LateMemory:
    """Built through the components, as a run builds it."""
    (memory,) = governed.gvla2_memories()
    retriever = hybrid.gvla2_retrievers()[0]
    embedder = next(e for e in embedders.gvla2_embedders() if e.name == "static")
    assert memory.needs == ("retriever", "embedder", "verifier", "inducer", "judge")
    return memory.build(
        memory.config(name="governed", **options),
        retriever=retriever.build(retriever.config(name="hybrid")),
        embedder=embedder.build(embedder.config(name="static")),
        verifier=Unavailable(),
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "memory.db"


@pytest.fixture
def memory(path: Path) -> Iterator[LateMemory]:
    built = build(url=f"sqlite:///{path}", busy_seconds=0.2)
    yield built
    built.close()
    built.close()


def test_what_is_learned_is_recalled_in_another_process_of_the_bank(memory: LateMemory, path: Path) -> None:
    assert not path.exists()  # building opens nothing
    learned = memory.learn(EPISODE, SUCCESS)
    assert len(learned.added) == 1
    memory.close()
    other = build(url=f"sqlite:///{path}")
    assert [i.id for i in other.recall(TASK).items] == list(learned.added)
    other.close()


def fill(path: Path) -> None:
    other = build(url=f"sqlite:///{path}")
    other.learn(EPISODE, SUCCESS)
    other.close()


def corrupt(path: Path) -> None:
    path.write_bytes(os.urandom(20_000))


def newer(path: Path) -> None:
    fill(path)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE memory_meta SET value = '7'")


@pytest.mark.parametrize("spoil", [corrupt, newer])
def test_a_database_that_cannot_be_used_degrades_and_is_left_alone(
    memory: LateMemory, path: Path, spoil: Any
) -> None:
    spoil(path)
    before = path.read_bytes()
    for _ in range(2):
        context, learned = memory.recall(TASK), memory.learn(EPISODE, SUCCESS)
        assert str(path) in context.degraded
        assert (context.items, context.text, context.abstained) == ((), "", "")
        assert str(path) in learned.degraded
        assert not learned.added
    memory.close()
    assert path.read_bytes() == before


def test_a_locked_database_degrades_until_it_is_free(memory: LateMemory, path: Path) -> None:
    fill(path)
    with closing(sqlite3.connect(path)) as holder:
        holder.execute("PRAGMA locking_mode=EXCLUSIVE")
        holder.execute("BEGIN EXCLUSIVE")
        before = path.read_bytes()
        assert "locked" in memory.recall(TASK).degraded
        assert "locked" in memory.learn(EPISODE, SUCCESS).degraded
        assert path.read_bytes() == before
    assert memory.recall(TASK).items
    assert memory.learn(EPISODE, SUCCESS).merged


def test_a_lock_taken_in_mid_run_stores_nothing_of_the_episode(memory: LateMemory, path: Path) -> None:
    memory.learn(EPISODE, SUCCESS)
    with closing(sqlite3.connect(path)) as holder:
        holder.execute("BEGIN IMMEDIATE")
        assert memory.recall(TASK).items
        lessons = (LESSON, Lesson("tool_usage", "new"))
        learned = memory.learn(MemoryEpisode(TASK, lessons, recalled=memory.recall(TASK)), SUCCESS)
        assert "locked" in learned.degraded
        assert not learned.added + learned.merged
    assert len(memory.recall(TASK).items) == 1


def test_a_relative_address_does_not_follow_the_working_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    memory = build(url="sqlite:///here.db")
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path / "there")
    memory.learn(EPISODE, SUCCESS)
    memory.close()
    assert (tmp_path / "here.db").exists()


def test_an_address_that_can_be_no_database_is_an_error_at_once() -> None:
    with pytest.raises(ConfigurationError, match="mysql"):
        build(url="mysql://host/db")


def test_values_that_cannot_be_are_errors_at_once() -> None:
    with pytest.raises(ConfigurationError, match="retrieval"):
        build(retrieval="psychic")
    with pytest.raises(ConfigurationError, match="active_budget"):
        build(active_budget=-1)
