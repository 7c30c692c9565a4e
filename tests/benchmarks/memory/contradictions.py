"""How many contradictions are found, and how much else is taken for one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from contradiction_pairs import pairs
from figure import Figure, FigureRow, Test
from generated_contradictions import generated
from setting import Setting

from gvla2.memory.meaning.suspicion import suspicion, threshold

Judged = Sequence[tuple[str, str, bool]]
GENERATED = 600


def rates(judge: Callable[[str, str], bool], judged: Judged) -> tuple[float, float]:
    """Per cent of contradictions found, and per cent of the other pairs taken for one."""
    found = [judge(first, second) for first, second, real in judged if real]
    false = [judge(first, second) for first, second, real in judged if not real]
    return 100 * sum(found) / max(len(found), 1), 100 * sum(false) / max(len(false), 1)


def suspected(first: str, second: str) -> bool:
    """Whether the bank suspects that two lessons contradict each other."""
    return (suspicion(first, second) or 0.0) >= threshold()


def contradictions(setting: Setting, size: int, on: str) -> Mapping[str, Figure]:
    """Hand-written pairs that the detector was not tuned to, those that it was, or generated ones."""
    if on == "generated":
        judged: Judged = generated(setting.seed + 7, size)
    else:
        judged = [
            (pair.first, pair.second, pair.conflict)
            for pair in pairs()
            if pair.held_out is (on == "hand-written, held out")
        ]
    mine = rates(suspected, judged)
    found, false = rates(setting.plain.contradict, judged)
    real = sum(fact for _, _, fact in judged)
    return {
        "contradictions_found": Figure(mine[0], setting.plain.name, found, n=real),
        "contradictions_false": Figure(mine[1], setting.plain.name, false, n=len(judged) - real),
    }


def tests() -> list[Test]:
    """The tests of this file."""
    rows = (
        FigureRow("contradictions_found", "Contradictions found", "%", "higher", 95.0, 1),
        FigureRow("contradictions_false", "Others taken for one", "%", "lower", 5.0, 1),
    )
    counts = {held: sum(pair.held_out is held for pair in pairs()) for held in (True, False)}
    return [
        Test("contradictions", rows, contradictions, size, least=least, on=on)
        for on, size, least in (
            ("hand-written, held out", counts[True], counts[True]),
            ("hand-written, tuned on", counts[False], counts[False]),
            ("generated", GENERATED, 60),
        )
    ]
