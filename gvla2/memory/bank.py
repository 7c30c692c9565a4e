"""The governed KnowledgeBank: verified experience in, a few reliable records out.

A bank lives in a database (:mod:`gvla2.memory.store`), which is the truth; an index in RAM follows it
(:mod:`gvla2.memory.index`) and is ranked for each recall (:mod:`gvla2.memory.retrieval`). What an episode teaches is
admitted, merged, held back or discarded, and governed (:mod:`gvla2.memory.learning`), and, where it is doubtful, judged
again (:mod:`gvla2.memory.review`).
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from gvla2.io.database_url import Closing
from gvla2.memory import review
from gvla2.memory.candidates import Candidates
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Judge,
    Learned,
    Lesson,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Retriever,
    Verdict,
    Verifier,
)
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.index import Index
from gvla2.memory.learning import JudgedEpisode, OpenBank, admit, learn
from gvla2.memory.options import BankOptions
from gvla2.memory.records import MAX_QUERY, LifecycleState, Record, clean
from gvla2.memory.rendering import item_of, render
from gvla2.memory.retrieval import HybridRetriever, SemanticRetriever
from gvla2.memory.store import Store, resolved_address
from gvla2.memory.view import Problem, audit

__all__ = ["BankOptions", "Hit", "KnowledgeBank"]


@dataclass(frozen=True)
class Hit:
    """A record that a search found, its score and the score's terms by name; ``reliable``: recall would show it."""

    record: Record
    score: float
    terms: Mapping[str, float]
    reliable: bool


