"""A verified candidate against what the bank knows: ADD, MERGE, REPLACE or DISCARD. A decision on plain data.

The thresholds are the released ones. What the released code got wrong is refused here: hints about different skills,
objects or parameters are never one, whatever their spelling; a constraint and a hint never merge; and evidence
weighs by how often it was confirmed, so that one episode does not overthrow what many have shown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, Literal, NamedTuple

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.curation.likeness import (
    about,
    jaccard,
    likeness,
    overlap,
    same_subject,
    surface,
    words_of,
)
from gvla2.memory.meaning.conflicts import Conflict, Said, conflict
from gvla2.memory.records import Record

Action = Literal["ADD", "MERGE", "REPLACE", "DISCARD"]


@dataclass(frozen=True)
class Edit:
    """What to do with a candidate, about which ``target``, and ``why``; ``scores`` led to it.

    REPLACE archives the target, and DISCARD after a conflict archives the candidate. ``conflicts`` are all records
    that contradict it, the target among them, with the reason.
    """

    action: Action
    target: str = ""
    why: str = ""
    scores: Mapping[str, float] = field(default_factory=dict)
    conflicts: tuple[tuple[str, str], ...] = ()


def consolidate(
    candidate: Record, rivals: Sequence[tuple[Record, float]], options: BankOptions | None = None
) -> Edit:
    """Decide on a candidate; ``rivals`` are served records with their cosine to it, the nearest first.

    Each is asked whether it contradicts the candidate, sentence by sentence. It may be one with the candidate from a
    relevance of ``options.match`` on, or when it has the same dedup key.
    """
    options = options or BankOptions()
    words, mine = words_of(candidate.content), _said(candidate)
    near: list[_Near] = []
    against: list[tuple[Record, Conflict]] = []
    for rival, cosine in sorted(rivals, key=lambda entry: (-entry[1], entry[0].id)):
        if rival.id == candidate.id:
            continue
        # One sentence of a long lesson contradicts another, however little the texts have in common as a whole.
        found = conflict(mine, _said(rival))
        if found:
            against.append((rival, found))
            continue
        same = rival.dedup_key == candidate.dedup_key
        if cosine >= options.match or same or likeness(candidate, rival).match >= options.match:
            content, _ = overlap(words, words_of(rival.content))
            near.append(_Near(-content, rival.id, rival, cosine, same))
    if against:
        return _settle(candidate, against)
    for _, id, rival, cosine, same in sorted(near, key=itemgetter(0, 1)):
        if same:
            return Edit("MERGE", id, "it says the same", _scores(candidate, rival, cosine))
        if same_subject(candidate, rival):
            aligned = surface(candidate.content, rival.content)
            concepts = jaccard(about(candidate.content).items, about(rival.content).items)
            scores = {**_scores(candidate, rival, cosine), "surface": aligned, "concepts": concepts}
            if aligned >= options.discard:
                return Edit("DISCARD", id, "it says the same in almost the same words", scores)
            if aligned >= options.merge_surface or concepts >= options.merge_signature:
                return Edit("MERGE", id, "it says the same in other words", scores)
    if not near:
        return Edit("ADD", why="nothing in the bank is like it")
    _, id, best, cosine, _ = near[0]
    return Edit("ADD", id, "the nearest record is about something else", _scores(candidate, best, cosine))


class _Near(NamedTuple):
    """A rival that counts; ``content`` is less than nothing, so that the likest sorts first."""

    content: float
    id: str
    record: Record
    cosine: float
    same_key: bool


def _scores(candidate: Record, rival: Record, cosine: float) -> dict[str, float]:
    return {**likeness(candidate, rival).scores(), "cosine": cosine}


def conflict_of(first: Record, second: Record) -> Conflict | None:
    """How two records contradict each other."""
    return conflict(_said(first), _said(second))


def evidence(record: Record) -> float:
    """How much speaks for a record: its quality (of a constraint: of its failure) times the episodes behind it."""
    return support(record) * max(record.count, 1)


def support(record: Record) -> float:
    """Quality R of what a record says, in [0, 1]: a constraint is the better, the worse its episode went."""
    failed = record.outcome == "verified_fail" and record.type == "failure_avoidance"
    return 1.0 - record.quality if failed else record.quality


def stronger(first: Record, second: Record) -> bool:
    """Whether the first record prevails over the second: more evidence, then later evidence, then the smaller id."""
    one, two = round(evidence(first), 6), round(evidence(second), 6)
    if one != two:
        return one > two
    return (first.updated, second.id) > (second.updated, first.id)


def _settle(candidate: Record, against: Sequence[tuple[Record, Conflict]]) -> Edit:
    """Contradictions within a type are decided by evidence; between a hint and a constraint both stay, linked."""
    listed = tuple((rival.id, found.why) for rival, found in against)
    rivals = [entry for entry in against if entry[0].type == candidate.type]
    if not rivals:
        rival, found = against[0]
        scores = likeness(candidate, rival).scores()
        return Edit("ADD", rival.id, f"it contradicts {rival.id} ({found.why})", scores, listed)
    strongest, found = rivals[0]
    for rival, other in rivals[1:]:
        if stronger(rival, strongest):
            strongest, found = rival, other
    scores = likeness(candidate, strongest).scores()
    scores |= {"evidence": evidence(candidate), "evidence_against": evidence(strongest)}
    prevails = round(evidence(candidate), 6) >= round(evidence(strongest), 6)
    word = "outweighs" if prevails else "is outweighed by"
    why = f"it contradicts and {word} {strongest.id} ({found.kind}: {found.why})"
    return Edit("REPLACE" if prevails else "DISCARD", strongest.id, why, scores, listed)


def _said(record: Record) -> Said:
    effect: Mapping[str, Any] | None = record.effect_json() if record.effect else None
    return Said(record.record_type, record.content, record.skill, effect, record.query)
