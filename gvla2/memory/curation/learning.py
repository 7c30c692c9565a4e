"""From an admitted lesson to rows: the decision of :mod:`gvla2.memory.curation.consolidation`, carried out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import Lesson, LifecycleState, MemoryEpisode, Verdict
from gvla2.memory.curation.admission import QUARANTINED, SourceCount, Streak, within_cap
from gvla2.memory.curation.consolidation import Edit, consolidate
from gvla2.memory.curation.growth import SUMMED_UP, confirmed, counted, moved, new_record, repeated, restarted
from gvla2.memory.curation.ledger import Ledger, Outcome
from gvla2.memory.records import Record

SECONDS_PER_DAY = 86400.0
_LIVE = ("active", "summary")


@dataclass(frozen=True)
class Candidate:
    """A lesson that will be stored in ``state``: its dedup ``key``, unit ``vector`` (D,) and the ``note`` on it."""

    lesson: Lesson
    state: LifecycleState
    key: str
    vector: NDArray[np.float32]
    note: str = ""


class Learning:
    """Brings the candidates of one episode into a bank, within one transaction.

    ``known`` are the ids that the episode's source taught before.
    """

    def __init__(
        self,
        ledger: Ledger,
        episode: MemoryEpisode,
        verdict: Verdict,
        options: BankOptions,
        outcome: Outcome,
        *,
        streak: Streak | None = None,
        known: Sequence[str] = (),
    ) -> None:
        self._ledger, self._episode, self._verdict = ledger, episode, verdict
        self._options, self._outcome, self._streak = options, outcome, streak
        self._known = list(dict.fromkeys(known))
        self._brought: list[Record] | None = None
        self.touched: list[str] = []

    def apply(self, candidate: Candidate) -> None:
        """Add the candidate, merge it, promote what it confirms, or leave the bank as it is."""
        ledger, verified = self._ledger, candidate.state == "active"
        fresh = new_record(
            ledger.transaction.bank,
            candidate.lesson,
            candidate.state,
            candidate.key,
            self._episode,
            self._verdict,
            ledger.now,
            self._streak,
        )
        known = ledger.by_key(candidate.key)
        if known is not None and known.state == "archive":
            known = self._heir(known) or known
        if not verified:
            self._unverified(candidate, fresh, known)
        elif known is not None and known.state in _LIVE:
            self._confirm(known, fresh, candidate, "MERGE", "one more episode says the same")
        elif known is not None and known.state == "archive" and counted(known, self._episode):
            self._discard(known.id, f"{known.id} stays archived: it rests on this episode already")
        else:
            self._verified(candidate, fresh, known)

    # What was not verified ----------------------------------------------------------------------------------------

    def _unverified(self, candidate: Candidate, fresh: Record, known: Record | None) -> None:
        if known is None or known.state == "archive":
            # A replaced or retired record does not come back on the word of an unverified episode.
            if known is not None:
                self._discard(known.id, "an unverified repeat of what was archived changes nothing")
                return
            self._store(replace(fresh, note=candidate.note), "PROVISIONAL", candidate, candidate.note)
            self._outcome.provisional.append(fresh.id)
            self._outcome.note(f"{fresh.id} is provisional: {candidate.note}.")
        elif known.state == "provisional" and counted(known, self._episode):
            self._repeated(known, fresh, self._outcome.provisional)
        elif known.state == "provisional":
            merged = replace(
                confirmed(known, fresh, self._episode, self._verdict, self._ledger.now),
                note=known.note if known.note.startswith(QUARANTINED) else candidate.note or known.note,
            )
            self._store(
                merged, "MERGE", candidate, "one more unverified episode says the same", count=known.count
            )
            self._outcome.provisional.append(known.id)
            self._outcome.note(f"{known.id} is provisional: {merged.note}.")
        else:
            self._discard(known.id, f"{known.id} is verified already: an unverified repeat changes nothing")

    def _discard(self, id: str, why: str) -> None:
        self._outcome.discarded += 1
        self._outcome.note(f"{why[0].upper()}{why[1:]}." if not why.startswith(id) else f"{why}.")
        self._ledger.decide("DISCARD", id, why)
        self.touched.append(id)

    def _repeated(self, known: Record, fresh: Record, listed: list[str]) -> None:
        """The same source again: whatever it repeats, its word counts once."""
        why = f"{known.id} rests on this episode already, whose word counts once"
        listed.append(known.id)
        self._outcome.note(f"{why}.")
        again = repeated(known, fresh)
        if again == known:
            self._ledger.decide("REPEATED", known.id, why)
        else:
            self._ledger.put(again, "REPEATED", why=why)
        self.touched.append(known.id)

    # What was verified --------------------------------------------------------------------------------------------

    def _verified(self, candidate: Candidate, fresh: Record, known: Record | None) -> None:
        options = self._options
        cap = within_cap(self._from_source(candidate), options.per_source, options.per_source_copies)
        if options.admission and cap.state != "active":
            self._capped(candidate, fresh, known, cap.note)
            return
        if known is None:
            record, promoted = fresh, False
        elif known.state == "provisional":
            record, promoted = restarted(known, fresh, self._episode), True
        else:
            grown = confirmed(known, fresh, self._episode, self._verdict, self._ledger.now)
            record, promoted = replace(grown, state="active", outcome=fresh.outcome, note=""), True
        rivals = self._ledger.nearest(candidate.vector, options.rivals) if options.governance else []
        self._ledger.found(record.id, rivals)
        edit = consolidate(record, rivals, options) if options.governance else Edit("ADD")
        carry_out = {"ADD": self._add, "MERGE": self._fold, "REPLACE": self._replace, "DISCARD": self._yield}
        carry_out[edit.action](record, fresh, candidate, edit)
        if promoted and edit.action in ("ADD", "REPLACE"):
            self._outcome.note(f"{record.id} is verified now and became active.")

    def _capped(self, candidate: Candidate, fresh: Record, known: Record | None, note: str) -> None:
        if known is not None and known.state == "archive":
            self._discard(known.id, f"it stays archived: {note}")
            return
        record = replace(known if known is not None else fresh, state="provisional", note=note)
        if known is not None and known.note == note:
            self._discard(known.id, f"{known.id} stays provisional: {note}")
            return
        # What the bank has already keeps its instructions, and so its vector.
        self._store(record, "PROVISIONAL", candidate if known is None else None, note)
        self._outcome.provisional.append(record.id)
        self._outcome.note(f"{record.id} is provisional: {note}.")

    def _add(self, record: Record, fresh: Record, candidate: Candidate, edit: Edit) -> None:
        self._store(record, "ADD", candidate, edit.why, edit=edit)
        (self._outcome.merged if record.version else self._outcome.added).append(record.id)
        self._contradict(record.id, edit)

    def _fold(self, record: Record, fresh: Record, candidate: Candidate, edit: Edit) -> None:
        """The candidate becomes evidence for its target; its own wording is kept in the archive, linked."""
        target = self._ledger.get(edit.target)
        if target is None:
            self._add(record, fresh, candidate, edit)
            return
        self._store(
            replace(record, state="archive", note=f"merged into {target.id}"),
            "MERGED",
            None,
            edit.why,
            edit=edit,
        )
        self._ledger.link(target.id, "merged", record.id, edit.why)
        self._confirm(target, fresh, candidate, "MERGE", edit.why, edit)

    def _replace(self, record: Record, fresh: Record, candidate: Candidate, edit: Edit) -> None:
        """The candidate prevails: those of its type that contradict it are archived, linked both ways."""
        self._store(record, "REPLACE", candidate, edit.why, edit=edit)
        (self._outcome.merged if record.version else self._outcome.added).append(record.id)
        for id, why in edit.conflicts:
            loser = self._ledger.get(id)
            if loser is None or loser.type != record.type:
                continue
            self._ledger.put(
                replace(loser, state="archive", note=f"replaced by {record.id}"), "REPLACED", why=why
            )
            self._ledger.link(record.id, "replaces", id, why)
            self._outcome.note(f"{record.id} replaces {id}: {why}.")
        self._contradict(record.id, edit)

    def _yield(self, record: Record, fresh: Record, candidate: Candidate, edit: Edit) -> None:
        """The candidate is not kept as a record of its own: the bank has its wording, or more to say against it."""
        if not edit.conflicts:
            target = self._ledger.get(edit.target)
            if target is not None:
                if record.version:
                    self._store(
                        replace(record, state="archive", note=f"merged into {target.id}"),
                        "MERGED",
                        None,
                        edit.why,
                    )
                    self._ledger.link(target.id, "merged", record.id, edit.why)
                self._confirm(target, fresh, candidate, "MERGE", edit.why, edit)
            return
        self._store(replace(record, state="archive", note=edit.why), "DISCARD", None, edit.why, edit=edit)
        self._contradict(record.id, edit)
        self._outcome.discarded += 1
        self._outcome.note(f"{record.id} was archived: {edit.why}.")

    def _contradict(self, id: str, edit: Edit) -> None:
        for other, why in edit.conflicts:
            self._ledger.link(id, "conflict", other, why)

    def _confirm(
        self,
        known: Record,
        fresh: Record,
        candidate: Candidate,
        action: str,
        why: str,
        edit: Edit | None = None,
    ) -> None:
        if counted(known, self._episode):
            self._repeated(known, fresh, self._outcome.merged)
            return
        grown = confirmed(known, fresh, self._episode, self._verdict, self._ledger.now)
        self._store(grown, action, candidate, why, count=known.count, edit=edit)
        self._outcome.merged.append(known.id)

    def _store(
        self,
        record: Record,
        action: str,
        candidate: Candidate | None,
        why: str,
        *,
        count: int = 0,
        edit: Edit | None = None,
    ) -> None:
        vector = None
        if candidate is not None:
            old = self._ledger.vector(record.id) if count else None
            vector = moved(old, count, candidate.vector)
        scores = dict(edit.scores) if edit is not None else {}
        scores |= {"quality": record.quality, "confidence": record.confidence}
        self._ledger.put(record, action, vector, why, scores)
        self.touched.append(record.id)
        if self._brought is not None and record.state == "active":
            self._brought.append(record)

    def _heir(self, archived: Record) -> Record | None:
        """The live record that took an archived one in."""
        for link in self._ledger.links(archived.id):
            if link.target == archived.id and link.kind in ("merged", "summary_of"):
                heir = self._ledger.get(link.source)
                if heir is not None and heir.state in _LIVE:
                    return heir
        return None

    def _from_source(self, candidate: Candidate) -> SourceCount:
        """What the episode's source brought of late that is active or in a summary, and how much of it is alike."""
        if not self._episode.source:
            return SourceCount()
        if self._brought is None:
            since = self._ledger.now - self._options.per_source_days * SECONDS_PER_DAY
            self._brought = [
                record
                for state in ("active", "archive")
                if self._known
                for record in self._ledger.records(self._known, state)
                if record.created >= since and (state == "active" or record.note.startswith(SUMMED_UP))
            ]
        mine = {record.id: record for record in self._brought}
        alike = 0
        for record in mine.values():
            vector = self._ledger.vector(record.id)
            effect = (record.effect_json() or {}).get("parameter")
            if vector is None or effect != (candidate.lesson.effect or {}).get("parameter"):
                continue
            alike += float(vector @ candidate.vector) >= self._options.copy_cosine
        return SourceCount(len(mine), alike)
