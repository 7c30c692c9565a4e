"""How well the ``classical`` perceiver sees: python -m tests.benchmarks.perception [scenes] [seed].

Random table tops with known truth, perceived with clean depth and with 2 mm noise.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from gvla2.planning.scene import Scene
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.perceiver import ClassicalPerceiver
from tests.plugins.rendered_table import WORKSPACE, Truth, random_scene, render

NEAR = 0.03
"""Distance of a perceived centre from the true one below which the object is found, metres."""


@dataclass
class Tally:
    """Sums over scenes; ``centres`` are distances of the found objects, millimetres."""

    truths: int = 0
    found: int = 0
    spurious: int = 0
    colours: list[bool] = field(default_factory=list)
    centres: list[float] = field(default_factory=list)


def visible(truth: Truth) -> bool:
    """Posts of a lamp are nearly hidden by shade and base: not counted when missed."""
    return "post" not in truth.nouns


def compare(truths: list[Truth], scene: Scene, tally: Tally) -> None:
    """Match objects by the distance of their centres and sum up."""
    gaps = np.array([[np.linalg.norm(o.centre - t.centre) for o in scene.objects] for t in truths])
    rows, columns = linear_sum_assignment(gaps) if gaps.size else ((), ())
    pairs = [(r, c) for r, c in zip(rows, columns, strict=True) if gaps[r, c] < NEAR]
    tally.truths += sum(map(visible, truths))
    tally.spurious += len(scene.objects) - len(pairs)
    for r, c in pairs:
        if visible(truths[r]):
            tally.found += 1
            tally.centres.append(1000 * float(gaps[r, c]))
            if truths[r].colour:
                tally.colours.append(scene.objects[c].colour == truths[r].colour)


def score(scenes: int, seed: int, noise: float) -> Tally:
    """Perceive random scenes."""
    perceiver, tally = ClassicalPerceiver(ClassicalConfig()), Tally()
    for k in range(scenes):
        truths = random_scene(np.random.default_rng([seed, k]))
        compare(truths, perceiver.perceive(render(truths, noise=noise, seed=k), "", WORKSPACE), tally)
    return tally


def report(tally: Tally) -> str:
    """The figures, in words."""
    return "\n".join(
        [
            f"  recall    {tally.found / tally.truths:.4f} of {tally.truths}",
            f"  precision {tally.found / (tally.found + tally.spurious):.4f} ({tally.spurious} spurious)",
            f"  centre    median {np.median(tally.centres):.2f}, p95 {np.percentile(tally.centres, 95):.2f} mm",
            f"  colour    {np.mean(tally.colours):.4f}",
        ]
    )


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    for noise in (0.0, 0.002):
        print(f"depth noise {1000 * noise:g} mm, {count} scenes")
        print(report(score(count, first, noise)))
