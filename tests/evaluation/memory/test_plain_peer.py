"""The peers do what a plain memory does, so that a comparison with them means something."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory.peers import PeerLesson
from gvla2.evaluation.memory.plain_peer import FILE, PlainPeer
from gvla2.evaluation.memory.released_peer import ReleasedPeer

NOW = 1.8e9
HINT = ("procedural_hint", "success", 0.9, 0.9, NOW)
CUP = PeerLesson("cup", "lift the cup", "Grip the cup by its rim and lift it.", *HINT)
LAMP = PeerLesson("lamp", "switch the lamp on", "Press the button of the lamp.", *HINT)


@pytest.fixture
def peer() -> PlainPeer:
    return PlainPeer()


def test_what_is_written_is_read_and_found(peer: PlainPeer, tmp_path: Path) -> None:
    peer.fill(tmp_path, [LAMP, CUP])
    assert peer.load(tmp_path) == [LAMP, CUP]
    assert peer.retrieve(tmp_path, "lift the red cup", 1, NOW) == ["cup"]
    assert peer.retrieve(tmp_path, "switch on the lamp", 2, NOW) == ["lamp", "cup"]
    assert peer.load(tmp_path / "nowhere") == []


def test_age_and_use_and_verdicts_weigh(peer: PlainPeer, tmp_path: Path) -> None:
    old = replace(CUP, id="old", created=NOW - 300 * 86400)
    doubtful = replace(CUP, id="doubtful", status="uncertain")
    failed = replace(CUP, id="failed", status="verified_fail", created=NOW - 20 * 86400)
    used = replace(CUP, id="used", usage=9)
    peer.fill(tmp_path, [failed, old, CUP, doubtful, used])
    assert peer.retrieve(tmp_path, CUP.query, 9, NOW) == ["used", "cup", "old", "failed"]


@pytest.mark.parametrize(
    ("content", "action"),
    [
        (CUP.content, "DISCARD"),
        ("Grip the cup at its rim and lift it slowly.", "MERGE"),
        ("Never grip the cup by its rim to lift it.", "REPLACE"),
        ("Unscrew every wheel nut crosswise.", "ADD"),
    ],
)
def test_a_candidate_is_added_merged_replaced_or_left_out(
    peer: PlainPeer, tmp_path: Path, content: str, action: str
) -> None:
    new = replace(
        CUP, id="new", query="lift the cup" if action != "ADD" else "change a tyre", content=content
    )
    assert peer.place(new, [LAMP, CUP]) == action
    peer.fill(tmp_path, [LAMP, CUP])
    peer.admit(tmp_path, [new])
    kept = {record.id for record in peer.load(tmp_path)}
    assert kept == {
        "ADD": {"lamp", "cup", "new"},
        "MERGE": {"lamp", "cup"},
        "REPLACE": {"lamp", "new"},
        "DISCARD": {"lamp", "cup"},
    }[action]  # fmt: skip


def test_a_pass_sums_up_retires_and_keeps_to_the_budget(peer: PlainPeer) -> None:
    alike = [replace(CUP, id=f"cup-{i}", query=f"lift the cup {i}") for i in range(3)]
    stale = replace(LAMP, id="stale", status="verified_fail", created=NOW - 20 * 86400)
    assert peer.govern([*alike, LAMP, stale], 10, NOW) == 1
    assert peer.govern([CUP, LAMP], 1, NOW) == 1


def test_a_damaged_line_stops_it(peer: PlainPeer, tmp_path: Path) -> None:
    peer.fill(tmp_path, [CUP, LAMP])
    text = (tmp_path / FILE).read_text()
    (tmp_path / FILE).write_text(text[:20] + "\n" + text)
    with pytest.raises(ValueError, match=r"Invalid control|Unterminated|delimiter"):
        peer.load(tmp_path)


def test_a_checkout_is_used_by_its_own_functions(tmp_path: Path) -> None:
    """A stand-in with the names that the released code has: which of them are called, and with what."""
    package = tmp_path / "KnowledgeBank" / "third_party" / "src" / "minisweagent" / "memory_v2"
    package.mkdir(parents=True)
    parts = {
        "schema": "class MemoryState:\n    ACTIVE = 'active'\n    ARCHIVE = 'archive'\n"
        "class MemoryRecord:\n    def __init__(self, **data):\n        self.__dict__ |= data\n",
        "store": "KEPT = {}\nclass JsonlMemoryStore:\n    def __init__(self, root):\n        self.root = root\n"
        "    def replace_state(self, state, records):\n        KEPT[state] = records\n"
        "    def load_active(self):\n        return list(KEPT.get('active', []))\n"
        "    def load_archive(self):\n        return []\n    def load_summary(self):\n        return []\n",
        "retrieval": "from types import SimpleNamespace\n"
        "def rank_memory_records(records, query, *, now):\n    assert now.startswith('2027-01-15')\n"
        "    return [SimpleNamespace(record=r, score=r.confidence) for r in records]\n"
        "def select_top_memories(ranked, limit):\n    return [i.record for i in ranked][:limit]\n"
        "def compute_text_relevance(query, text):\n    return 0.25\n",
        "consolidation": "from .conflict import may_conflict\n"
        "def resolve_candidate(candidate, active):\n    return [*active, candidate], [], 'ADD'\n",
        "governance": "def run_budgeted_governance(*, active_records, max_active_records, **rest):\n"
        "    return {'active': active_records[:max_active_records]}\n",
        "conflict": "def may_conflict(left, right):\n    return left != right\n",
    }
    for name, text in parts.items():
        (package / f"{name}.py").write_text(text)
    (package / "__init__.py").write_text("raise RuntimeError('nothing around the parts is run')\n")
    peer = ReleasedPeer(tmp_path)
    assert peer.folder == package
    peer.fill(tmp_path, [CUP, replace(LAMP, status="uncertain")])
    assert [record.memory_id for record in peer.load(tmp_path)] == ["cup", "lamp"]
    assert peer.retrieve(tmp_path, "lift", 5, NOW) == ["cup"]
    peer.admit(tmp_path, [replace(CUP, id="new")])
    assert len(peer.load(tmp_path)) == 3
    assert peer.place(CUP, []) == "ADD"
    assert peer.govern(peer.load(tmp_path), 2, NOW) == 2
    assert peer.contradict("a", "b")
    assert peer.relevance("a", "b") == 0.25
    (package / "governance.py").write_text("import no_such_package_anywhere\n")
    with pytest.raises(ConfigurationError, match="no_such_package_anywhere"):
        ReleasedPeer((tmp_path / "KnowledgeBank").rename(tmp_path / "moved"))


def test_a_folder_without_it_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no package memory_v2"):
        ReleasedPeer(tmp_path)


def test_lessons_are_plain_data() -> None:
    assert set(asdict(CUP)) == {
        "id", "query", "content", "type", "status", "confidence", "quality", "created", "usage",
    }  # fmt: skip
