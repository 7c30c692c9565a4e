"""What a bank keeps: which failures retire, what is summarised, which programs stay, and what the budget archives. Runs
after each episode on what it touched, or over the whole bank. Nothing is ever deleted here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from gvla2.memory.curation.contesting import SUSPECT, compare
from gvla2.memory.curation.evidence import evidence, standing, warns
from gvla2.memory.curation.ledger import BankLedger, deciding
from gvla2.memory.curation.summaries import alike_but_for_numbers, fitting, shared_terms, summary_of, tasks_of
from gvla2.memory.indexing.candidates import SECONDS_PER_DAY, SERVED
from gvla2.memory.records import Record
from gvla2.memory.storage.forgetting import SUMMED_UP

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

PROGRAMS = 3
"""Number of programs kept per skill and kinds of things: those that differ in kind."""
_LOOKED_AT = 2000
"""Records whose neighbours a pass over the whole bank searches."""


@dataclass
class Governed:
    """What a pass did: ids by decision."""

    retired: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    summaries: list[str] = field(default_factory=list)
    summed_up: list[str] = field(default_factory=list)
    archived: list[str] = field(default_factory=list)

    @property
    def changes(self) -> int:
        """How many records the pass changed or made."""
        return sum(map(len, vars(self).values()))


def retention(record: Record, now: float) -> float:
    """How much a record deserves to stay, by the released terms: R + kappa, +.5 for a verified lesson and -.3
    otherwise, .1 per credited use up to .5, and up to .25 for recency (lost over 90 days).

    R is recovered from kappa = 2|R - .5|: R + kappa = .5 + 1.5 kappa.
    """
    days = max(now - max(record.updated, record.used), 0.0) / SECONDS_PER_DAY
    verified = 0.5 if record.outcome == "verified_success" or warns(record) else -0.3
    recency = max(0.0, 0.25 - days / 90.0)
    return 0.5 + 1.5 * record.confidence + verified + min(0.1 * record.usage, 0.5) + recency


def govern(bank: KnowledgeBank, done: Governed) -> Governed:
    """A pass over the whole bank, added to ``done``."""
    with deciding(bank, "govern") as ledger:
        Governing(ledger, done).whole()
        bank.retired_at = ledger.now
    return done


class Governing:
    """Decides, and carries it out, within one transaction."""

    def __init__(self, ledger: BankLedger, done: Governed) -> None:
        self._ledger, self._options, self.done = ledger, ledger.options, done

    def whole(self) -> None:
        """All of it, on all records."""
        index = self._ledger.index
        self.retire()
        active = index.records("active")
        self.resolve(active)
        self.keep_few_programs(active)
        words = [record for record in active if not record.effect]
        for record in sorted(words, key=lambda r: (-r.updated, r.id))[:_LOOKED_AT]:
            self.sum_up(record)
        for summary in index.records("summary"):
            self.sum_up(summary)
        self.cut()

    def touched(self) -> None:
        """The part that depends on an episode's changes but not its words: programs, and the budgets."""
        if programs := [r for r in self._ledger.changed() if r.state == "active" and _program(r)]:
            known = {record.id: record for record in [*self._ledger.index.records("active"), *programs]}
            self.keep_few_programs(known.values())
        self.cut()

    def retire(self) -> None:
        """Archive failures, except summaries, unused for ``retire_days``."""
        limit, now = self._options.retire_days, self._ledger.now
        for record in map(self._ledger.latest, self._ledger.index.records("active")):
            if record.state != "active" or record.usage or record.outcome == "verified_success":
                continue
            if now - max(record.updated, record.used) >= limit * SECONDS_PER_DAY:
                why = f"a failure unused for {limit:g} days"
                self._archive(record, "RETIRE", why, self.done.retired)

    def resolve(self, records: Iterable[Record]) -> None:
        """Archive records that a stronger one about the same parameter contradicts: promoted by replay, or added while
        governance was off.
        """
        groups: dict[tuple[str, ...], list[Record]] = defaultdict(list)
        for record in records:
            effect = record.effect_json() if record.effect else None
            if effect and effect.get("kind") != "program":
                about = [str(effect.get(name, "")) for name in ("parameter", "object", "region")]
                groups[record.type, record.skill, *about].append(record)
        for group in groups.values():
            kept: list[Record] = []
            for record in sorted(group, key=standing):
                found = ((winner, compare(winner, record).effect) for winner in kept)
                winner, why = next(((one, why) for one, why in found if why), (record, ""))
                if not why:
                    kept.append(record)
                    continue
                self._ledger.replace(winner, record, "REPLACED", f"replaced by {winner.id}", why)
                self._ledger.link(winner.id, "conflict", record.id, why)
                self.done.replaced.append(record.id)

    def keep_few_programs(self, records: Iterable[Record]) -> None:
        """Of the programs of one skill and the same kinds of things, keep the best of each of the few best kinds."""
        groups: dict[tuple[str, ...], list[Record]] = defaultdict(list)
        for record in map(self._ledger.latest, records):
            if record.state == "active" and (program := _program(record)):
                roles = program.get("roles")
                kinds = sorted(f"{k}={v}" for k, v in roles.items()) if isinstance(roles, dict) else []
                groups[str(program.get("skill")), record.type, *kinds].append(record)
        for group in groups.values():
            kept: dict[tuple[str, ...], Record] = {}
            for record in sorted(group, key=lambda r: (-evidence(r), -r.usage, -r.updated, r.id)):
                kind = steps_of(_program(record) or {})
                best = kept.get(kind)
                if best is None and len(kept) < PROGRAMS:
                    kept[kind] = record
                    continue
                better = f"{best.id} of the same steps" if best else f"{PROGRAMS} others"
                self._archive(record, "ARCHIVE", f"{better} have more evidence", self.done.archived)

    # Summaries ----------------------------------------------------------------------------------------------------

    def sum_up(self, record: Record, rivals: Sequence[Record] | None = None) -> None:
        """Fold a success into a similar summary, or make one from it and similar successes.

        ``rivals`` are those nearest to it, if known.
        """
        record = self._ledger.latest(record)
        if not self._summable(record):
            return
        if rivals is None:
            found = self._ledger.nearest(self._ledger.vector(record), self._options.rivals)
            rivals = [other for other, _ in found]
        near = [other for other in map(self._ledger.latest, rivals) if other.id != record.id]
        group = fitting([record, *(r for r in near if self._summable(r) and self._alike(record, r))])
        summaries = [r for r in group if r.state == "summary"]
        if len(group) < 2 or not (summaries or len(group) >= self._options.summary_size):
            return
        told_alike = all(alike_but_for_numbers(record, other) for other in group[1:])
        if not summaries and not told_alike and len(tasks_of(group)) < 2:
            return
        self.write(group)

    def write(self, group: Sequence[Record], text: str = "") -> None:
        """Replace several records by one summary, by rule unless its ``text`` is given."""
        summary = summary_of(group, self._ledger.now, text)
        known = None if summary.version else self._ledger.get(summary.id)
        if known is not None and known.state == "summary":
            # It has the same words and was not near, or is full.
            full = len(fitting([known, *group])) <= len(group)
            about = f" {self._ledger.transaction.rev} {group[0].id}" if full else ""
            summary = summary_of(group if full else [known, *group], self._ledger.now, text, about)
        elif known is not None:  # archived
            summary = replace(summary, version=known.version, created=known.created)
        why = f"{len(group)} records of {len(tasks_of(group))} tasks are alike"
        self._ledger.put(summary, "SUMMARY", why, near=self._ledger.vector(group[0]))
        if summary.id not in self.done.summaries:
            self.done.summaries.append(summary.id)
        for member in group:
            if member.id != summary.id:
                self._archive(member, "SUMMED_UP", why, self.done.summed_up, f"{SUMMED_UP}{summary.id}")
                self._ledger.link(summary.id, "summary_of", member.id, why)

    def _summable(self, record: Record) -> bool:
        return record.outcome == "verified_success" and record.state in SERVED and not record.effect

    def _alike(self, record: Record, other: Record) -> bool:
        """Whether two successes may share a summary; not if they may contradict each other."""
        if (record.type, record.skill) != (other.type, other.skill):
            return False
        if alike_but_for_numbers(record, other):
            return True
        if shared_terms(record, other) < self._options.summary_match:
            return False
        found = compare(record, other)
        return not found.effect and (found.suspicion or 0.0) < SUSPECT

    # Budgets ------------------------------------------------------------------------------------------------------

    def cut(self) -> None:
        """Archive records beyond the budgets, least worth keeping first."""
        budgets = {SERVED: self._options.active_budget, ("provisional",): self._options.provisional_budget}
        for states, budget in budgets.items():
            changed = {record.id: record for record in self._ledger.changed()}
            if sum(map(self._ledger.index.count, states)) + len(changed) <= budget:
                continue
            held = {record.id: record for state in states for record in self._ledger.index.records(state)}
            left = [record for record in (held | changed).values() if record.state in states]
            ranked = sorted(left, key=lambda record: (retention(record, self._ledger.now), record.id))
            for record in ranked[: max(len(left) - budget, 0)]:
                self._archive(record, "ARCHIVE", f"beyond the budget of {budget} records", self.done.archived)

    def _archive(self, record: Record, action: str, why: str, listed: list[str], note: str = "") -> None:
        self._ledger.put(replace(record, state="archive", note=note or why), action, why)
        listed.append(record.id)


def steps_of(program: dict[str, Any]) -> tuple[str, ...]:
    """The kind of a program: the acts of its steps, without their numbers."""
    steps = program.get("steps")
    acts = []
    for step in steps if isinstance(steps, list) else ():
        # A call is a line, "place({theme}, {goal}, in)"; a waypoint a list that begins with what it is relative to.
        first = step[0] if isinstance(step, list) and step else step
        acts.append(str(first).partition("(")[0].strip())
    return (str(program.get("language")), *acts)


def _program(record: Record) -> dict[str, Any] | None:
    effect = record.effect_json() if record.effect else None
    return effect if effect and effect.get("kind") == "program" else None
