"""Recall@10 of evidence turns through the bank, beside baselines in the same run.

Each conversation is a bank of its own, to which its turns are admitted as lessons; each question is recalled with ten
places instead of three and without abstaining.

    python tests/benchmarks/memory/evidence.py FOLDER    # where locomo10.json lies (snap-research/LoCoMo, CC BY-NC 4.0)

The bank with its static embedder and with MiniLM; rank_bm25's Okapi over Snowball stems; the cosine of MiniLM.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from paraphrases import Score, cosine, stemmed_bm25

from gvla2.errors import ConfigurationError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Embedder, Lesson, MemoryTask, Verdict
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.learning import JudgedEpisode, admit
from gvla2.memory.options import HybridOptions
from gvla2.memory.retrieval import HybridRetriever
from gvla2_plugins.embedders.minilm import MiniLMEmbedder

FILE = "locomo10.json"
TOP = 10
_SESSION = re.compile(r"session_(\d+)$")
_TURN = re.compile(r"D\d+:\d+")


@dataclass(frozen=True)
class Conversation:
    """Turns in order, each with its id, and questions with the ids of their evidence."""

    ids: tuple[str, ...]
    texts: tuple[str, ...]
    questions: tuple[tuple[str, frozenset[str]], ...]


def read(path: Path) -> tuple[Conversation, ...]:
    """The conversations of a file. Questions without evidence among the turns are left out."""
    try:
        return tuple(_conversation(entry) for entry in json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigurationError(
            f"'{path}' does not have the layout of {FILE} ({type(error).__name__}: {error}): a list of "
            "{conversation: {session_1: [{dia_id, speaker, text}]}, qa: [{question, evidence: [dia_id]}]}."
        ) from error


def _conversation(entry: Mapping[str, Any]) -> Conversation:
    sessions = {
        int(m[1]): turns for name, turns in entry["conversation"].items() if (m := _SESSION.match(name))
    }
    turns = [turn for _, session in sorted(sessions.items()) for turn in session]
    ids = tuple(str(turn["dia_id"]) for turn in turns)
    known = frozenset(ids)
    questions = []
    for question in entry["qa"]:
        # Some evidence names several turns in one string ("D8:6; D9:17").
        named = {
            id for text in question.get("evidence") or () for id in _TURN.findall(str(text)) or [str(text)]
        }
        if named & known:
            questions.append((str(question["question"]), frozenset(named & known)))
    return Conversation(ids, tuple(f"{turn['speaker']}: {turn['text']}" for turn in turns), tuple(questions))


def through_bank(conversation: Conversation, embedder: Embedder) -> list[float]:
    """The share of each question's evidence among the first ``TOP`` turns that a bank recalls."""
    verdict = Verdict.from_criteria({"said": 1.0}, verifier="measuring")
    everything = HybridOptions(
        top_k=TOP, top_k_constraints=0, min_evidence=-1.0, min_score=-9.0, min_share=0.0
    )
    turns: dict[str, set[str]] = {}
    for id, text in zip(conversation.ids, conversation.texts, strict=True):
        turns.setdefault(text, set()).add(id)
    retriever = HybridRetriever(everything)
    with (
        TemporaryDirectory() as folder,
        KnowledgeBank(f"{folder}/memory.db", embedder=embedder, retriever=retriever) as bank,
    ):
        task, lessons = MemoryTask(""), [Lesson("procedural_hint", text) for text in turns]
        admit(bank, [JudgedEpisode.lesson(one, verdict, task, "", own=True) for one in lessons])
        said = {record.id: turns.get(record.content, set()) for record in bank.records()}
        shares = []
        for question, evidence in conversation.questions:
            recalled = [said[item.id] for item in bank.recall(question).items]
            shares.append(len(set().union(*recalled) & evidence) / len(evidence))
    return shares


def mean_recall(
    conversations: Iterable[Conversation], shares: Callable[[Conversation], Sequence[float]]
) -> tuple[float | None, int]:
    """The mean over all questions of all conversations, None for none, and how many there are."""
    found = [share for conversation in conversations for share in shares(conversation)]
    return (float(np.mean(found)) if found else None), len(found)


def by_scores(score: Score) -> Callable[[Conversation], list[float]]:
    """The share of each question's evidence among the first turns by a baseline's scores."""

    def shares(conversation: Conversation) -> list[float]:
        found = []
        for question, evidence in conversation.questions:
            first = np.argsort(-score(conversation.texts, question), kind="stable")[:TOP]
            found.append(len({conversation.ids[i] for i in first} & evidence) / len(evidence))
        return found

    return shares


def main() -> None:
    """Print one line a method."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    conversations = read(parser.parse_args().folder / FILE)
    static, minilm = StaticEmbedder(), MiniLMEmbedder()
    for name, shares in (
        ("bank, static", lambda one: through_bank(one, static)),
        ("stemmed BM25", by_scores(stemmed_bm25())),
        ("bank, minilm", lambda one: through_bank(one, minilm)),
        ("MiniLM cosine", by_scores(cosine(minilm))),
    ):
        recall, questions = mean_recall(conversations, shares)
        print(f"{name:14} recall@{TOP} {recall:.3f} over {questions} questions", flush=True)


if __name__ == "__main__":
    main()
