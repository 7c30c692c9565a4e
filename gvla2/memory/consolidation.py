"""A verified candidate against what the bank knows: ADD, MERGE, REPLACE or DISCARD. A decision on plain data.

The thresholds are the released ones. What the released code got wrong is refused here: hints about different skills,
objects or parameters are never one, whatever their spelling; a constraint and a hint never merge; and evidence
weighs by how often it was confirmed, so that one episode does not overthrow what many have shown.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.conflicts import Conflict, Said, conflict
from gvla2.memory.likeness import Likeness, likeness, same_subject, surface
from gvla2.memory.records import Record

Action = Literal["ADD", "MERGE", "REPLACE", "DISCARD"]


_CLOSE = 0.8
"""The cosine from which texts are compared whatever their words."""


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

    A rival counts from a relevance of ``options.match`` on, or when it has the candidate's dedup key.
    """
    options = options or BankOptions()
    near = [
        (rival, likeness(candidate, rival), cosine)
        for rival, cosine in sorted(rivals, key=lambda entry: (-entry[1], entry[0].id))
        if rival.id != candidate.id
    ]
    near = [
        entry
        for entry in near
        if entry[0].dedup_key == candidate.dedup_key or max(entry[1].match, entry[2]) >= options.match
    ]
    mine = _said(candidate)
    against = [
        (rival, like, found)
        for rival, like, cosine in near
        if (like.comparable or cosine >= _CLOSE or (candidate.effect and rival.effect))
        and (found := conflict(mine, _said(rival)))
    ]
    if against:
        return _settle(candidate, against)
    for rival, like, cosine in sorted(near, key=lambda entry: (-entry[1].content, entry[0].id)):
        scores = {**like.scores(), "cosine": cosine}
        if rival.dedup_key == candidate.dedup_key:
            return Edit("MERGE", rival.id, "it says the same", scores)
        if like.comparable and same_subject(candidate, rival):
            scores["surface"] = aligned = surface(candidate.content, rival.content)
            if aligned >= options.discard:
                return Edit("DISCARD", rival.id, "it says the same in almost the same words", scores)
            if aligned >= options.merge_surface or like.content >= options.merge_signature:
                return Edit("MERGE", rival.id, "it says the same in other words", scores)
    if not near:
        return Edit("ADD", why="nothing in the bank is like it")
    best, like, cosine = near[0]
    return Edit(
        "ADD", best.id, "the nearest record is about something else", {**like.scores(), "cosine": cosine}
    )


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


def _settle(candidate: Record, against: Sequence[tuple[Record, Likeness, Conflict]]) -> Edit:
    """Contradictions within a type are decided by evidence; between a hint and a constraint both stay, linked."""
    listed = tuple((rival.id, found.why) for rival, _, found in against)
    rivals = [entry for entry in against if entry[0].type == candidate.type]
    if not rivals:
        rival, like, found = against[0]
        return Edit("ADD", rival.id, f"it contradicts {rival.id} ({found.why})", like.scores(), listed)
    strongest, like, found = rivals[0]
    for rival, other, kind in rivals[1:]:
        if stronger(rival, strongest):
            strongest, like, found = rival, other, kind
    scores = {**like.scores(), "evidence": evidence(candidate), "evidence_against": evidence(strongest)}
    prevails = round(evidence(candidate), 6) >= round(evidence(strongest), 6)
    word = "outweighs" if prevails else "is outweighed by"
    why = f"it contradicts and {word} {strongest.id} ({found.kind}: {found.why})"
    return Edit("REPLACE" if prevails else "DISCARD", strongest.id, why, scores, listed)


def _said(record: Record) -> Said:
    effect: Mapping[str, Any] | None = record.effect_json() if record.effect else None
    return Said(record.record_type, record.content, record.skill, effect)
