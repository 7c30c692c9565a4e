"""What a bank keeps: which failures retire, which contradictions and programs stay, and what the budget archives.

Runs after each episode on what it touched, or over the whole bank. Nothing is ever deleted here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

from gvla2.memory.admission import evidence, standing, warns
from gvla2.memory.candidates import SECONDS_PER_DAY
from gvla2.memory.contradiction import conflict_of
from gvla2.memory.ledger import Ledger, OpenBank, deciding
from gvla2.memory.records import Record, dump

PROGRAMS = 3
"""Number of programs kept per skill, language and kinds of objects."""


@dataclass
class Governed:
    """What a pass did: ids by decision."""

    retired: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    archived: list[str] = field(default_factory=list)


def retention(record: Record, now: float) -> float:
    """How much a record deserves to stay, by the released terms: R + kappa, +.5 for a verified lesson and -.3
    otherwise, .1 per credited use up to .5, and up to .25 for recency (lost over 90 days).

    R is recovered from kappa = 2|R - .5|: R + kappa = .5 + 1.5 kappa.
    """
    days = max(now - max(record.updated, record.used), 0.0) / SECONDS_PER_DAY
    verified = 0.5 if record.outcome == "verified_success" or warns(record) else -0.3
    recency = max(0.0, 0.25 - days / 90.0)
    return 0.5 + 1.5 * record.confidence + verified + min(0.1 * record.usage, 0.5) + recency


def govern(bank: OpenBank, done: Governed) -> Governed:
    """A pass over the whole bank, added to ``done``."""
    with deciding(bank, "govern") as ledger:
        governing = Governing(ledger, done)
        governing.retire()
        governing.resolve()
        governing.keep_few_programs(ledger.held("active"))
        governing.cut()
        bank.retired_at = ledger.now
    return done


def govern_changes(bank: OpenBank, ledger: Ledger) -> None:
    """The part that an episode's changes make due: programs, the budgets and, once an hour, retirement."""
    governing = Governing(ledger, Governed())
    if ledger.now - bank.retired_at > SECONDS_PER_DAY / 24:
        bank.retired_at = ledger.now
        governing.retire()
    if any(map(_group_of_program, ledger.changed())):
        governing.keep_few_programs(ledger.held("active"))
    governing.cut()


class Governing:
    """Decides, and carries it out, within one transaction."""

    def __init__(self, ledger: Ledger, done: Governed) -> None:
        self._ledger, self._options, self.done = ledger, ledger.options, done

    def retire(self) -> None:
        """Archive failures unused for ``retire_days``."""
        limit, now = self._options.retire_days, self._ledger.now
        for record in self._ledger.held("active"):
            old = now - max(record.updated, record.used) >= limit * SECONDS_PER_DAY
            if old and not record.usage and record.outcome != "verified_success":
                self._archive(record, "RETIRE", f"a failure unused for {limit:g} days", self.done.retired)

    def resolve(self) -> None:
        """Archive records that a stronger one about the same parameter contradicts: promoted by replay, or added while
        governance was off.
        """
        groups: dict[tuple[str, ...], list[Record]] = defaultdict(list)
        for record in self._ledger.held("active"):
            effect = record.effect_json() if record.effect else None
            if effect and effect.get("kind") != "program":
                about = [str(effect.get(name, "")) for name in ("parameter", "object", "region")]
                groups[record.type, record.skill, *about].append(record)
        for group in groups.values():
            kept: list[Record] = []
            for record in sorted(group, key=standing):
                found = ((winner, conflict_of(winner, record)) for winner in kept)
                winner, why = next(((one, why) for one, why in found if why), (record, ""))
                if not why:
                    kept.append(record)
                    continue
                self._archive(record, "REPLACED", f"replaced by {winner.id}", self.done.replaced)
                self._ledger.transaction.link(winner.id, "conflict", record.id, why)

    def keep_few_programs(self, records: Iterable[Record]) -> None:
        """Of the programs of one skill, language and kinds of objects, keep those with most evidence."""
        groups: dict[str, list[Record]] = defaultdict(list)
        for record in records:
            if group := _group_of_program(record):
                groups[group].append(record)
        for programs in groups.values():
            best = sorted(programs, key=lambda r: (-evidence(r), -r.usage, -r.updated, r.id))
            for record in best[PROGRAMS:]:
                self._archive(record, "ARCHIVE", f"{PROGRAMS} others have more evidence", self.done.archived)

    def cut(self) -> None:
        """Archive records beyond the budgets, least worth keeping first."""
        budgets = {"active": self._options.active_budget, "provisional": self._options.provisional_budget}
        for state, budget in budgets.items():
            if len(self._ledger.index) + len(self._ledger.changed()) <= budget:
                continue
            held = self._ledger.held(state)
            ranked = sorted(held, key=lambda record: (retention(record, self._ledger.now), record.id))
            for record in ranked[: max(len(held) - budget, 0)]:
                self._archive(record, "ARCHIVE", f"beyond the budget of {budget} records", self.done.archived)

    def _archive(self, record: Record, action: str, why: str, listed: list[str]) -> None:
        self._ledger.archive(record, action, why)
        listed.append(record.id)


def _group_of_program(record: Record) -> str:
    """What an active record's program is for (type, skill, language, kinds of objects); "" without a program."""
    effect = record.effect_json() if record.effect and record.state == "active" else None
    if not effect or effect.get("kind") != "program":
        return ""
    return dump([record.type, *(effect.get(name) for name in ("skill", "language", "roles"))])
