"""Train the head of :mod:`gvla2.memory.meaning.suspicion`:
``python tests/benchmarks/memory/train_suspicion.py [--write]``.

Trained on examiners 1 and 2, the pairs written by hand, generated ones and ``data/suspicion_pairs.txt``, English
ones alone. From the threshold on a share of ``FALSE`` of the pairs that agree are suspected by a head trained on the
other writers' pairs: a bank meets writers that nobody trained on. Examiners 3 and 4 are measured.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from contradiction_pairs import pairs
from examination_entries import entries
from generated_contradictions import generated
from numpy.typing import NDArray

from gvla2.memory.meaning import suspicion
from gvla2.memory.meaning.english import is_english
from gvla2.memory.meaning.suspicion import FEATURES, SIGNS, candidates

FALSE = 0.03
RIDGE = 1.0
GENERATED, GENERATED_WEIGHT = 200, 0.2
WEIGHTS = Path(suspicion.__file__).with_name("suspicion_weights.json")
_START = {"like": 2.0, "contained": 1.0, "same_task": 1.0}
"""Where the search begins, and with it which way of contradicting counts in each pair."""


class Pair(NamedTuple):
    """Two texts with their tasks, whether they contradict each other, and how much the pair weighs."""

    first: str
    second: str
    tasks: tuple[str, str]
    conflict: bool
    writer: str
    weight: float = 1.0


Ways = list[NDArray[np.float64]]


def examined(examiner: int) -> list[Pair]:
    """The English pairs of an examiner."""
    found = [
        Pair(
            entry.texts[0],
            entry.texts[1],
            (entry.tasks[0], entry.tasks[1]),
            kind == "contradiction",
            f"examiner {examiner}",
        )
        for kind in ("contradiction", "other")
        for entry in entries(kind, examiner)  # type: ignore[arg-type]
    ]
    return [pair for pair in found if is_english(pair.first) and is_english(pair.second)]


def training() -> list[Pair]:
    """All pairs to train on."""
    found = examined(1) + examined(2)
    found += [Pair(p.first, p.second, ("", ""), p.conflict, "by hand") for p in pairs()]
    found += [
        Pair(a, b, ("", ""), real, "generated", GENERATED_WEIGHT) for a, b, real in generated(3, GENERATED)
    ]
    for line in (
        Path(__file__).with_name("data").joinpath("suspicion_pairs.txt").read_text("utf-8").splitlines()
    ):
        if line[:1] in "!=" and line:
            tasks, first, second = (part.strip() for part in line[1:].split("|"))
            one, _, two = (part.strip() for part in tasks.partition(";"))
            found.append(Pair(first, second, (one, two or one), line[0] == "!", "freely worded"))
    return [pair for pair in found if is_english(pair.first) and is_english(pair.second)]


def ways_of(found: Sequence[Pair]) -> Ways:
    """(K, F) for each pair."""
    return [candidates(pair.first, pair.second, *pair.tasks) for pair in found]


def fit(ways: Ways, real: NDArray[np.float64], weight: NDArray[np.float64]) -> NDArray[np.float64]:
    """(F + 1,) weights and bias: by turns the strongest way of each pair, and Newton's method on those."""
    head = np.array([*(_START.get(name, 1.0 if name in SIGNS else 0.0) for name in FEATURES), -3.0])
    some = [i for i, way in enumerate(ways) if len(way)]
    ridge = np.diag([*np.full(len(FEATURES), RIDGE), 1e-6])
    y, w = real[some], weight[some]
    for _ in range(6):
        best = np.array([[*ways[i][(ways[i] @ head[:-1]).argmax()], 1.0] for i in some])
        for _ in range(30):
            p = 1 / (1 + np.exp(-best @ head))
            curvature = best.T * (w * p * (1 - p) + 1e-9) @ best + ridge
            head = head + np.linalg.solve(curvature, best.T @ (w * (y - p)) - ridge @ head)
    return head


def judged(head: NDArray[np.float64], ways: Ways) -> NDArray[np.float64]:
    """(N,) the suspicion of each pair."""
    return np.array(
        [1 / (1 + np.exp(-(way @ head[:-1]).max() - head[-1])) if len(way) else 0.0 for way in ways]
    )


def main() -> None:
    """Train, pick the threshold, measure examiners 3 and 4."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="keep the weights")
    write = parser.parse_args().write
    known = training()
    ways, real = ways_of(known), np.array([float(pair.conflict) for pair in known])
    weight = np.array([pair.weight for pair in known])
    writers = np.array([pair.writer for pair in known])
    apart = np.zeros(len(known))
    for writer in sorted({pair.writer for pair in known}):
        rest = np.flatnonzero(writers != writer)
        head = fit([ways[j] for j in rest], real[rest], weight[rest])
        apart[writers == writer] = judged(head, [ways[j] for j in np.flatnonzero(writers == writer)])
    counted = weight == 1.0
    agreeing = np.sort(apart[counted & (real == 0)])[::-1]
    limit = round(float(agreeing[int(FALSE * len(agreeing))]), 3)
    found = (apart[counted & (real == 1)] > limit).mean()
    false = (apart[counted & (real == 0)] >= limit).mean()
    print(f"{len(known)} pairs; of writers unseen {found:.1%} found, {false:.1%} false, from {limit} on")
    head = fit(ways, real, weight)
    for examiner in (3, 4):
        asked = examined(examiner)
        p, y = judged(head, ways_of(asked)), np.array([pair.conflict for pair in asked])
        print(
            f"examiner {examiner}: {y.sum()} contradictions, {100 * (p[y] >= limit).mean():.1f} % found; "
            f"{(~y).sum()} others, {100 * (p[~y] >= limit).mean():.1f} % false"
        )
    if write:
        table = {name: round(float(value), 4) for name, value in zip(FEATURES, head, strict=False)}
        kept = {"threshold": limit, "bias": round(float(head[-1]), 4), "weights": table}
        WEIGHTS.write_text(json.dumps(kept, indent=1) + "\n", "utf-8")


if __name__ == "__main__":
    main()
