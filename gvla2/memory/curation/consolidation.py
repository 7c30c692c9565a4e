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
from gvla2.memory.curation.evidence import standing
from gvla2.memory.curation.summaries import alike_but_for_numbers
from gvla2.memory.records import Record

Action = Literal["ADD", "MERGE", "REPLACE", "DISCARD"]


@dataclass(frozen=True)
class Edit:
    """What to do with a candidate, about which ``target``, and ``why``.

    REPLACE archives those of ``conflicts`` that are of its type, DISCARD after a conflict the candidate. ``conflicts``
    and ``suspected`` are ids of records that contradict it, or may, each with the reason.
    """

    action: Action
    target: str = ""
    why: str = ""
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
    same: list[Record] = []
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
            same.append(rival)
        elif found.suspicion is not None and found.suspicion >= SUSPECT:
            suspected.append((rival.id, f"suspected by {found.suspicion:.2f}"))
    doubts = tuple(suspected)
    if against:
        return _settled(candidate, against, doubts)
    if same:
        return Edit("MERGE", same[0].id, "it says the same", suspected=doubts)
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
        return Edit("ADD", listed[0][0], f"it contradicts {listed[0][0]}", listed, doubts)
    strongest = min(rivals, key=standing)
    wins = standing(candidate)[:2] <= standing(strongest)[:2]  # of two that weigh the same, the later one
    word = "outweighs" if wins else "is outweighed by"
    why = f"it contradicts and {word} {strongest.id}"
    return Edit("REPLACE" if wins else "DISCARD", strongest.id, why, listed, doubts)
