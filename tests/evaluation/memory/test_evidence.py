"""Recall of evidence on a small conversation in the layout of the public set."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory.evidence import find_file, mean_recall, read, through_bank
from gvla2.memory.embedding import StaticEmbedder

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
    shares = through_bank(conversation, StaticEmbedder())
    assert len(shares) == 3
    assert shares[:2] == [1.0, 1.0]
    nobody = replace(conversation, questions=(("Who watered the plants?", frozenset({"D1:1", "D1:7"})),))
    assert through_bank(nobody, StaticEmbedder()) == [0.5], "a share of the evidence"
    assert mean_recall([conversation, conversation], lambda one: shares) == (
        pytest.approx(sum(shares) / 3),
        6,
    )
    assert mean_recall([], lambda one: shares) == (None, 0)


def test_the_file_is_looked_for_where_the_data_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GVLA2_DATA", raising=False)
    assert find_file() is None
    monkeypatch.setenv("GVLA2_DATA", str(tmp_path))
    assert find_file() is None
    path = fill(tmp_path / "locomo10.json")
    assert find_file() == path


@pytest.mark.parametrize(
    "text", ["{", "[1]", '[{"conversation": {}}]', '[{"conversation": {"session_1": [{}]}, "qa": []}]']
)
def test_another_layout_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "locomo10.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="layout"):
        read(path)
