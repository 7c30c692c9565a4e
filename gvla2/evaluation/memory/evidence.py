"""How well a bank finds evidence: recall@10 on questions whose evidence turns people have marked.

The file is ``locomo10.json`` of LoCoMo (Maharana et al. 2024, CC BY-NC 4.0; never downloaded here): a list of
``{"conversation": {"session_1": [{"dia_id", "speaker", "text"}]}, "qa": [{"question", "evidence": [dia_id]}]}``.
Each conversation is a bank of its own, to which its turns are admitted as lessons; each question is recalled, with ten
places instead of three and without abstaining.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory.figure import Figure, NotMeasuredError
from gvla2.evaluation.memory.plain_peer import PlainPeer
from gvla2.evaluation.memory.setting import Setting
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Embedder, Lesson, Verdict
from gvla2.memory.options import HybridOptions
from gvla2.memory.retrieval import HybridRetriever

FILE = "locomo10.json"
TOP = 10
EMBEDDERS = ("static", "minilm")
PEER_QUESTIONS = 200
_SESSION = re.compile(r"session_(\d+)$")
_TURN = re.compile(r"D\d+:\d+")


@dataclass(frozen=True)
class Conversation:
    """Turns in order, each with its id, and questions with the ids of their evidence."""

    ids: tuple[str, ...]
    texts: tuple[str, ...]
    questions: tuple[tuple[str, frozenset[str]], ...]


def find_file(root: str | None = None) -> Path | None:
    """The file in ``root`` or its folder ``locomo``; without a root, in ``$GVLA2_DATA``, None if it is not there.

    Raises :class:`ConfigurationError` for a root without it.
    """
    folder = root or os.environ.get("GVLA2_DATA")
    places = [Path(folder).expanduser() / below / FILE for below in ("", "locomo")] if folder else []
    found = next((place for place in places if place.is_file()), None)
    if root and not found:
        raise ConfigurationError(f"data.root is '{root}', which contains neither {FILE} nor locomo/{FILE}.")
    return found


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
    everything = HybridOptions(top_k=TOP, top_k_constraints=0, min_evidence=-1.0, min_score=-9.0)
    turns: dict[str, set[str]] = {}
    for id, text in zip(conversation.ids, conversation.texts, strict=True):
        turns.setdefault(text, set()).add(id)
    retriever = HybridRetriever(everything)
    with (
        TemporaryDirectory() as folder,
        KnowledgeBank(f"{folder}/memory.db", embedder=embedder, retriever=retriever) as bank,
    ):
        bank.admit_many(((Lesson("procedural_hint", text), verdict, "", "") for text in turns), trusted=True)
        said = {record.id: turns.get(record.content, set()) for record in bank.records()}
        shares = []
        for question, evidence in conversation.questions:
            told = [said[item.id] for item in bank.recall(question).items]
            shares.append(len(set().union(*told) & evidence) / len(evidence))
    return shares


def through_peer(conversation: Conversation, peer: PlainPeer) -> list[float]:
    """The same by a peer's relevance, turn by turn."""
    shares = []
    for question, evidence in conversation.questions:
        scores = [peer.relevance(question, text) for text in conversation.texts]
        first = sorted(range(len(scores)), key=lambda i: -scores[i])[:TOP]
        shares.append(len({conversation.ids[i] for i in first} & evidence) / len(evidence))
    return shares


def mean_recall(
    conversations: Iterable[Conversation], shares: Callable[[Conversation], Sequence[float]]
) -> tuple[float | None, int]:
    """The mean over all questions of all conversations, None for none, and how many there are."""
    found = [share for conversation in conversations for share in shares(conversation)]
    return (float(np.mean(found)) if found else None), len(found)


def evidence(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Recall@10 through the bank with one embedder, over all questions; the peer is asked an even sample of them."""
    path = setting.question_file
    if path is None:
        raise NotMeasuredError(f"no {FILE}: name its folder by data.root=FOLDER or in GVLA2_DATA")
    embedder = setting.embedders[on]()  # raises if its package is missing
    conversations = read(path)
    found, questions = mean_recall(conversations, lambda one: through_bank(one, embedder))
    if found is None:
        raise NotMeasuredError("no question has evidence")
    if on != EMBEDDERS[0]:
        return {"evidence": Figure(found, n=questions)}
    most = setting.count(PEER_QUESTIONS, 5)
    each = [replace(one, questions=(asked,)) for one in conversations for asked in one.questions]
    chosen = each[:: max(1, questions // most)][:most]
    theirs, _ = mean_recall(chosen, lambda one: through_peer(one, setting.plain))
    note = f"the peer is asked {most} of the questions"
    return {"evidence": Figure(found, setting.plain.name, theirs, note, questions)}
