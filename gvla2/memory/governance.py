"""What a bank keeps: which failures retire, which programs stay, and what the budgets archive.

Runs after each episode, within its transaction. Nothing is ever deleted here.
"""

from __future__ import annotations

from collections import defaultdict

from gvla2.memory.admission import evidence, warns
from gvla2.memory.candidates import SECONDS_PER_DAY
from gvla2.memory.ledger import LessonLedger, OpenBank
from gvla2.memory.records import Record, dump

PROGRAMS = 3
"""Number of programs kept per skill, language and kinds of objects."""


def govern(bank: OpenBank, ledger: LessonLedger) -> None:
    """Retire stale failures (looked for once an hour), and archive programs and records beyond the budgets."""
    if ledger.now - bank.retired_at > SECONDS_PER_DAY / 24:
        bank.retired_at = ledger.now
        retire(ledger)
    if any(map(_group_of_program, ledger.changed())):
        keep_few_programs(ledger)
    cut(ledger)


def retention(record: Record, now: float) -> float:
    """How much a record deserves to stay, by the released terms: R + kappa, +.5 for a verified lesson and -.3
    otherwise, .1 per credited use up to .5, and up to .25 for recency (lost over 90 days).

    R is recovered from kappa = 2|R - .5|: R + kappa = .5 + 1.5 kappa.
    """
    days = max(now - max(record.updated, record.used), 0.0) / SECONDS_PER_DAY
    verified = 0.5 if record.outcome == "verified_success" or warns(record) else -0.3
    recency = max(0.0, 0.25 - days / 90.0)
    return 0.5 + 1.5 * record.confidence + verified + min(0.1 * record.usage, 0.5) + recency


def retire(ledger: LessonLedger) -> None:
    """Archive failures unused for ``retire_days``."""
    limit = ledger.options.retire_days
    for record in ledger.held("active"):
        old = ledger.now - max(record.updated, record.used) >= limit * SECONDS_PER_DAY
        if old and not record.usage and record.outcome != "verified_success":
            ledger.archive(record, "RETIRE", f"a failure unused for {limit:g} days")


def keep_few_programs(ledger: LessonLedger) -> None:
    """Of the programs of one skill, language and kinds of objects, keep those with most evidence."""
    groups: dict[str, list[Record]] = defaultdict(list)
    for record in ledger.held("active"):
        if group := _group_of_program(record):
            groups[group].append(record)
    for programs in groups.values():
        best = sorted(programs, key=lambda r: (-evidence(r), -r.usage, -r.updated, r.id))
        for record in best[PROGRAMS:]:
            ledger.archive(record, "ARCHIVE", f"{PROGRAMS} others have more evidence")


def cut(ledger: LessonLedger) -> None:
    """Archive records beyond the budgets, least worth keeping first."""
    budgets = {"active": ledger.options.active_budget, "provisional": ledger.options.provisional_budget}
    for state, budget in budgets.items():
        if len(ledger.index) + len(ledger.changed()) <= budget:
            continue
        held = ledger.held(state)
        ranked = sorted(held, key=lambda record: (retention(record, ledger.now), record.id))
        for record in ranked[: max(len(held) - budget, 0)]:
            ledger.archive(record, "ARCHIVE", f"beyond the budget of {budget} records")


def _group_of_program(record: Record) -> str:
    """What an active record's program is for (type, skill, language, kinds of objects); "" without a program."""
    effect = record.effect_json() if record.effect and record.state == "active" else None
    if not effect or effect.get("kind") != "program":
        return ""
    return dump([record.type, *(effect.get(name) for name in ("skill", "language", "roles"))])
