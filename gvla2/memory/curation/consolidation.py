"""A verified candidate against what the bank knows: ADD, MERGE, REPLACE or DISCARD. A decision on plain data.

Typed effects that contradict each other are decided here, by evidence. Texts are merged where they say the same; where
one may contradict another both stay, linked, until a judge has decided. A constraint and a hint never merge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.curation.contesting import SUSPECT, Compared, compare, same_lesson
from gvla2.memory.curation.evidence import evidence
from gvla2.memory.curation.judging import prevails
from gvla2.memory.curation.summaries import alike_but_for_numbers
from gvla2.memory.curation.trust import LEVELS
from gvla2.memory.records import Record

Action = Literal["ADD", "MERGE", "REPLACE", "DISCARD"]


@dataclass(frozen=True)
class Edit:
    """What to do with a candidate, about which ``target``, and ``why``; ``cosine`` is that of the target.

    REPLACE archives those of ``conflicts`` that are of its type, DISCARD after a conflict the candidate. ``conflicts``
    and ``suspected`` are ids of records that contradict it, or may, each with the reason.
    """

    action: Action
    target: str = ""
    why: str = ""
    cosine: float = 0.0
    conflicts: tuple[tuple[str, str], ...] = ()
    suspected: tuple[tuple[str, str], ...] = ()


def consolidate(
    candidate: Record, rivals: Sequence[tuple[Record, float]], options: BankOptions | None = None
) -> Edit:
    """Decide on a candidate; ``rivals`` are served records with their cosine to it.

    Each is asked whether it contradicts the candidate; it may be one with the candidate from a cosine of
    ``options.match`` on, or when it has the same dedup key.
    """
    options = options or BankOptions()
    against: list[tuple[Record, str]] = []
    suspected: list[tuple[str, str]] = []
    same: list[tuple[Record, float]] = []
    for rival, cosine in sorted(rivals, key=lambda entry: (-entry[1], entry[0].id)):
        if rival.id == candidate.id or (rival.state == "summary" and alike_but_for_numbers(candidate, rival)):
            continue  # the summary will take it in, its numbers beside the others
        both = bool(candidate.effect and rival.effect)
        one = rival.state == "active" and (
            rival.dedup_key == candidate.dedup_key
            or (cosine >= options.match and same_lesson(candidate, rival))
        )
        found = Compared() if one and not both else compare(candidate, rival)
        if found.effect:
            against.append((rival, found.effect))
        elif one:
            same.append((rival, cosine))
        elif found.suspicion is not None and found.suspicion >= SUSPECT:
            suspected.append((rival.id, f"suspected by {found.suspicion:.2f}"))
    doubts = tuple(suspected)
    if against:
        return _settled(candidate, against, doubts)
    if same:
        target, cosine = same[0]
        return Edit("MERGE", target.id, "it says the same", cosine, suspected=doubts)
    if suspected:
        return Edit("ADD", doubts[0][0], "what it may contradict stays as well", suspected=doubts)
    return Edit("ADD", why="nothing in the bank says the same")


def _settled(
    candidate: Record, against: Sequence[tuple[Record, str]], doubts: tuple[tuple[str, str], ...]
) -> Edit:
    """Contradicting effects within a type are decided by evidence; between a hint and a constraint both stay."""
    listed = tuple((rival.id, why) for rival, why in against)
    rivals = [rival for rival, _ in against if rival.type == candidate.type]
    if not rivals:
        return Edit("ADD", listed[0][0], f"it contradicts {listed[0][0]}", 0.0, listed, doubts)
    strongest = rivals[0]
    for rival in rivals[1:]:
        strongest = rival if prevails(rival, strongest) else strongest
    # Of two that weigh the same, the later one.
    wins = not prevails(strongest, candidate) or _weight(strongest) == _weight(candidate)
    word = "outweighs" if wins else "is outweighed by"
    why = f"it contradicts and {word} {strongest.id}"
    return Edit("REPLACE" if wins else "DISCARD", strongest.id, why, 0.0, listed, doubts)


def _weight(record: Record) -> tuple[int, float]:
    return LEVELS.index(record.trust), evidence(record)
