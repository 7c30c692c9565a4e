"""What a bank keeps: which failures retire, what is summarised, which programs stay, and what the budget archives.

Runs after each episode on what it touched, or over the whole bank. Nothing is ever deleted here.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from textwrap import shorten
from typing import Any

from gvla2.memory.admission import MAX_SOURCES, evidence, phrasings, standing, support, warns
from gvla2.memory.contradiction import conflict_of
from gvla2.memory.forgetting import SUMMED_UP
from gvla2.memory.index import SECONDS_PER_DAY, SERVED
from gvla2.memory.ledger import Ledger, OpenBank, deciding
from gvla2.memory.records import Record, dedup_key, dump, load_object, record_id
from gvla2.memory.trust import least

PROGRAMS = 3
"""Number of programs kept per skill and kinds of objects: those that differ in kind."""
LENGTH = 500
"""Most characters of a summary: what does not fit stays a record of its own. A recall shows that many of a record."""
TASKS, TASK_LENGTH = 3, 60
"""Most tasks that are kept with a number, and most characters of each."""
_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)*")
_GAP = "\x00"
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


def govern(bank: OpenBank, done: Governed) -> Governed:
    """A pass over the whole bank, added to ``done``."""
    with deciding(bank, "govern") as ledger:
        Governing(ledger, done).whole()
        bank.retired_at = ledger.now
    return done


class Governing:
    """Decides, and carries it out, within one transaction."""

    def __init__(self, ledger: Ledger, done: Governed) -> None:
        self._ledger, self._options, self.done = ledger, ledger.options, done

    def whole(self) -> None:
        """All of it, on all records."""
        index = self._ledger.index
        self.retire()
        active = index.records("active")
        self.resolve(active)
        self.keep_few_programs(active)
        in_words = [record for record in active if not record.effect]
        for record in sorted(in_words, key=lambda r: (-r.updated, r.id))[:_LOOKED_AT]:
            self.sum_up(record)
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
                self._archive(record, "RETIRE", f"a failure unused for {limit:g} days", self.done.retired)

    def resolve(self, records: Iterable[Record]) -> None:
        """Archive records that a stronger one about the same parameter contradicts: promoted by replay, or added while
        governance was off.
        """
        groups: dict[tuple[str, ...], list[Record]] = defaultdict(list)
        for record in map(self._ledger.latest, records):
            effect = record.effect_json() if record.effect else None
            if record.state == "active" and effect and effect.get("kind") != "program":
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
        """Of the programs of one skill and the same kinds of objects, keep the best of each of the few best kinds."""
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

    def sum_up(self, record: Record) -> None:
        """Fold a success in words into the summary of its wording, or make one from it and others of that wording."""
        record = self._ledger.latest(record)
        if not _summable(record):
            return
        found = self._ledger.nearest(self._ledger.vector(record), self._options.rivals)
        near = [other for other, _ in found if other.id != record.id and _alike(record, other)]
        for summary in (other for other in near if other.state == "summary"):
            if len(group := _fitting([summary, record])) > 1:
                self._write(group)
                return
        group = _fitting([record, *(other for other in near if other.state == "active")])
        if len(group) >= self._options.summary_size:
            self._write(group)

    def _write(self, group: Sequence[Record]) -> None:
        """Replace several records by one summary."""
        summary = summary_of(group, self._ledger.now)
        known = None if summary.version else self._ledger.get(summary.id)
        if known is not None and known.state == "summary":  # it is full
            summary = summary_of(group, self._ledger.now, f" {self._ledger.transaction.rev} {group[0].id}")
        elif known is not None:  # archived
            summary = replace(summary, version=known.version, created=known.created)
        why = f"{len(group)} records differ in their numbers only"
        self._ledger.put(summary, "SUMMARY", why)
        if summary.id not in self.done.summaries:
            self.done.summaries.append(summary.id)
        for member in group:
            if member.id != summary.id:
                note = f"{SUMMED_UP}{summary.id}"
                self._archive(member, "SUMMED_UP", why, self.done.summed_up, note)

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
        self._ledger.archive(record, action, why, note)
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


# Summaries of successes that differ in their numbers only -------------------------------------------------------------


@dataclass
class Wording:
    """A text with gaps for its numbers, and each gap's values with the tasks that they were right for."""

    text: str
    gaps: list[dict[str, list[str]]]

    @classmethod
    def of(cls, record: Record) -> Wording:
        """A record's or summary's wording; the caller owns it."""
        kept = load_object(record.provenance).get("wording") if record.state == "summary" else None
        if isinstance(kept, dict):
            return cls(**kept)
        content = " ".join(record.content.split())
        task = shorten(record.query.split("\n")[0], TASK_LENGTH, placeholder=" …")
        gaps = [{value: [task] if task else []} for value in _NUMBER.findall(content)]
        return cls(_NUMBER.sub(_GAP, content), gaps)

    def take_in(self, other: Wording) -> None:
        """Add the numbers of one more of the same text."""
        for mine, theirs in zip(self.gaps, other.gaps, strict=False):
            for value, tasks in theirs.items():
                known = mine.setdefault(value, [])
                known += [task for task in tasks if task not in known][: max(0, TASKS - len(known))]

    def filled(self) -> str:
        """The text with its numbers; those that were right for the same tasks stand together."""
        text, *rest = self.text.split(_GAP)
        for gap, after in zip(self.gaps, rest, strict=False):
            by_tasks: dict[str, list[str]] = {}
            for value in sorted(gap, key=_size):
                by_tasks.setdefault("; ".join(gap[value]) or "once", []).append(value)
            listed = [f"{', '.join(values)} ({tasks})" for tasks, values in by_tasks.items()]
            text += (next(iter(gap)) if len(gap) == 1 else " or ".join(listed)) + after
        return text


