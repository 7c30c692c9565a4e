"""The few lines that most users need: open by a path, recall, learn, admit."""

import subprocess
import sys
from pathlib import Path

import pytest

from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.memory import KnowledgeBank, Lesson, MemoryEpisode, MemoryTask, Verdict

WAY = "$ sort -o names.txt names.txt"


def test_the_package_loads_nothing_until_it_is_used(tmp_path: Path) -> None:
    heavy = "{'numpy', 'sqlalchemy', 'hydra', 'torch', 'scipy', 'trimesh', 'numba'}"
    code = f"import sys, gvla2.memory; print({heavy} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
    bank = "from gvla2.memory import KnowledgeBank; KnowledgeBank(sys.argv[1]).recall('x')"
    heavy = "{'hydra', 'torch', 'scipy', 'trimesh', 'numba', 'sqlmodel', 'pydantic'}"
    code = f"import sys; {bank}; print({heavy} & set(sys.modules))"
    path = str(tmp_path / "m.db")
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_recall_learn_and_credit(tmp_path: Path) -> None:
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        assert bank.recall("sort a file").text == ""
        (id,) = bank.learn("sort a file", WAY, success=True).added
        context = bank.recall("sort the lines of a file")
        assert "sort -o names.txt" in context.text
        again = bank.learn("sort the lines of a file", WAY, success=True, recalled=context)
        assert not again.degraded
        assert next(record.usage for record in bank.records() if record.id == id) == 1
    with KnowledgeBank(str(tmp_path / "memory.db")) as bank:
        assert bank.recall("sort a file").items


def test_a_failure_teaches_a_constraint_and_an_open_end_nothing_sure(tmp_path: Path) -> None:
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        (id,) = bank.learn("open the jar", "- turned the lid\nerror: the lid is stuck", success=False).added
        assert id.startswith("avoid-")
        assert bank.learn("fold the towel", "- took a corner", lessons=["Fold it twice."]).provisional
        assert bank.recall("fold the towel").items == ()


def test_what_is_admitted_without_trust_waits(tmp_path: Path) -> None:
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        assert bank.admit("Salt the soup at the end.", task="cook a soup", source="a colleague").provisional
        assert bank.admit("Stir the soup slowly.", task="cook a soup", trusted=True).added
        assert [r.content for r in bank.records(["active"])] == ["Stir the soup slowly."]
        (item,) = bank.recall("cook a soup").items
        assert item.trust == "own"


def test_mistakes_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Not a database address"):
        KnowledgeBank(":memory:")
    with KnowledgeBank(tmp_path / "memory.db") as bank:
        episode = MemoryEpisode(MemoryTask("x"), (Lesson("tool_usage", "Hold it."),))
        with pytest.raises(TypeError, match="needs its Verdict"):
            bank.learn(episode)  # type: ignore[call-overload]
        assert bank.learn(episode, Verdict.from_criteria({"done": 1.0})).added
        for odd in (None, 5):
            with pytest.raises(Gvla2Error, match="A lesson is a sentence or a Lesson, not"):
                bank.admit(odd)  # type: ignore[arg-type]
            with pytest.raises(Gvla2Error, match="A task is a sentence or a MemoryTask, not"):
                bank.recall(odd)  # type: ignore[arg-type]
