"""Whether two lessons contradict each other.

Typed effects decide exactly: their numbers and bounds are compared as data. What free texts mean to one another is
unknown until a judge, any model by configuration, has decided; without one they stand beside each other.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from gvla2.memory.admission import standing
from gvla2.memory.contracts import Judge, LessonPair
from gvla2.memory.ledger import OpenBank, deciding
from gvla2.memory.records import Record
from gvla2.memory.view import pairs_of

BATCH = 16
"""Pairs per request to a judge."""
NEAREST = 4
"""Number of records near to each that a judge compares it with."""
TypedEffect = Mapping[str, Any]
Pair = tuple[str, str]


def conflict_of(first: Record, second: Record) -> str:
    """How the typed effects of two records contradict each other, "" if they don't or there are none."""
    if not (first.effect and second.effect) or (first.skill and second.skill and first.skill != second.skill):
        return ""
    return effects_conflict(first.effect_json() or {}, second.effect_json() or {})


def effects_conflict(first: TypedEffect, second: TypedEffect) -> str:
    """How two typed effects contradict each other, "" if they don't.

    Disjoint bounds; means too far apart for their deviations (or by half, for single successes without any); a
    parameter both forbidden and successful. Two programs never do: there are many ways to succeed.
    """
    kinds = (first.get("kind"), second.get("kind"))
    if "program" in kinds or not _same_parameter(first, second):
        return ""
    name = str(first.get("parameter"))
    if "forbid" in kinds:
        return f"{name} is forbidden and succeeded" if "prior" in kinds else ""
    try:
        a, b = float(first.get("value", math.nan)), float(second.get("value", math.nan))
        deviations = [float(effect.get("sd", 0.0)) for effect in (first, second)]
        counts = [max(int(effect.get("count", 1)), 1) for effect in (first, second)]
    except (TypeError, ValueError, OverflowError):
        return ""
    if not all(map(math.isfinite, (a, b, *deviations))):
        return ""
    scale = max(abs(a), abs(b))
    if kinds == ("bound", "bound"):
        ops = (first.get("op", ">="), second.get("op", ">="))
        low, high = (a, b) if ops[0] == ">=" else (b, a)
        if set(ops) == {">=", "<="} and low - high > 1e-9 * scale:
            return f"{name} at least {low:.4g} against at most {high:.4g}"
    if kinds == ("prior", "prior"):
        squares = sum((n - 1) * sd**2 for n, sd in zip(counts, deviations, strict=True))
        pooled = math.sqrt(squares / max(sum(counts) - 2, 1))
        if abs(a - b) > max(3.0 * pooled, (0.5 if min(counts) < 3 else 0.25) * scale):
            return f"{name} {a:.4g} against {b:.4g}"
    return ""


def _same_parameter(first: TypedEffect, second: TypedEffect) -> bool:
    """Whether both are about one parameter of one skill and object, if given; metres and shares of a side are not
    comparable.
    """
    if any(str(first.get(name) or "") != str(second.get(name) or "") for name in ("parameter", "scale")):
        return False
    given = [(first.get(name), second.get(name)) for name in ("skill", "object")]
    return all(not mine or not theirs or mine == theirs for mine, theirs in given)


@dataclass
class Judged:
    """The result of judging: pairs of ids by decision, ids of the archived ones, and why pairs were left open."""

    conflicts: list[Pair] = field(default_factory=list)
    dismissed: list[Pair] = field(default_factory=list)
    archived: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)


def judge(
    bank: OpenBank, judge: Judge, *, about: Collection[str] | None = None, limit: int | None = None
) -> Judged:
    """Let the judge decide at most ``limit`` pairs of similar lessons in words, with a record in ``about`` if given.

    The judge works outside any transaction. Of two of one type that contradict each other the less trusted is archived,
    of equally trusted ones the one with less evidence; a hint and a constraint both stay, linked.
    """
    done = Judged()
    bank.index.refresh()
    pairs = list(islice(_undecided(bank, about), limit))
    for start in range(0, len(pairs), BATCH):
        batch = pairs[start : start + BATCH]
        shown = [LessonPair(a.content, b.content, a.query, b.query) for a, b in batch]
        answers = list(zip(batch, judge.judge(shown), strict=True))
        done.open += [answer.reason for _, answer in answers if answer.contradicts is None]
        decided = [(pair, answer) for pair, answer in answers if answer.contradicts is not None]
        if not decided:
            continue
        with deciding(bank, "judge") as ledger:
            for pair, answer in decided:
                first, second = (ledger.transaction.get(record.id) for record in pair)
                if first is None or second is None or {first.state, second.state} != {"active"}:
                    continue  # changed meanwhile
                why = f"{answer.judge}: {answer.reason} (p = {answer.probability:.2f})"
                kind = "conflict" if answer.contradicts else "dismissed"
                ledger.transaction.link(first.id, kind, second.id, why)
                (done.conflicts if answer.contradicts else done.dismissed).append((first.id, second.id))
                if answer.contradicts and first.type == second.type:
                    winner, loser = sorted((first, second), key=standing)
                    ledger.archive(loser, "JUDGED", f"contradicted by {winner.id}")
                    done.archived.append(loser.id)
    return done


def _undecided(bank: OpenBank, about: Collection[str] | None) -> Iterable[tuple[Record, Record]]:
    """Similar lessons in words that no judge has decided on, the latest first."""
    with bank.store.reading(bank.bank) as view:
        linked = pairs_of(view.links())
    seen = linked["conflict"] | linked["dismissed"]
    records = [record for record in bank.index.records("active") if not record.effect]
    for record in sorted(records, key=lambda r: (-r.updated, r.id)):
        held = bank.index.get(record.id)
        if held is None or (about is not None and record.id not in about):
            continue
        for other, cosine in bank.index.nearest(held.vector, NEAREST + 1):
            pair = (min(record.id, other.id), max(record.id, other.id))
            if other.id == record.id or other.effect or pair in seen or cosine < bank.options.match:
                continue
            if record.skill and other.skill and record.skill != other.skill:
                continue
            seen.add(pair)
            yield record, other
