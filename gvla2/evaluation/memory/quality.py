"""How well evidence is found for questions, on a public set that the user has (LoCoMo's layout)."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

from gvla2.evaluation.memory.figure import Figure, NotMeasuredError, Row, Test
from gvla2.evaluation.memory.peers import Peer
from gvla2.evaluation.memory.setting import Setting
from gvla2.evaluation.memory_retrieval import FILE, TOP, Conversation, measure, read

METHODS = ("BM25", "BM25 + hash", "BM25 + MiniLM")
PEER_QUESTIONS = 200


def quality(setting: Setting, size: int, on: str, *, neighbours: bool) -> Mapping[str, Figure]:
    """Recall@10 of one method, over all questions."""
    path = setting.question_file
    if path is None:
        raise NotMeasuredError(f"no {FILE}: name its folder by data.root=FOLDER or in GVLA2_DATA")
    if on not in setting.embedders:
        raise NotMeasuredError("the embedder is not installed")
    embedder = setting.embedders[on]()
    found = next(one for one in measure({on: embedder}, path) if one.neighbours is neighbours)
    conversations = read(path)
    name = "evidence_neighbours" if neighbours else "evidence"
    if found.recall is None:
        raise NotMeasuredError(found.note)
    theirs: dict[str, float] = {}
    note = ""
    if on == METHODS[0] and not neighbours:
        setting.tell(0.5, "the bank's is done")
        most = setting.count(PEER_QUESTIONS, 5)
        theirs = {peer.name: _peer(peer, conversations, most) for peer in setting.peers()}
        note = f"the peers are asked {most} of the questions"
    return {name: Figure.beside(found.recall, theirs, note=note, n=found.questions)}


def _peer(peer: Peer, conversations: tuple[Conversation, ...], most: int) -> float:
    """The same by a peer's relevance, on questions taken evenly from all."""
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
    """The tests of this file. Their size is that of the file; the goals are what was measured before."""
    goals = {("BM25", False): 0.57, ("BM25 + hash", False): 0.60, ("BM25 + MiniLM", False): 0.63}
    made = []
    for near in (False, True):
        name = "evidence_neighbours" if near else "evidence"
        title = f"Evidence found, recall@{TOP}" + (", with the turns around it" if near else "")
        for method in METHODS:
            row = Row(name, title, "share", "higher", goals.get((method, near)), 3)
            measure_it = partial(quality, neighbours=near)
            seconds = 60.0 if "MiniLM" in method else 8.0
            made.append(Test("quality", (row,), measure_it, 1, least=1, on=method, seconds=seconds))
    return made
