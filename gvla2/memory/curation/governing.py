"""A pass of governance carried out: after each episode on what it touched, or over the whole bank."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.curation import governance
from gvla2.memory.curation.growth import SUMMED_UP
from gvla2.memory.curation.ledger import Ledger
from gvla2.memory.records import Record


@dataclass
class Governed:
    """What a pass did: ids by decision."""

    retired: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    summaries: list[str] = field(default_factory=list)
    summed_up: list[str] = field(default_factory=list)
    archived: list[str] = field(default_factory=list)
    degraded: str = ""

    @property
    def changes(self) -> int:
        """How many records the pass changed or made."""
        return sum(map(len, (self.retired, self.replaced, self.summaries, self.summed_up, self.archived)))


class Governing:
    """Carries out decisions of :mod:`gvla2.memory.curation.governance` within one transaction."""

    def __init__(self, ledger: Ledger, options: BankOptions, done: Governed) -> None:
        self._ledger, self._options, self.done = ledger, options, done

    def whole(
        self, active: Sequence[Record], summaries: Sequence[Record], provisional: Sequence[Record]
    ) -> None:
        """All of it, on all records."""
        self.retire(active)
        words = governance.words_by_id(active)
        self.resolve(self._still(active), words)
        for group in governance.clusters(self._still(active), self._options, words):
            self.sum_up(group)
        made = [record for id in self.done.summaries if (record := self._ledger.get(id)) is not None]
        for records, budget in (
            ([*self._still(active), *summaries, *made], self._options.active_budget),
            (list(provisional), self._options.provisional_budget),
        ):
            self.cut(records, len(records) - budget, budget)

    def retire(self, records: Sequence[Record]) -> None:
        """Archive stale failures."""
        days = self._options.retire_days
        for record in governance.retired(records, self._ledger.now, self._options):
            self._archive(record, "RETIRE", f"a failure that nobody used for {days:g} days")
            self.done.retired.append(record.id)

    def resolve(self, records: Sequence[Record], words: Mapping[str, frozenset[str]] | None = None) -> None:
        """Archive what is contradicted by more evidence, linked to what prevails; link what cannot be settled."""
        for found in governance.contradictions(records, words):
            winner, loser, why = found.winner, found.loser, found.conflict.why
            if winner.type == loser.type:
                self._archive(
                    loser, "REPLACED", f"contradicted by {winner.id}: {why}", f"replaced by {winner.id}"
                )
                self._ledger.link(winner.id, "replaces", loser.id, why)
                self.done.replaced.append(loser.id)
            self._ledger.link(winner.id, "conflict", loser.id, why)

    def sum_up(self, group: Sequence[Record]) -> None:
        """One summary in place of several successes."""
        summary, held = governance.summary_of(group, self._ledger.now)
        known = self._ledger.get(summary.id)
        if known is not None and known.state != "archive":
            return
        if known is not None:
            summary = replace(summary, version=known.version, created=known.created)
        why = f"{len(held)} successes of {len(governance.tasks_of(held))} tasks are alike"
        self._ledger.put(summary, "SUMMARY", self._ledger.mean_vector([record.id for record in held]), why)
        self.done.summaries.append(summary.id)
        for record in held:
            self._archive(record, "SUMMED_UP", why, f"{SUMMED_UP}{summary.id}")
            self._ledger.link(summary.id, "summary_of", record.id, why)
            self.done.summed_up.append(record.id)

    def cut(self, records: Sequence[Record], excess: int, budget: int) -> None:
        """Archive ``excess`` of these records, those least worth keeping."""
        for record in governance.overflow(records, self._ledger.now, len(records) - excess):
            self._archive(record, "ARCHIVE", f"beyond the budget of {budget} records")
            self.done.archived.append(record.id)

    def _still(self, records: Sequence[Record]) -> list[Record]:
        latest = (self._ledger.decided(record) for record in records)
        return [record for record in latest if record.state == "active"]

    def _archive(self, record: Record, action: str, why: str, note: str = "") -> None:
        self._ledger.put(replace(record, state="archive", note=note or why), action, why=why)
