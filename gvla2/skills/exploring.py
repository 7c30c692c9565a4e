"""Exploring: theta varied on purpose, so that episodes show memory what else works, and what does not."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

import numpy as np

from gvla2.planning.contracts import PlanRequest

SPEEDS = ("speed", "contact_speed")
"""Never varied: how fast the arm moves is a matter of safety."""

LEAST, MOST = 0.5, 1.5
"""Factors are clipped to these: beyond half as much again a parameter is another motion, not a variation."""


def varied(
    theta: Mapping[str, float],
    spread: float,
    seed: int,
    request: PlanRequest,
    theme: str,
    said: frozenset[str] = frozenset(),
) -> tuple[dict[str, float], list[str]]:
    """Theta with each number but the speeds multiplied by its own log-normal factor, and one sentence a change.

    ``spread`` is the standard deviation of the factors' logarithm, 0 for none. The factors repeat for the same seed,
    instruction, scene and ``theme`` (an id); a parameter's own does not depend on which others there are. What is 0
    stays 0; what the instruction itself said is kept.
    """
    changed: dict[str, float] = dict(theta)
    notes: list[str] = []
    if spread <= 0.0:
        return changed, notes
    seen = [[o.id, o.label, [round(1e3 * float(v)) for v in o.centre]] for o in request.scene.objects]
    for name in (n for n in theta if n not in SPEEDS and n not in said):
        key = json.dumps([seed, request.instruction, theme, name, seen]).encode()
        draw = np.random.default_rng(int.from_bytes(hashlib.blake2b(key, digest_size=8).digest(), "big"))
        changed[name] = theta[name] * float(np.clip(np.exp(spread * draw.standard_normal()), LEAST, MOST))
        if f"{changed[name]:.4g}" != f"{theta[name]:.4g}":
            notes.append(f"{name}: {theta[name]:.4g} -> {changed[name]:.4g} to explore")
    return changed, notes
