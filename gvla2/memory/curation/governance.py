"""What a bank keeps: which failures retire, which of two contradicting records prevails, what is summed up, and what
goes when there is too much. Decisions on plain data; nothing is ever deleted here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.curation.consolidation import conflict_of, stronger, support
from gvla2.memory.curation.growth import phrasings
from gvla2.memory.curation.likeness import jaccard, words_of
from gvla2.memory.curation.merging import merge_signatures
from gvla2.memory.curation.resemblance import resembling
from gvla2.memory.meaning.conflicts import Conflict
from gvla2.memory.meaning.lexicon import CONCEPTS, NEGATORS, POLES
from gvla2.memory.records import Record, dedup_key, dump, record_id

SECONDS_PER_DAY = 86400.0
SUMMARY_LINES = 6
SUMMARY_LENGTH = 1600
"""Lines and characters that a summary tells."""


def retention(records: Sequence[Record], now: float) -> NDArray[np.float64]:
    """(N,) how much each record deserves to stay, by the released terms: R + kappa, +.5 for a verified lesson and
    -.3 otherwise, .1 a credited use up to .5, and up to .25 for recency (lost over 90 days).

    R of a constraint is how surely its episode failed (:func:`gvla2.memory.curation.consolidation.support`).
    """
    verified = np.array([is_verified(record) for record in records], np.bool_)
    ages = np.array([max(now - last_seen(record), 0.0) / SECONDS_PER_DAY for record in records])
    return np.asarray(
        np.array([support(record) + record.confidence for record in records])
        + np.where(verified, 0.5, -0.3)
        + np.minimum(0.1 * np.array([record.usage for record in records], np.float64), 0.5)
        + np.maximum(0.0, 0.25 - np.minimum(ages / 90.0, 0.25))
    )


def is_verified(record: Record) -> bool:
    """Whether a verdict stands behind what the record says."""
    failed = record.outcome == "verified_fail" and record.type == "failure_avoidance"
    return record.outcome == "verified_success" or failed


def last_seen(record: Record) -> float:
    """When there was last something new about a record, seconds since the epoch."""
    return max(record.updated, record.used)


def retired(records: Iterable[Record], now: float, options: BankOptions) -> list[Record]:
    """Failures that nobody used for ``retire_days``, summaries aside."""
    limit = options.retire_days * SECONDS_PER_DAY
    return [
        record
        for record in records
        if record.outcome != "verified_success"
        and record.usage == 0
        and record.state == "active"
        and now - last_seen(record) >= limit
    ]


def overflow(records: Sequence[Record], now: float, budget: int) -> list[Record]:
    """The records beyond the budget, those of the least retention first, equal ones by age and id."""
    excess = len(records) - max(budget, 0)
    if excess <= 0:
        return []
    scores = retention(records, now)
    order = sorted(range(len(records)), key=lambda i: (scores[i], records[i].updated, records[i].id))
    return [records[i] for i in order[:excess]]


@dataclass(frozen=True)
class Resolved:
    """Two records that contradict each other, and which of them stays."""

    winner: Record
    loser: Record
    conflict: Conflict


def words_by_id(records: Iterable[Record]) -> dict[str, frozenset[str]]:
    """The topic words of contents, for a pass over so many records that nothing else keeps them."""
    return {record.id: words_of(record.content) for record in records}


def contradictions(
    records: Sequence[Record], words: Mapping[str, frozenset[str]] | None = None
) -> list[Resolved]:
    """Contradictions within one type among many records, each loser once; ``words`` as of :func:`words_by_id`.

    Records are compared where they are about the same parameter, or have the same words but for numbers, opposites
    and negations; what differs in more than that was compared when it was admitted.
    """
    found, lost = [], set()
    for group in _comparable(records, words_by_id(records) if words is None else words):
        ranked = sorted(group, key=lambda record: record.id)
        for i, first in enumerate(ranked):
            for second in ranked[i + 1 :]:
                if (
                    first.id in lost
                    or second.id in lost
                    or (first.content == second.content and not first.effect)
                ):
                    continue
                conflict = conflict_of(first, second)
                if conflict is not None:
                    winner, loser = (first, second) if stronger(first, second) else (second, first)
                    lost.add(loser.id)
                    found.append(Resolved(winner, loser, conflict))
    return found


def _comparable(records: Sequence[Record], words: Mapping[str, frozenset[str]]) -> list[list[Record]]:
    groups: dict[tuple[str, ...], list[Record]] = defaultdict(list)
    telling: dict[str, bool] = {}
    for record in records:
        effect = record.effect_json() if record.effect else None
        if effect:
            key: tuple[str, ...] = (
                "",
                record.skill,
                str(effect.get("parameter")),
                str(effect.get("object", "")),
            )
        else:
            said = words[record.id]
            for word in said:
                if word not in telling:  # the difference of the two sets would look at all words ever met
                    telling[word] = _tells(word)
            key = (record.type, record.skill, *sorted([word for word in said if telling[word]]))
        groups[key].append(record)
    # A crowd that differs in nothing but numbers is cut: it would take time in its square.
    return [sorted(group, key=lambda r: r.id)[:64] for group in groups.values() if len(group) > 1]


def _tells(word: str) -> bool:
    """Whether a word says what a lesson is about, rather than how much, which way, or not."""
    if word in NEGATORS or any(c.isdigit() for c in word):
        return False
    return CONCEPTS.get(word, "") not in POLES


def clusters(
    records: Sequence[Record], options: BankOptions, words: Mapping[str, frozenset[str]] | None = None
) -> list[list[Record]]:
    """Groups of at least ``summary_size`` verified successes of two tasks or more that are alike; each record once.

    Only lessons in words are summed up: typed effects are pooled by merging, and a summary could carry only one.
    """
    usable = sorted(
        (r for r in records if r.outcome == "verified_success" and not r.effect and r.state == "active"),
        key=lambda r: r.id,
    )
    rank = {r.id: i for i, r in enumerate(sorted(usable, key=lambda r: (-support(r), -r.count, r.id)))}
    words = words_by_id(usable) if words is None else words
    near, counts = resembling(
        [words[record.id] for record in usable],
        [(record.type, record.skill) for record in usable],
        options.summary_match,
    )
    enough = np.flatnonzero(counts + 1 >= options.summary_size).tolist()
    taken: set[str] = set()
    harmony = Harmony()
    found = []
    for place in sorted(enough, key=lambda i: rank[usable[i].id]):
        if usable[place].id in taken:
            continue
        others = [usable[i] for i in near[place, : counts[place]].tolist() if usable[i].id not in taken]
        group = sorted([usable[place], *others], key=lambda r: rank[r.id])[: 2 * SUMMARY_LINES]
        if summable(group, options, harmony):
            found.append(group)
            taken |= {r.id for r in group}
    return found


def alike(first: Record, second: Record, options: BankOptions) -> bool:
    """Whether two successes may stand in one summary."""
    if (first.type, first.skill) != (second.type, second.skill):
        return False
    return jaccard(words_of(first.content), words_of(second.content)) >= options.summary_match


class Harmony:
    """Whether groups are free of contradictions. Groups of one pass overlap: what was found out of a pair is kept."""

    def __init__(self) -> None:
        self._against: dict[tuple[str, str], bool] = {}
        self._met: set[str] = set()

    def holds(self, group: Sequence[Record]) -> bool:
        """Whether no two records of the group contradict each other."""
        pairs = [(a, b) if a.id < b.id else (b, a) for a, b in combinations(group, 2)]
        if any(self._against.get((a.id, b.id)) for a, b in pairs):
            return False
        # To read a text takes longer than to compare two: those that were read before come first.
        for a, b in sorted(
            pairs, key=lambda pair: (pair[0].id not in self._met) + (pair[1].id not in self._met)
        ):
            if (a.id, b.id) not in self._against:
                self._met |= {a.id, b.id}
                self._against[a.id, b.id] = conflict_of(a, b) is not None
                if self._against[a.id, b.id]:
                    return False
        return True


def summable(group: Sequence[Record], options: BankOptions, harmony: Harmony | None = None) -> bool:
    """Whether a group is large enough and what a summary can tell of it comes from two tasks or more, without a
    contradiction in it; ``harmony`` is kept over a pass.
    """
    if len(group) < options.summary_size:
        return False
    _, held = _told(group)
    if len(held) < 2 or len(tasks_of(held)) < 2:
        return False
    return (harmony or Harmony()).holds(group)


def tasks_of(group: Sequence[Record]) -> list[str]:
    """The distinct instructions that a group comes from."""
    return sorted({line for record in group for line in record.query.casefold().split("\n") if line})


def _told(group: Sequence[Record]) -> tuple[list[str], list[Record]]:
    """The lines of a group's summary, and the members whose words they hold in full: as many as there is room for."""
    lines: list[str] = []
    held: list[Record] = []
    for record in group:
        line = " ".join(record.content.split())
        room = len(lines) < SUMMARY_LINES and sum(map(len, lines)) + len(line) <= SUMMARY_LENGTH
        if line in lines or room or not held:
            lines += [] if line in lines else [line]
            held.append(record)
    return lines, held


