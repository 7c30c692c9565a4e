"""Recall of evidence on a small conversation in the layout of the public set."""

import json
from pathlib import Path

import pytest

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory_retrieval import TOP, find_file, measure, read
from gvla2.memory.retrieval.hashing import HashEmbedder

TURNS = [
    ("Ana", "I finally adopted a dog from the shelter on Maple Street."),
    ("Ben", "Congratulations! What will you call him?"),
    ("Ana", "Biscuit."),
    ("Ben", "My sister moved to Lisbon for her new job in marine biology."),
    ("Ana", "How exciting, does she like the sea?"),
    ("Ben", "She swims every morning before work."),
]


def fill(path: Path) -> Path:
    padding = [("Ana", f"Today I watered the plants on balcony number {i}.") for i in range(30)]
    turns = [
        {"dia_id": f"D{1 + i // 20}:{i % 20 + 1}", "speaker": who, "text": text}
        for i, (who, text) in enumerate([*TURNS, *padding])
    ]
    data = [
        {
            "conversation": {
                "speaker_a": "Ana",
                "session_1_date_time": "1 May",
                "session_2": turns[20:],
                "session_1": turns[:20],
            },
            "qa": [
                {"question": "Where did Ana adopt her dog?", "evidence": ["D1:1"]},
                {
                    "question": "Which city did Ben's sister move to, and when does she swim?",
                    "evidence": ["D1:4; D1:6"],
                },
                {"question": "What is the dog called?", "evidence": ["D1:3"]},
                {"question": "Nobody said that?", "evidence": []},
                {"question": "And nothing of this?", "evidence": ["D9:9"]},
            ],
        }
    ]
    path.write_text(json.dumps(data), encoding="utf-8")
    return path


def test_recall_is_counted_by_the_evidence_named(tmp_path: Path) -> None:
    path = fill(tmp_path / "locomo10.json")
    (conversation,) = read(path)
    assert len(conversation.ids) == 36
    assert conversation.ids[:2] == ("D1:1", "D1:2")
    assert [sorted(evidence) for _, evidence in conversation.questions] == [
        ["D1:1"],
        ["D1:4", "D1:6"],
        ["D1:3"],
    ]
    results = {
        (r.method, r.neighbours): r for r in measure({"BM25": None, "BM25 + hash": HashEmbedder()}, path)
    }
    assert {r.questions for r in results.values()} == {3}
    # "Biscuit." shares no word with its question; among 36 turns it is found by what was said before it.
    alone, near = results["BM25", False].recall, results["BM25", True].recall
    assert alone is not None
    assert near is not None
    assert 0.5 < alone < 1.0
    assert near >= alone
    assert str(TOP) in str(results["BM25", True])


def test_an_absent_file_is_said_to_be_not_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GVLA2_DATA", raising=False)
    assert find_file() is None
    (alone, near) = measure({"BM25": None})
    assert alone.recall is None
    assert "not measured" in str(alone)
    assert near.neighbours
    assert "not measured" in str(measure({"BM25": None}, tmp_path / "nothing.json")[0])
    monkeypatch.setenv("GVLA2_DATA", str(tmp_path))
    fill(tmp_path / "locomo10.json")
    assert measure({"BM25": None})[0].recall is not None


@pytest.mark.parametrize(
    "text", ["{", "[1]", '[{"conversation": {}}]', '[{"conversation": {"session_1": [{}]}, "qa": []}]']
)
def test_another_layout_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "locomo10.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="layout"):
        measure({"BM25": None}, path)
