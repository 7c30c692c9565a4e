"""What a task brings back: ranked, bounded, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import Embedder, MemoryContext, MemoryItem, MemoryTask, Retriever
from gvla2.memory.indexing.candidates import Candidates
from gvla2.memory.injection_patterns import sanitised
from gvla2.memory.records import MAX_QUERY, Record, clean, finite
from gvla2.memory.retrieval.rendering import render

MAX_THINGS = 64


@dataclass(frozen=True)
class Hit:
    """A record that a search found, its score and the score's terms by name; ``reliable``: recall would show it."""

    record: Record
    score: float
    terms: Mapping[str, float]
    reliable: bool


def recall(
    task: MemoryTask,
    candidates: Candidates,
    retriever: Retriever,
    embedder: Embedder,
    options: BankOptions,
    bank: str,
) -> MemoryContext:
    """The most reliable of the candidates, or none with the reason."""
    if not len(candidates):
        return MemoryContext(abstained=f"The bank '{bank}' holds no verified knowledge yet.")
    asked = bounded(task)
    ranked, reason = retriever.rank(asked, candidates, embedder.embed([asked.query])[0])
    items = tuple(_item(candidates.record(rank.row), rank.score, rank.terms) for rank in ranked)
    if not items:
        return MemoryContext(abstained=reason or "The retriever found nothing reliable.")
    return MemoryContext(items, render(items, options.max_chars))


def search(
    task: MemoryTask,
    served: Candidates,
    candidates: Candidates,
    retriever: Retriever,
    embedder: Embedder,
    k: int,
) -> list[Hit]:
    """What a recall would show of the ``served``, with its score; then the nearest of all others, and by what."""
    if not len(candidates) or k < 1:
        return []
    asked = bounded(task)
    vector = embedder.embed([asked.query])[0]
    ranked, _ = retriever.rank(asked, served, vector)
    hits = [Hit(served.record(rank.row), rank.score, dict(rank.terms), reliable=True) for rank in ranked]
    known = {hit.record.id for hit in hits}
    lexical, cosine = candidates.lexical(asked.query), candidates.cosine(vector)
    text = 0.6 * lexical + 0.4 * cosine.clip(0.0, 1.0)
    for row in sorted(range(len(text)), key=lambda i: (-text[i], candidates.record(i).id))[: k + len(known)]:
        record = candidates.record(row)
        if record.id not in known and text[row] > 0:
            terms = {
                "lexical": float(lexical[row]),
                "cosine": float(cosine[row]),
                "confidence": record.confidence,
            }
            hits.append(Hit(record, float(text[row]), terms, reliable=False))
    return hits[:k]


def bounded(task: MemoryTask) -> MemoryTask:
    """The task with a query that any retriever can take, and sound numbers."""
    return MemoryTask(
        clean(task.query, MAX_QUERY), finite(task.signature), task.skill, task.things[:MAX_THINGS]
    )


def _item(record: Record, score: float, terms: Mapping[str, float]) -> MemoryItem:
    return MemoryItem(
        id=record.id,
        type=record.type,
        content=sanitised(record.content),
        confidence=record.confidence,
        score=score,
        terms=dict(terms),
        # What was never verified binds nobody, even where the bank is told to show it.
        binding=record.type == "failure_avoidance" and record.state != "provisional",
        effect=record.effect_json() if record.effect else None,
        trust=record.trust,
    )
