"""Were a bank's vectors made of its records' texts? Only who has the embedder can tell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Embedder
from gvla2.memory.records import MAX_PHRASINGS, Record
from gvla2.memory.storage.audit import Problem
from gvla2.memory.storage.view import View, vector_of

_TOGETHER = 1024
_OWN = 0.99
"""Cosine from which a vector is that of a text, whatever the order of additions."""
_FOREIGN = 0.2
"""A record of one episode is never so far from its own text: later ones move it, by their share."""
_MOST = 4096

Numbers = NDArray[np.float32]


def foreign_vectors(view: View, bank: str, embedder: Embedder) -> list[Problem]:
    """The vectors that are another record's, as after a swap, or that have nothing to do with their text.

    Vectors of other models are passed over, and those of summaries and of records that several episodes confirmed:
    they are means, which nobody can make again. A record of several phrasings may have the vector of any of them, or
    of one that it had no room for. Nor is a vector found that was moved a little.
    """
    suspects: list[tuple[Record, Numbers]] = []
    problems = []
    for records, vectors, own in _compared(view, bank, embedder):
        cosines = np.maximum(np.einsum("nd,nd->n", vectors, own), _phrased(records, vectors, own, embedder))
        for place in np.flatnonzero(cosines < _OWN).tolist():
            record = records[place]
            if record.count > 1 or record.state == "summary" or not own[place].any():
                continue
            if cosines[place] < _FOREIGN:
                problems.append(Problem("vector", record.id, "it was not made of what the record says"))
            elif len(suspects) < _MOST:
                suspects.append((record, vectors[place]))
    if suspects:
        problems += _others(view, bank, embedder, suspects)
    return sorted(problems, key=lambda problem: problem.id)


def _phrased(records: Sequence[Record], vectors: Numbers, own: Numbers, embedder: Embedder) -> Numbers:
    """(N,) greatest cosine of each vector and that of one phrasing alone: a verified episode under another task
    replaces what an uncertain one said, and the record keeps the tasks of both. 1 where phrasings are left out.
    """
    best = np.full(len(records), -1.0, np.float32)
    asked: list[tuple[int, str]] = []
    for place, record in enumerate(records):
        lines = record.query.split("\n")
        if len(lines) >= MAX_PHRASINGS:
            best[place] = 1.0
        elif len(lines) > 1 and record.count == 1 and own[place].any():
            asked += [(place, f"{line} {record.content}") for line in lines]
    for start in range(0, len(asked), _TOGETHER):
        some = asked[start : start + _TOGETHER]
        places = [place for place, _ in some]
        made = _unit(np.asarray(embedder.embed([text for _, text in some]), np.float32))
        np.maximum.at(best, places, np.einsum("nd,nd->n", vectors[places], made))
    return best


def _others(
    view: View, bank: str, embedder: Embedder, suspects: Sequence[tuple[Record, Numbers]]
) -> list[Problem]:
    """Those that are exactly what another record's text gives."""
    theirs = np.stack([vector for _, vector in suspects])
    found: dict[str, str] = {}
    for records, _, own in _compared(view, bank, embedder):
        fits = theirs @ own.T > _OWN
        for row, column in zip(*np.nonzero(fits), strict=True):
            suspect, other = suspects[row][0], records[column]
            if suspect.id != other.id and suspect.content != other.content:
                found.setdefault(suspect.id, other.id)
    return [
        Problem("vector", id, f"it is that of {other}, not of what the record says")
        for id, other in found.items()
    ]


def _compared(view: View, bank: str, embedder: Embedder) -> Iterator[tuple[list[Record], Numbers, Numbers]]:
    """Records with their unit (N, D) stored vectors and those of their texts, some at a time."""
    ids = sorted(str(row[0]) for row in view.vector_rows(bank) if row[1] == embedder.model and row[4])
    for start in range(0, len(ids), _TOGETHER):
        some = ids[start : start + _TOGETHER]
        stored = view.vectors_of(bank, some)
        records = [record for record in view.records(bank, ids=some) if record.id in stored]
        if not records:
            continue
        made = np.asarray(embedder.embed([r.text for r in records]), np.float32)
        found = [vector_of(*stored[record.id]) for record in records]
        sound = [i for i, vector in enumerate(found) if vector is not None and len(vector) == made.shape[1]]
        if sound:
            vectors = np.stack([np.asarray(found[i]) for i in sound])
            yield [records[i] for i in sound], _unit(vectors), _unit(made[sound])


def _unit(vectors: Numbers) -> Numbers:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-12), np.float32)
