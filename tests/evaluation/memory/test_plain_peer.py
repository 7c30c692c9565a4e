"""The peer does what a plain memory does, so that a comparison with it means something."""

from dataclasses import asdict, replace
from pathlib import Path

import pytest

from gvla2.evaluation.memory.plain_peer import FILE, PeerLesson, PlainPeer

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
    doubtful = replace(CUP, id="doubtful", outcome="uncertain")
    failed = replace(CUP, id="failed", outcome="verified_fail", created=NOW - 20 * 86400)
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
    stale = replace(LAMP, id="stale", outcome="verified_fail", created=NOW - 20 * 86400)
    assert peer.govern([*alike, LAMP, stale], 10, NOW) == 1
    assert peer.govern([CUP, LAMP], 1, NOW) == 1


def test_a_damaged_line_stops_it(peer: PlainPeer, tmp_path: Path) -> None:
    peer.fill(tmp_path, [CUP, LAMP])
    text = (tmp_path / FILE).read_text()
    (tmp_path / FILE).write_text(text[:20] + "\n" + text)
    with pytest.raises(ValueError, match=r"Invalid control|Unterminated|delimiter"):
        peer.load(tmp_path)


def test_lessons_are_plain_data() -> None:
    assert set(asdict(CUP)) == {
        "id", "query", "content", "type", "outcome", "confidence", "quality", "created", "usage",
    }  # fmt: skip