class KnowledgeBank(OpenBank, Closing):
    """A named bank, for any number of processes and threads.

    ``address`` is a path, ``sqlite:///path`` or ``postgresql://user@host/name``; "" is the user's own memory. It is
    created if missing. By default it ranks by words, vectors, quality and geometry, and induces lessons by rules. Texts
    are embedded by the static table unless an ``embedder`` is given. ``verifier`` judges stored episodes again,
    ``judge`` decides whether similar lessons in words contradict each other; ``clock`` gives seconds since the epoch.
    Waits for other processes at most ``busy_seconds`` at a time.

    Its methods raise :class:`~gvla2.errors.MemoryStoreError` when the store cannot be used; the plugin that offers it
    as a memory turns that into a degraded answer. Invalid options raise :class:`~gvla2.errors.ConfigurationError`.
    """

    def __init__(
        self,
        address: str | Path = "",
        *,
        bank: str = "default",
        retriever: Retriever | None = None,
        embedder: Embedder | None = None,
        inducer: Inducer | None = None,
        verifier: Verifier | None = None,
        judge: Judge | None = None,
        options: BankOptions | None = None,
        busy_seconds: float = 5.0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        options = options or BankOptions()
        options.check()
        self._verifier, self._judge = verifier, judge
        self._retriever: Retriever = retriever or HybridRetriever()
        if options.retrieval == "semantic":
            self._retriever = SemanticRetriever()
        store = Store.open(address or resolved_address("", os.environ), busy_seconds=busy_seconds)
        embedder = embedder or StaticEmbedder()
        super().__init__(store, bank, Index(store, bank, embedder), embedder, options, inducer, clock)
        self._lock = threading.RLock()

    def recall(self, task: MemoryTask | str) -> MemoryContext:
        """The most reliable records for the task, or none with the reason."""
        with self._lock:
            asked, vector = self._asked(task)
            candidates = self._candidates("active")
            if not len(candidates):
                return MemoryContext(abstained=f"The bank '{self.bank}' holds no verified knowledge yet.")
            ranked, reason = self._retriever.rank(asked, candidates, vector)
            items = tuple(item_of(candidates.record(one.row), one.score, one.terms) for one in ranked)
            if not items:
                return MemoryContext(abstained=reason or "The retriever found nothing reliable.")
            return MemoryContext(items, render(items, self.options.max_chars))

    def learn(
        self,
        episode: MemoryEpisode | MemoryTask | str,
        verdict: Verdict | str = "",
        /,
        *,
        success: bool | None = None,
        recalled: MemoryContext | None = None,
        lessons: Sequence[Lesson | str] = (),
        source: str = "",
    ) -> Learned:
        """Store what the episode teaches and credit what was recalled for it, in one transaction.

        Either a whole episode with its verdict, or a task and its transcript: ``success`` is then its outcome (None for
        unknown), ``recalled`` what :meth:`recall` gave for it, and ``source`` the id of the run. Then, if a judge was
        given, it compares the new lessons with those near them; with ``replay`` and a verifier, one doubtful earlier
        episode is verified again.
        """
        if not isinstance(episode, MemoryEpisode):
            given = tuple(map(_lesson, lessons))
            context, source = recalled or MemoryContext(), source or f"run/{uuid4()}"
            episode = MemoryEpisode(_task(episode), given, str(verdict), context, source)
            verdict = _reported(success)
        if not isinstance(verdict, Verdict):
            raise TypeError("An episode needs its Verdict: bank.learn(episode, verdict).")
        if self.options.frozen:
            frozen = "The bank is frozen: nothing was learned."
            return Learned(discarded=len(episode.lessons), notes=(frozen,))
        with self._lock:
            learned = learn(self, episode, verdict)
            if self._judge is not None:
                review.judge(self, self._judge, learned.added)
            if self._verifier is not None and self.options.replay:
                review.replay(self, self._verifier, but=episode.source)
            return learned

    def admit(
        self,
        lesson: Lesson | str,
        verdict: Verdict | None = None,
        *,
        task: MemoryTask | str = "",
        source: str = "",
        trusted: bool = False,
    ) -> Learned:
        """Add a lesson without an episode; durable when it returns.

        A lesson from others stays provisional until a verified episode of ours confirms it. ``trusted`` vouches for it
        as for the user's own episodes, and serves as verdict if none is given.
        """
        given = verdict or _reported(True if trusted else None)
        judged = JudgedEpisode.lesson(_lesson(lesson), given, _task(task), source, own=trusted)
        with self._lock:
            return admit(self, [judged])

    def forget(self, id: str, *, why: str = "") -> bool:
        """Forget a record for good: its text, vector, links, episodes and history. False if there is none."""
        with self._lock, self.store.writing(self.bank, actor="forget", now=self.clock()) as transaction:
            return bool(transaction.forget(id, why=why))

    def records(self, states: Sequence[LifecycleState] | None = None) -> list[Record]:
        """The bank's records in these states (all by default), by id."""
        with self.store.reading(self.bank) as view:
            return view.records(states)

    def search(self, text: MemoryTask | str, k: int = 20) -> list[Hit]:
        """The records that a recall would show, then the nearest others, with scores and terms; at most ``k``."""
        with self._lock:
            asked, vector = self._asked(text)
            served, found = self._candidates("active"), self._candidates("active", "provisional")
        ranked, _ = self._retriever.rank(asked, served, vector)
        hits = [Hit(served.record(r.row), r.score, r.terms, reliable=True) for r in ranked]
        known = {hit.record.id for hit in hits}
        lexical, cosine = found.lexical(asked.query), found.cosine(vector)
        score = 0.6 * lexical + 0.4 * cosine.clip(0.0, 1.0)
        for row in np.argsort(-score, kind="stable").tolist():
            if score[row] > 0 and (record := found.record(row)).id not in known:
                terms = {"lexical": float(lexical[row]), "cosine": float(cosine[row])}
                hits.append(Hit(record, float(score[row]), terms, reliable=False))
        return hits[: max(k, 0)]

    def verify(self, *, head: str = "") -> list[Problem]:
        """The bank's problems, [] if there are none.

        ``head`` is "SEQ:HASH" from :meth:`stats`, kept elsewhere: with it, a truncated chain is found too.
        """
        with self.store.reading(self.bank) as view:
            return audit(view, head)

    def stats(self) -> dict[str, Any]:
        """Numbers about the bank: records by state and type, links, events, episodes, rev, head of the chain."""
        with self.store.reading(self.bank) as view:
            return view.counts()

    def close(self) -> None:
        """Release the store; safe to call twice."""
        with self._lock:
            self.store.close()

    def _candidates(self, *states: str) -> Candidates:
        self.index.refresh()
        self.index.keep()
        return self.index.candidates(states, now=self.clock())

    def _asked(self, task: MemoryTask | str) -> tuple[MemoryTask, NDArray[np.float32]]:
        """The task with a query that any retriever accepts, and the query's (D,) vector."""
        given = _task(task)
        asked = replace(given, query=clean(given.query, MAX_QUERY))
        knows = getattr(self.embedder, "knows", None)
        vector = self.embedder.embed([asked.query])[0]
        return asked, vector if knows is None or knows(asked.query) else np.zeros_like(vector)


def _task(task: MemoryTask | str) -> MemoryTask:
    return MemoryTask(task) if isinstance(task, str) else task


def _lesson(lesson: Lesson | str) -> Lesson:
    return Lesson("procedural_hint", lesson) if isinstance(lesson, str) else lesson


def _reported(success: bool | None) -> Verdict:
    """The verdict for a reported outcome."""
    if success is None:
        return Verdict.unavailable("it was not verified")
    return Verdict.from_criteria({"success": float(success)}, verifier="reported")
