"""Many successes as one text that keeps their numbers and says when each applied.

By rule: texts that are equal except for their numbers become one line, each number with the tasks it was right for. No
number is left out: what does not fit stays a record of its own. The wordings are kept with the summary, so that it can
grow one success at a time.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from textwrap import shorten

from gvla2.memory.curation.evidence import MAX_SOURCES, phrasings, support
from gvla2.memory.curation.trust import least
from gvla2.memory.meaning.terms import terms
from gvla2.memory.records import Record, dedup_key, dump, load_object, record_id

LINES = 6
"""Most wordings in a summary."""
LENGTH = 500
"""Most characters of a summary, and of a text in it: longer ones stay apart. A recall shows that many of a record."""
_TASKS, _TASK = 3, 60
"""Most tasks that are kept with a number, and most characters of each."""
_NUMBER = re.compile(r"[-+]?\d+(?:[.,]\d+)*")
_GAP = "\x00"


@dataclass
class Wording:
    """Texts that are equal except for their numbers: the text with gaps, how many episodes said it, and each gap's
    values with the tasks that they were right for.
    """

    text: str
    count: int
    gaps: list[dict[str, list[str]]]

    @property
    def key(self) -> str:
        """Equal for equal wordings."""
        return self.text.casefold().rstrip(".! ")

    def take_in(self, other: Wording) -> None:
        """Add one more of the same wording."""
        self.count += other.count
        for mine, theirs in zip(self.gaps, other.gaps, strict=False):
            for value, tasks in theirs.items():
                known = mine.setdefault(value, [])
                known += [task for task in tasks if task not in known][: max(0, _TASKS - len(known))]

    def told(self) -> str:
        """The text with its numbers filled in."""
        said, *parts = self.text.split(_GAP)
        return said + "".join(_filled(gap) + part for gap, part in zip(self.gaps, parts, strict=False))


def _filled(gap: Mapping[str, Sequence[str]]) -> str:
    """All values of a number; those that were right for the same tasks stand together."""
    if len(gap) == 1:
        return next(iter(gap))
    said: dict[str, list[str]] = {}
    for value in sorted(gap, key=_size):
        said.setdefault("; ".join(gap[value]) or "once", []).append(value)
    return " or ".join(f"{', '.join(values)} ({tasks})" for tasks, values in said.items())


def _size(value: str) -> tuple[float, str]:
    try:
        return float(value.replace(",", ".")), value
    except ValueError:
        return float("inf"), value


def wordings_of(record: Record) -> list[Wording]:
    """A record's or summary's wordings; the caller owns them."""
    if record.state == "summary" and (kept := load_object(record.provenance).get("told")):
        return [Wording(**one) for one in kept]
    content = " ".join(record.content.split())
    tasks = [shorten(line, _TASK, placeholder=" …") for line in record.query.split("\n")[:1] if line]
    gaps = [{value: list(tasks)} for value in _NUMBER.findall(content)]
    return [Wording(_NUMBER.sub(_GAP, content), record.count, gaps)]


@lru_cache(maxsize=16384)
def _seen(record: Record) -> tuple[frozenset[str], tuple[frozenset[str], ...]]:
    """The keys and the terms of a record's wordings."""
    told = wordings_of(record)
    return frozenset(one.key for one in told), tuple(terms(one.told()) for one in told)


def alike_but_for_numbers(first: Record, second: Record) -> bool:
    """Whether two records or summaries share a wording."""
    if (first.type, first.skill) != (second.type, second.skill):
        return False
    return not _seen(first)[0].isdisjoint(_seen(second)[0])


def shared_terms(first: Record, second: Record) -> float:
    """The share of terms that two records have in common (for a summary, its most similar wording)."""
    return max(len(a & b) / max(len(a | b), 1) for a in _seen(first)[1] for b in _seen(second)[1])


def tasks_of(group: Iterable[Record]) -> list[str]:
    """The distinct instructions that a group comes from."""
    return sorted({line for record in group for line in record.query.casefold().split("\n") if line})


def fitting(group: Sequence[Record]) -> list[Record]:
    """The first of a group, and those of the others with which a summary by rule shows each of their numbers."""
    short = [one for one in group if one.state == "summary" or len(one.content) <= LENGTH]
    shown = list(group[:1])
    for record in short[1:] if short[:1] == shown else ():
        told = [one.told() for one in _merged([*shown, record]) if one.gaps]
        if len(told) <= LINES and len(" / ".join(told)) <= LENGTH:
            shown.append(record)
    return shown


def _merged(group: Iterable[Record]) -> list[Wording]:
    """The wordings of a group, each once: those with numbers first, then by how many episodes said them."""
    told: dict[str, Wording] = {}
    for record in group:
        for wording in wordings_of(record):
            if (known := told.setdefault(wording.key, wording)) is not wording:
                known.take_in(wording)
    return sorted(told.values(), key=lambda wording: (not wording.gaps, -wording.count))


def summary_of(group: Sequence[Record], now: float, text: str = "", about: str = "") -> Record:
    """The summary of a group of records, which may include an older summary; of version 0 if it is new.

    ``text`` is a given wording, "" to write by rule; ``about`` tells it from another of the same words. It is trusted
    no more than the least trusted of the group.
    """
    old = next((record for record in group if record.state == "summary"), None)
    best = old or max(group, key=lambda r: (support(r), r.count, r.id))
    ordered = [best, *(r for r in group if r is not best)]
    query, sources = "", list[str]()
    for record in ordered:
        query = phrasings(query, record.query) if query else record.query
        sources += [source for source in record.sources() if source not in sources]
    most = _merged(ordered)[:LINES]
    count = sum(record.count for record in group)
    quality = sum(record.quality * record.count for record in group) / count
    name = max(most, key=lambda wording: wording.count).key + about
    key = old.dedup_key if old else dedup_key(best.type, f"summary of {name}", best.skill, None)
    made_by, kept = {"governance": "summary"}, [vars(one) for one in most]
    provenance = {"made_by": made_by, "sources": sources[-MAX_SOURCES:], "told": kept}
    return replace(
        best,
        id=old.id if old else record_id("summary", best.bank, key),
        state="summary",
        query=query,
        content=text or _rendered(most, count),
        dedup_key=key,
        quality=quality,
        confidence=min(max(r.confidence for r in group), 2 * abs(quality - 0.5)),
        count=count,
        usage=sum(r.usage for r in group),
        recalled=sum(r.recalled for r in group),
        used=max(r.used for r in group),
        provenance=dump(provenance),
        note=f"sums up {count} episodes",
        trust=least(record.trust for record in group),
        created=old.created if old else now,
        updated=max(r.updated for r in group),
        version=old.version if old else 0,
        rev=old.rev if old else 0,
    )


def _rendered(wordings: Sequence[Wording], count: int) -> str:
    lines: list[str] = []
    for wording in wordings:
        line = wording.told()
        if not lines or sum(map(len, lines)) + len(line) <= LENGTH:
            lines.append(line)
    return f"Worked {count} times: " + " / ".join(lines)


def numbers_in(text: str) -> set[str]:
    """The numbers of a text, in one spelling."""
    return {value.replace(",", ".").lstrip("+") for value in _NUMBER.findall(text)}
