"""How well text relevance finds evidence: recall@10 on questions whose evidence turns people have marked.

The file is ``locomo10.json`` of LoCoMo (Maharana et al. 2024, CC BY-NC 4.0; never downloaded here): a list of
``{"conversation": {"session_1": [{"dia_id", "speaker", "text"}]}, "qa": [{"question", "evidence": [dia_id]}]}``.
Each conversation is a bank of its own whose records are its turns. What is measured is relevance alone, as the
retriever has it: BM25 over its maximum and cosine, half each.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError
from gvla2.memory.contracts import Embedder
from gvla2.memory.indexing.postings import Postings
from gvla2.memory.meaning.words import topic_words

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


@dataclass(frozen=True)
class EvidenceRecall:
    """Mean share of a question's evidence turns among the first ``TOP``; None where nothing was measured.

    ``note`` says why then.
    """

    method: str
    neighbours: bool
    recall: float | None
    questions: int
    note: str = ""

    def __str__(self) -> str:
        turns = "with neighbouring turns" if self.neighbours else "turns alone"
        if self.recall is None:
            return f"{self.method}, {turns}: not measured ({self.note})"
        return f"{self.method}, {turns}: recall@{TOP} {self.recall:.3f} over {self.questions} questions"


def find_file() -> Path | None:
    """``$GVLA2_DATA/locomo10.json`` or ``$GVLA2_DATA/locomo/locomo10.json``, None where there is neither."""
    root = os.environ.get("GVLA2_DATA")
    places = [Path(root) / FILE, Path(root) / "locomo" / FILE] if root else []
    return next((place for place in places if place.is_file()), None)


def measure(embedders: Mapping[str, Embedder | None], path: Path | None = None) -> tuple[EvidenceRecall, ...]:
    """Recall of each method, with and without the turns before and after in each record's text.

    ``embedders`` names the methods ("BM25": None is BM25 alone). Without ``path`` the file is looked for by
    :func:`find_file`; where it is absent, every entry says "not measured". Raises
    :class:`~gvla2.errors.ConfigurationError` for a file of another layout.
    """
    path = path or find_file()
    kinds = [(name, embedder, near) for near in (False, True) for name, embedder in embedders.items()]
    if path is None or not path.is_file():
        note = f"no {FILE} in the folder that GVLA2_DATA names" if path is None else f"no file '{path}'"
        return tuple(EvidenceRecall(name, near, None, 0, note) for name, _, near in kinds)
    conversations = read(path)
    return tuple(_recall(name, embedder, near, conversations) for name, embedder, near in kinds)


def read(path: Path) -> tuple[Conversation, ...]:
    """The conversations of a file. Questions without evidence among the turns are left out."""
    try:
        return tuple(_conversation(entry) for entry in json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigurationError(
            f"'{path}' has not the layout of {FILE} ({type(error).__name__}: {error}): a list of "
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


def _recall(
    name: str, embedder: Embedder | None, neighbours: bool, conversations: Sequence[Conversation]
) -> EvidenceRecall:
    shares = []
    for conversation in conversations:
        texts = _with_neighbours(conversation.texts) if neighbours else conversation.texts
        postings = Postings()
        postings.add(0, [topic_words(text) for text in texts], [1] * len(texts))
        questions = [question for question, _ in conversation.questions]
        cosines = np.zeros((len(questions), len(texts)), np.float32)
        if embedder is not None and questions:
            cosines = embedder.embed(questions) @ embedder.embed(texts).T
        for (question, evidence), cosine in zip(conversation.questions, cosines, strict=True):
            score = _relevance(postings, question, cosine, embedder is not None)
            first = [
                i for i in np.argsort(-score, kind="stable")[:TOP] if score[i] > 0
            ]  # 0: not found at all
            shares.append(len({conversation.ids[i] for i in first} & evidence) / len(evidence))
    recall = float(np.mean(shares)) if shares else None
    return EvidenceRecall(name, neighbours, recall, len(shares), "" if shares else "no question has evidence")


def _relevance(
    postings: Postings, question: str, cosine: NDArray[np.float32], vectors: bool
) -> NDArray[np.float64]:
    lexical, _ = postings.search(topic_words(question), [1], len(cosine))
    lexical /= max(float(lexical.max(initial=0.0)), 1e-9)
    return 0.5 * lexical + 0.5 * np.maximum(cosine, 0.0) if vectors else lexical


def _with_neighbours(texts: Sequence[str]) -> list[str]:
    """Each turn with the one before and the one after: an answer alone seldom says what it is about."""
    return [" ".join(texts[max(i - 1, 0) : i + 2]) for i in range(len(texts))]
