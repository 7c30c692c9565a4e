"""From an admitted lesson to records: the decision of :mod:`gvla2.memory.curation.contesting`, carried out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.contracts import Learned, MemoryEpisode, Trust, Verdict
from gvla2.memory.curation.admission import Weighed
from gvla2.memory.curation.contesting import Edit, consolidate, same_lesson
from gvla2.memory.curation.evidence import confirmed, counted, new_record, repeated, restarted
from gvla2.memory.curation.ledger import BankLedger
from gvla2.memory.curation.trust import Origin, adds, believed, trust_of
from gvla2.memory.indexing.candidates import SERVED
from gvla2.memory.records import Record

Vector = NDArray[np.float32]


@dataclass(frozen=True)
class Brought:
    """An episode, its verdict, whether it is ours, and why ``unsure`` texts of a model are not believed immediately."""

    episode: MemoryEpisode
    verdict: Verdict
    own: bool
    unsure: Mapping[str, str]

    @property
    def origin(self) -> Origin:
        """Its origin."""
        return Origin(self.own, self.episode.source)


@dataclass
class LessonTally:
    """Collects the fate of lessons as it is decided."""

    added: list[str] = field(default_factory=list)
    merged: list[str] = field(default_factory=list)
    provisional: list[str] = field(default_factory=list)
    discarded: int = 0
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Add a sentence, unless it is empty."""
        self.notes += [text] if text else []

    def learned(self) -> Learned:
        """The contract's answer, each id and sentence once."""
        listed = (self.added, self.merged, self.provisional, self.notes)
        added, merged, held, notes = (tuple(dict.fromkeys(entries)) for entries in listed)
        return Learned(added, merged, held, self.discarded, notes)