def summary_of(group: Sequence[Record], now: float) -> tuple[Record, list[Record]]:
    """The summary of a group, best first, and the members whose words it holds in full."""
    lines, held = _told(group)
    best = group[0]
    tasks = len(tasks_of(held))
    content = f"Worked in {tasks} tasks: " + " / ".join(lines)
    key = dedup_key(best.record_type, content, best.skill, None)
    signature: dict[str, float] = {}
    query, count, quality = "", 0, 0.0
    sources: list[str] = []
    for record in held:
        query = phrasings(query, record.query) if query else record.query
        signature = (
            merge_signatures(signature, count, record.signature_json()) if count else record.signature_json()
        )
        quality += record.quality * record.count
        count += record.count
        sources += [source for source in record.sources() if source not in sources]
    quality /= count
    record = replace(
        best,
        id="summary-" + record_id(best.record_type, best.bank, key).partition("-")[2],
        state="summary",
        query=query,
        content=content,
        dedup_key=key,
        quality=quality,
        confidence=min(max(r.confidence for r in held), 2 * abs(quality - 0.5)),
        count=count,
        usage=sum(r.usage for r in held),
        recalled=sum(r.recalled for r in held),
        used=max(r.used for r in held),
        signature=dump(signature),
        provenance=dump({"made_by": {"governance": "summary"}, "sources": sources[-32:]}),
        note=f"sums up {len(held)} records",
        created=now,
        updated=max(r.updated for r in held),
        version=0,
        rev=0,
    )
    return record, held
