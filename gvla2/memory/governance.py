"""What a bank keeps: which failures retire, which programs stay, and what the budgets archive.

Runs after each episode, within its transaction. Nothing is ever deleted here.
"""

from __future__ import annotations

from collections import defaultdict

from gvla2.memory.admission import evidence, warns
from gvla2.memory.candidates import SECONDS_PER_DAY
from gvla2.memory.ledger import LessonLedger
from gvla2.memory.records import Record, dump

PROGRAMS = 3
"""Number of programs kept per skill, language and kinds of objects."""


def govern(ledger: LessonLedger) -> None:
    """Archive stale failures, all but a few programs for the same purpose, and records beyond the budgets."""
    options, programs = ledger.options, defaultdict[str, list[Record]](list)
    for record in ledger.held("active"):
        old = ledger.now - max(record.updated, record.used) >= options.retire_days * SECONDS_PER_DAY
        if old and not record.usage and record.outcome != "verified_success":
            ledger.archive(record, "RETIRE", f"a failure unused for {options.retire_days:g} days")
        elif "program" in record.effect and (effect := record.effect_json() or {}).get("kind") == "program":
            purpose = dump([record.type, *(effect.get(name) for name in ("skill", "language", "roles"))])
            programs[purpose].append(record)
    for some in programs.values():
        for record in sorted(some, key=lambda r: (-evidence(r), -r.usage, -r.updated, r.id))[PROGRAMS:]:
            ledger.archive(record, "ARCHIVE", f"{PROGRAMS} others have more evidence")
    for state, budget in (("active", options.active_budget), ("provisional", options.provisional_budget)):
        held = ledger.held(state)
        if len(held) > budget:
            ranked = sorted(held, key=lambda record: (retention(record, ledger.now), record.id))
            for record in ranked[: len(held) - budget]:
                ledger.archive(record, "ARCHIVE", f"beyond the budget of {budget} records")


def retention(record: Record, now: float) -> float:
    """How much a record deserves to stay, by the released terms: R + kappa, +.5 for a verified lesson and -.3
    otherwise, .1 per credited use up to .5, and up to .25 for recency (lost over 90 days).

    R is recovered from kappa = 2|R - .5|: R + kappa = .5 + 1.5 kappa.
    """
    days = max(now - max(record.updated, record.used), 0.0) / SECONDS_PER_DAY
    verified = 0.5 if record.outcome == "verified_success" or warns(record) else -0.3
    recency = max(0.0, 0.25 - days / 90.0)
    return 0.5 + 1.5 * record.confidence + verified + min(0.1 * record.usage, 0.5) + recency
