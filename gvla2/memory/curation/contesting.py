"""Whether two lessons contradict each other, or say the same.

Typed effects decide exactly. Texts give a suspicion: both stay, linked by "suspicion" and ranked lower, until a judge
has decided (:mod:`gvla2.memory.curation.judging`). A suspicion never archives anything.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import EditAction
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.summaries import alike_but_for_numbers
from gvla2.memory.meaning.english import PREPOSITIONS, is_english, word_set
from gvla2.memory.meaning.plain_text import plain_text
from gvla2.memory.meaning.quantities import quantities
from gvla2.memory.meaning.suspicion import suspicion, threshold
from gvla2.memory.meaning.terms import stem
from gvla2.memory.records import Record

SUSPECT: float = threshold()
"""The suspicion above which two records are linked."""
_FAILURE = re.compile(
    r"\b(?:fail|slip|collid|crash|stuck|missed|error|broke|did not|was not|could not)|\bdropped\b"
)
_IDLE = word_set("the a an its is are be always please just simply really ensure sure carefully properly")
_ORDERING = frozenset(
    map(stem, word_set("and then before after first next later last afterwards until once"))
)
_FRONT = frozenset(map(stem, PREPOSITIONS | word_set("before after when while if")))
"""Words whose phrase may precede, up to a comma, or follow."""
_TOKEN = re.compile(r"\w+(?:[./:-]\w+)*")
TypedEffect = Mapping[str, Any]


@dataclass(frozen=True)
class Compared:
    """How two typed effects contradict each other ("" for not), and how likely two texts do: 0 to 1, None if unknown
    (languages other than English).
    """

    effect: str = ""
    suspicion: float | None = None


def compare(first: Record, second: Record) -> Compared:
    """Compare two records; of different skills they are never compared.

    If both have typed effects only those decide. A constraint says what failed, and two failures never contradict each
    other: what failed at 5 cm may fail at 30 cm as well.
    """
    if first.skill and second.skill and first.skill != second.skill:
        return Compared(suspicion=0.0)
    mine, theirs = first.effect_json(), second.effect_json()
    if mine and theirs:
        return Compared(effects_conflict(mine, theirs), 0.0)
    both = (first, second)
    if all(one.type == "failure_avoidance" and _FAILURE.search(one.content.casefold()) for one in both):
        return Compared(suspicion=0.0)
    return Compared(suspicion=suspicion(first.content, second.content, first.query, second.query))


def same_lesson(first: Record, second: Record) -> bool:
    """Whether two records may be merged: of one type and skill, about one parameter, saying the same.

    They may differ in inflection, units and stop words. In doubt they stay apart, since a merge loses information: one
    more word may mean another object.
    """
    if first.type != second.type or first.skill != second.skill:
        return False
    mine, theirs = first.effect_json() or {}, second.effect_json() or {}
    if bool(mine) != bool(theirs) or "program" in (mine.get("kind"), theirs.get("kind")):
        return False
    alike = all(mine.get(name) == theirs.get(name) for name in ("kind", "op", "skill", "object", "region"))
    if mine and not (alike and _same_parameter(mine, theirs)):
        return False
    return first.content == second.content or _same_words(_said(first.content), _said(second.content))


def _same_words(one: tuple[str, ...], two: tuple[str, ...]) -> bool:
    """Phrases of time or place may come first or last ("in the tunnel, slow down"); otherwise the word order matters:
    "wrap it and pack it" is not "pack it and wrap it".
    """
    if len(one) != len(two) or one == two:
        return one == two and bool(one)
    return any(
        turned[i:] + turned[:i] == kept
        for turned, kept in ((one, two), (two, one))
        if turned[0] in _FRONT and _ORDERING.isdisjoint(turned[1:])
        for i in range(2, len(one))
    )


@lru_cache(maxsize=16384)
def _said(text: str) -> tuple[str, ...]:
    """The content words of a text: English ones by their stem, figures in base units."""
    plain = plain_text(text)
    parts: list[str] = []
    last = 0
    for found in quantities(plain):
        parts += _TOKEN.findall(plain[last : found.start])
        figure = found.quantity
        parts.append(f"{figure.low:.6g}~{figure.high:.6g} {figure.dimension}")
        last = found.end
    parts += _TOKEN.findall(plain[last:])
    english = is_english(text)
    return tuple(stem(part) if english else part for part in parts if part not in _IDLE)


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


@dataclass(frozen=True)
class Edit:
    """What to do with a candidate, about which ``target``, and ``why``.

    REPLACE archives the ``conflicts`` of its type; DISCARD after a conflict archives the candidate. ``conflicts`` and
    ``suspected`` are ids of records that contradict it, or may, each with the reason.
    """

    action: EditAction
    target: str = ""
    why: str = ""
    conflicts: tuple[tuple[str, str], ...] = ()
    suspected: tuple[tuple[str, str], ...] = ()


def consolidate(
    candidate: Record, rivals: Sequence[tuple[Record, float]], options: BankOptions | None = None
) -> Edit:
    """Decide on a candidate; ``rivals`` are served records with their cosine to it.

    Each is checked for contradiction; it may equal the candidate above a cosine of ``options.match``, or with the same
    dedup key.
    """
    options = options or BankOptions()
    against: list[tuple[Record, str]] = []
    suspected: list[tuple[str, str]] = []
    same: list[Record] = []
    for rival, cosine in sorted(rivals, key=lambda entry: (-entry[1], entry[0].id)):
        if rival.id == candidate.id or (rival.state == "summary" and alike_but_for_numbers(candidate, rival)):
            continue  # the summary will absorb it, its numbers beside the others
        both = bool(candidate.effect and rival.effect)
        one = rival.state == "active" and (
            rival.dedup_key == candidate.dedup_key
            or (cosine >= options.match and same_lesson(candidate, rival))
        )
        found = Compared() if one and not both else compare(candidate, rival)
        if found.effect:
            against.append((rival, found.effect))
        elif one:
            same.append(rival)
        elif found.suspicion is not None and found.suspicion >= SUSPECT:
            suspected.append((rival.id, f"suspected by {found.suspicion:.2f}"))
    doubts = tuple(suspected)
    if same and not against:
        return Edit("MERGE", same[0].id, "it says the same", suspected=doubts)
    if doubts and not against:
        return Edit("ADD", doubts[0][0], "what it may contradict stays as well", suspected=doubts)
    if not against:
        return Edit("ADD", why="nothing in the bank says the same")
    # Contradicting effects within a type are decided by evidence; between a hint and a constraint both stay.
    listed = tuple((rival.id, why) for rival, why in against)
    alike = [rival for rival, _ in against if rival.type == candidate.type]
    if not alike:
        return Edit("ADD", listed[0][0], f"it contradicts {listed[0][0]}", listed, doubts)
    strongest = min(alike, key=standing)
    wins = standing(candidate)[:2] <= standing(strongest)[:2]  # on equal weight, the later one
    word = "outweighs" if wins else "is outweighed by"
    why = f"it contradicts and {word} {strongest.id}"
    return Edit("REPLACE" if wins else "DISCARD", strongest.id, why, listed, doubts)
