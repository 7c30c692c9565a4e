"""How well evidence is found for questions, on the user's copy of a public set (LoCoMo's layout)."""

from __future__ import annotations

from collections.abc import Mapping

from gvla2.evaluation.memory.figure import Figure, FigureRow, NotMeasuredError, Test
from gvla2.evaluation.memory.plain_peer import PlainPeer
from gvla2.evaluation.memory.setting import Setting
from gvla2.evaluation.memory_retrieval import FILE, TOP, Conversation, mean_recall, read, through_bank

EMBEDDERS = ("static", "minilm")
PEER_QUESTIONS = 200


def quality(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Recall@10 through the bank with one embedder, over all questions."""
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
    theirs = _peer(setting.plain, conversations, most)
    note = f"the peer is asked {most} of the questions"
    return {"evidence": Figure(found, setting.plain.name, theirs, note, questions)}


def _peer(peer: PlainPeer, conversations: tuple[Conversation, ...], most: int) -> float:
    """The same by a peer's relevance, on an even sample of the questions."""
    every = [
        (conversation, question) for conversation in conversations for question in conversation.questions
    ]
    chosen = every[:: max(1, len(every) // most)][:most]
    shares = []
    for conversation, (question, evidence) in chosen:
        scores = [peer.relevance(question, text) for text in conversation.texts]
        first = sorted(range(len(scores)), key=lambda i: -scores[i])[:TOP]
        shares.append(len({conversation.ids[i] for i in first} & evidence) / len(evidence))
    return sum(shares) / max(len(shares), 1)


def tests() -> list[Test]:
    """The tests of this file; their size is that of the file."""
    made = []
    for embedder, goal in (("static", 0.63), ("minilm", 0.66)):
        row = FigureRow(
            "evidence", f"Evidence found through the bank, recall@{TOP}", "share", "higher", goal, 3
        )
        made.append(Test("quality", (row,), quality, 1, least=1, on=embedder))
    return made
