"""Which episodes are worth a film: pairs that differ between memory off and an arm, then failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gvla2.commands.bench_design import Planned

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell

COMPARED = "off"
"""The arm that the others are compared with."""


def worth_filming(plan: Sequence[Planned], cells: Mapping[str, Cell], videos: int) -> list[Planned]:
    """Episodes of a plan to look at, ``videos`` for each row and arm at most.

    Where an arm and memory off ended differently on one layout both are shown; what is left shows failures.
    """
    if videos < 1:
        return []
    at = {(one.task, one.arm, one.layout): one for one in plan}
    chosen: list[Planned] = []
    taken: Counter[tuple[str, str]] = Counter()

    def take(one: Planned) -> None:
        if one not in chosen:
            chosen.append(one)
            taken[one.task, one.arm] += 1

    for one in plan:
        other = at.get((one.task, COMPARED, one.layout))
        if other is None or other is one or taken[one.task, one.arm] >= videos:
            continue
        ended, without = _success(cells, one), _success(cells, other)
        if None not in (ended, without) and ended != without:
            take(one)
            if taken[other.task, other.arm] < videos or other in chosen:
                take(other)
    for one in plan:
        if _success(cells, one) is False and taken[one.task, one.arm] < videos:
            take(one)
    return chosen


def _success(cells: Mapping[str, Cell], one: Planned) -> bool | None:
    success = cells[one.keys["eased"]].measures["success"]
    return None if success is None else bool(success)