class Learning:
    """Adds the candidates of one episode, ``own`` or foreign, to a bank, within one transaction."""

    def __init__(self, ledger: BankLedger, brought: Brought, tally: LessonTally) -> None:
        self._ledger, self._episode, self._verdict = ledger, brought.episode, brought.verdict
        self._options, self._tally = ledger.options, tally
        self._origin, self._word = brought.origin, str(brought.origin)
        self.touched: list[str] = []
        self.rivals: dict[str, list[Record]] = {}
        """The records found nearest to the compared ones."""

    def apply(self, candidate: Weighed) -> None:
        """Add the candidate, merge it, promote what it confirms, or leave the bank as it is."""
        ledger, verified = self._ledger, candidate.state == "active"
        known = ledger.by_key(candidate.key)
        if known is not None and known.state == "archive":
            known = self._heir(known) or known
        fresh = new_record(ledger.transaction.bank, candidate, self._episode, self._verdict, ledger.now)
        if known is None and candidate.trust != "own":
            near = ledger.nearest(candidate.vector, self._options.rivals, ("provisional",))
            known = next((record for record, _ in near if same_lesson(record, fresh)), None)
        held = known if known is not None and known.state != "archive" and not self._origin.own else None
        if held is not None and (held.trust == "own" or not adds(ledger.origins(held.id), self._origin)):
            why = f"{held.id} gains nothing from it: its source is already counted, or the lesson is ours"
            self._discard(held.id, why)
            return
        if not verified:
            self._unverified(candidate, fresh, known)
            return
        trust = self._trust(known, candidate)
        fresh = replace(fresh, trust=trust)
        if not believed(trust):
            note = candidate.note or "no two independent sources have confirmed it"
            held = replace(fresh, state="provisional")
            self._unverified(replace(candidate, note=note), held, known, self._word)
        elif known is not None and known.state in SERVED:
            self._confirm(known, fresh, candidate, "one more episode says the same")
        elif known is not None and known.state == "archive" and counted(known, self._episode):
            self._discard(known.id, f"{known.id} stays archived: it rests on this episode already")
        else:
            self._verified(candidate, fresh, known)

    # Lessons that are not believed --------------------------------------------------------------------------------

    def _unverified(self, candidate: Weighed, fresh: Record, known: Record | None, origin: str = "") -> None:
        if known is None:
            self._provisional(replace(fresh, note=candidate.note), "PROVISIONAL", origin, candidate.vector)
        elif known.state == "archive":
            # An unverified episode does not revive a replaced or retired record.
            self._discard(known.id, "an unverified repeat of what was archived changes nothing")
        elif known.state in SERVED:
            self._discard(known.id, f"{known.id} is already believed: an unbelieved repeat changes nothing")
        elif counted(known, self._episode):
            self._repeated(known, fresh, self._tally.provisional)
        else:
            grown = confirmed(known, fresh, self._episode, self._verdict, self._ledger.now)
            outcome = fresh.outcome if origin else known.outcome
            self._provisional(replace(grown, outcome=outcome, trust=fresh.trust), "MERGE", origin)

    def _provisional(self, record: Record, action: str, origin: str, vector: Vector | None = None) -> None:
        self._store(record, action, record.note, origin, vector)
        self._tally.provisional.append(record.id)
        self._tally.note(f"{record.id} is provisional: {record.note}.")

    def _discard(self, id: str, why: str) -> None:
        self._tally.discarded += 1
        self._tally.note(f"{why[0].upper()}{why[1:]}." if not why.startswith(id) else f"{why}.")
        self._ledger.decide("DISCARD", id, why)
        self.touched.append(id)

    def _repeated(self, known: Record, fresh: Record, listed: list[str]) -> None:
        """The same source again: it counts only once."""
        why = f"{known.id} already rests on this episode, which counts once"
        listed.append(known.id)
        self._tally.note(f"{why}.")
        again = repeated(known, fresh)
        if again == known:
            self._ledger.decide("REPEATED", known.id, why)
        else:
            self._ledger.put(again, "REPEATED", why)
        self.touched.append(known.id)

    # Lessons that are ---------------------------------------------------------------------------------------------

    def _verified(self, candidate: Weighed, fresh: Record, known: Record | None) -> None:
        options = self._options
        record = fresh
        if known is not None and known.state == "provisional":
            record = restarted(known, fresh, self._episode)
        elif known is not None:
            grown = confirmed(known, fresh, self._episode, self._verdict, self._ledger.now)
            record = replace(grown, state="active", outcome=fresh.outcome, trust=fresh.trust, note="")
        rivals = self._ledger.nearest(candidate.vector, options.rivals) if options.governance else []
        self.rivals[record.id] = [rival for rival, _ in rivals]
        edit = consolidate(record, rivals, options) if options.governance else Edit("ADD")
        if edit.action == "MERGE":
            self._fold(record, fresh, candidate, edit)
            return
        if edit.action == "DISCARD":
            self._store(replace(record, state="archive", note=edit.why), "DISCARD", edit.why, self._word)
            self._tally.discarded += 1
            self._tally.note(f"{record.id} was archived: {edit.why}.")
        else:
            self._add(record, candidate, edit)
        for kind, others in (("conflict", edit.conflicts), ("suspicion", edit.suspected)):
            for other, why in others:
                self._ledger.link(record.id, kind, other, why)

    def _add(self, record: Record, candidate: Weighed, edit: Edit) -> None:
        vector = candidate.vector if not record.version else None
        self._store(record, edit.action, edit.why, self._word, vector)
        (self._tally.merged if record.version else self._tally.added).append(record.id)
        if record.version:
            self._tally.note(f"{record.id} is verified now and became active.")
        for id, why in edit.conflicts if edit.action == "REPLACE" else ():
            loser = self._ledger.get(id)
            if loser is not None and loser.type == record.type:
                self._ledger.replace(record, loser, "REPLACED", f"replaced by {record.id}", why)
                self._tally.note(f"{record.id} replaces {id}: {why}.")

    def _fold(self, record: Record, fresh: Record, candidate: Weighed, edit: Edit) -> None:
        """The candidate becomes evidence for its target; its own wording is kept in the archive, linked."""
        target = self._ledger.get(edit.target)
        if target is None:
            self._add(record, candidate, replace(edit, action="ADD"))
            return
        note = f"merged into {target.id}"
        self._store(replace(record, state="archive", note=note), "MERGED", edit.why, self._word)
        self._ledger.link(target.id, "merged", record.id, edit.why)
        self._confirm(target, fresh, candidate, edit.why)

    def _confirm(self, known: Record, fresh: Record, candidate: Weighed, why: str) -> None:
        if counted(known, self._episode):
            self._repeated(known, fresh, self._tally.merged)
            return
        grown = confirmed(known, fresh, self._episode, self._verdict, self._ledger.now)
        self._store(replace(grown, trust=self._trust(known, candidate)), "MERGE", why, self._word)
        self._tally.merged.append(known.id)

    def _trust(self, known: Record | None, candidate: Weighed) -> Trust:
        """A text's trust with this episode: by the origins on the chain, whatever a record claims."""
        if known is not None and known.state == "summary":
            return known.trust  # it includes other texts, with origins of their own
        told = self._ledger.origins(known.id) if known else []
        return trust_of([*told, self._origin], screened=candidate.screened)

    def _store(
        self, record: Record, action: str, why: str, origin: str, vector: Vector | None = None
    ) -> None:
        self._ledger.put(record, action, why, vector=vector, origin=origin)
        self.touched.append(record.id)

    def _heir(self, archived: Record) -> Record | None:
        """The live record that an archived one was merged into, directly or not."""
        due, seen = [archived.id], {archived.id}
        while due:
            id = due.pop()
            for link in self._ledger.links(id):
                if link.target == id and link.kind in ("merged", "summary_of") and link.source not in seen:
                    heir = self._ledger.get(link.source)
                    if heir is not None and heir.state in SERVED:
                        return heir
                    seen.add(link.source)
                    due.append(link.source)
        return None