def summary_of(group: Sequence[Record], now: float, about: str = "") -> Record:
    """The summary of records of one wording, of which the first may be an older summary; of version 0 if it is new.

    ``about`` tells it from another of the same wording. It is trusted no more than the least trusted of the group.
    """
    old = group[0] if group[0].state == "summary" else None
    best = old or max(group, key=lambda r: (support(r), r.count, r.id))
    query, sources, wording = "", list[str](), Wording.of(group[0])
    for record in group:
        query = phrasings(query, record.query) if query else record.query
        sources += [source for source in record.sources() if source not in sources]
        wording.take_in(Wording.of(record))
    count = sum(record.count for record in group)
    quality = sum(record.quality * record.count for record in group) / count
    key = (
        old.dedup_key if old else dedup_key(best.type, f"summary of {wording.text}{about}", best.skill, None)
    )
    provenance = {"made_by": {"governance": "summary"}, "sources": sources[-MAX_SOURCES:]}
    return replace(
        best,
        id=old.id if old else record_id("summary", best.bank, key),
        state="summary",
        query=query,
        content=f"Worked {count} times: {wording.filled()}",
        dedup_key=key,
        quality=quality,
        confidence=min(max(r.confidence for r in group), 2 * abs(quality - 0.5)),
        count=count,
        usage=sum(r.usage for r in group),
        recalled=sum(r.recalled for r in group),
        used=max(r.used for r in group),
        provenance=dump({**provenance, "wording": vars(wording)}),
        note=f"sums up {count} episodes",
        trust=least(record.trust for record in group),
        created=old.created if old else now,
        updated=max(r.updated for r in group),
        version=old.version if old else 0,
        rev=old.rev if old else 0,
    )


def _summable(record: Record) -> bool:
    return record.outcome == "verified_success" and record.state in SERVED and not record.effect


def _alike(first: Record, second: Record) -> bool:
    """Whether two successes in words differ in their numbers only."""
    if not _summable(second) or (first.type, first.skill) != (second.type, second.skill):
        return False
    return _wording(first) == _wording(second)


@lru_cache(maxsize=16384)
def _wording(record: Record) -> str:
    return Wording.of(record).text.casefold().rstrip(".! ")


def _fitting(group: Sequence[Record]) -> list[Record]:
    """The first of a group, and those of the others with which a summary shows each of their numbers."""
    kept, wording = list(group[:1]), Wording.of(group[0])
    for record in group[1:]:
        longer = Wording(
            wording.text, [{value: [*tasks] for value, tasks in gap.items()} for gap in wording.gaps]
        )
        longer.take_in(Wording.of(record))
        if len(longer.filled()) <= LENGTH:
            kept.append(record)
            wording = longer
    return kept


def _size(value: str) -> tuple[float, str]:
    try:
        return float(value.replace(",", ".")), value
    except ValueError:
        return math.inf, value
