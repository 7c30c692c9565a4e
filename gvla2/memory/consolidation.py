"""From an admitted lesson to a row: a new record, one more piece of evidence, or a promotion."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlmodel import Session

from gvla2.memory.contracts import Learned, Lesson, LifecycleState, MemoryEpisode, Verdict
from gvla2.memory.merging import merge_effects, merge_quality, merge_signatures, merge_vectors
from gvla2.memory.records import Record, clean, dump, finite, record_id
from gvla2.memory.store import find, next_rev

MAX_QUERY = 1000
MAX_PHRASINGS = 8
MAX_SOURCES = 32


@dataclass(frozen=True)
class Candidate:
    """A lesson that will be stored in ``state``: its dedup ``key``, unit ``vector`` (D,) and the ``note`` on it."""

    lesson: Lesson
    state: LifecycleState
    key: str
    vector: NDArray[np.float32]
    note: str = ""


@dataclass
class Changes:
    """What a transaction did to a bank, as it goes."""

    added: list[str] = field(default_factory=list)
    merged: list[str] = field(default_factory=list)
    provisional: list[str] = field(default_factory=list)
    discarded: int = 0
    notes: list[str] = field(default_factory=list)

    def learned(self) -> Learned:
        """The same as the contract's answer."""
        return Learned(
            tuple(self.added), tuple(self.merged), tuple(self.provisional), self.discarded, tuple(self.notes)
        )


@dataclass(frozen=True)
class Consolidation:
    """Writes candidates of one episode into one bank at one time ``now`` (seconds since the epoch).

    ``model`` names the embedder of the candidates' vectors. To be used inside :meth:`Store.writing`.
    """

    bank: str
    model: str
    now: float
    episode: MemoryEpisode
    verdict: Verdict

    def apply(self, session: Session, candidate: Candidate, changes: Changes) -> None:
        """Add the candidate, merge it, promote what it confirms, or leave the bank as it is."""
        record = find(session, self.bank, candidate.key)
        verified = candidate.state == "active"
        if record is None:
            record = self._new(candidate)
            (changes.added if verified else changes.provisional).append(record.id)
        elif not verified and record.state != "provisional":
            changes.discarded += 1
            changes.notes.append(f"{record.id} is verified already: an unverified repeat changes nothing.")
            return
        elif verified and record.state in ("provisional", "archive"):
            self._restart(record, candidate)
            changes.merged.append(record.id)
            changes.notes.append(f"{record.id} is verified now and became active.")
        else:
            self._merge(record, candidate)
            (changes.merged if verified else changes.provisional).append(record.id)
        if candidate.note:
            record.note = candidate.note
            changes.notes.append(f"{record.id} is {candidate.state}: {candidate.note}.")
        record.updated, record.rev = self.now, next_rev(session, self.bank)
        session.add(record)
        session.flush()

    def _new(self, candidate: Candidate) -> Record:
        lesson, judged = candidate.lesson, self.verdict.outcome != "unavailable"
        return Record(
            id=record_id(lesson.type, self.bank, candidate.key),
            bank=self.bank,
            query=_phrasings("", self.episode.task.query),
            content=lesson.content,
            type=lesson.type,
            state=candidate.state,
            outcome=self.verdict.outcome,
            confidence=self.verdict.confidence if judged else 0.0,
            quality=self.verdict.quality if judged else 0.5,
            dedup_key=candidate.key,
            verifier=_verifier_json(self.verdict),
            signature=dump(finite(self.episode.task.signature)),
            skill=clean(self.episode.task.skill, 64),
            effect=dump(dict(lesson.effect)) if lesson.effect else "",
            provenance=_provenance("{}", self.episode),
            embedding=candidate.vector.astype("<f4").tobytes(),
            embedding_model=self.model,
            created=self.now,
            updated=self.now,
            rev=0,
        )

    def _restart(self, record: Record, candidate: Candidate) -> None:
        """Verified evidence replaces unverified evidence; the record keeps its id, age and phrasings."""
        fresh = self._new(candidate)
        for name in ("state", "outcome", "quality", "confidence", "count", "effect", "signature", "verifier"):
            setattr(record, name, getattr(fresh, name))
        record.note = ""
        self._trace(record, candidate)

    def _merge(self, record: Record, candidate: Candidate) -> None:
        """One more episode says what the record says."""
        try:
            effect, signature = record.effect_json(), record.signature_json()
        except (ValueError, TypeError):
            effect, signature = None, {}  # damaged: what this episode says replaces it
        if self.verdict.outcome != "unavailable":
            record.quality, record.confidence = merge_quality(
                record.quality, record.count, self.verdict.quality
            )
        merged = merge_effects(effect, candidate.lesson.effect)
        record.effect = dump(merged) if merged else ""
        record.signature = dump(
            merge_signatures(signature, record.count, finite(self.episode.task.signature))
        )
        record.verifier = _verifier_json(self.verdict)
        record.count += 1
        self._trace(record, candidate)

    def _trace(self, record: Record, candidate: Candidate) -> None:
        """What either kind of repeat leaves behind: phrasing, source, direction of the embedding."""
        old = record.vector(self.model, len(candidate.vector))
        record.embedding = merge_vectors(old, record.count, candidate.vector).astype("<f4").tobytes()
        record.embedding_model = self.model
        record.query = _phrasings(record.query, self.episode.task.query)
        record.provenance = _provenance(record.provenance, self.episode)
        record.version += 1


def _phrasings(known: str, query: str) -> str:
    """Distinct instructions, one a line, the first ones kept: other words for the same find the record too."""
    new = " ".join(clean(query, MAX_QUERY).split())
    lines = [line for line in known.split("\n") if line]
    if new and new not in lines and len(lines) < MAX_PHRASINGS:
        lines.append(new)
    return "\n".join(lines)


def _verifier_json(verdict: Verdict) -> str:
    return dump(
        {
            "verifier": clean(verdict.verifier, 64),
            "criteria": finite(verdict.criteria),
            "reasons": [clean(reason, 300) for reason in verdict.reasons[:8]],
        }
    )


def _provenance(known: str, episode: MemoryEpisode) -> str:
    try:
        before: Mapping[str, Any] = json.loads(known)
        sources = [str(source) for source in before.get("sources", [])]
    except (ValueError, TypeError, AttributeError):
        sources = []
    if episode.source and episode.source not in sources:
        sources.append(clean(episode.source, 200))
    made_by = {clean(str(k), 64): clean(str(v), 200) for k, v in episode.provenance.items()}
    return dump({"made_by": made_by, "sources": sources[-MAX_SOURCES:]})
