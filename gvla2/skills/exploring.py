"""Exploring: deliberate variation of theta, so that memory learns what else works and what does not."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping

import numpy as np

from gvla2.planning.contracts import PlanRequest

SPEEDS = ("speed", "contact_speed")
"""Never varied, for safety."""

LEAST, MOST = 0.5, 1.5
"""Bounds of the factors; a larger change would be a different motion."""


def varied(
    theta: Mapping[str, float],
    spread: float,
    seed: int,
    request: PlanRequest,
    theme: str,
    said: frozenset[str] = frozenset(),
) -> tuple[dict[str, float], list[str]]:
    """Theta with each number except the speeds multiplied by a log-normal factor, and one sentence for each change.

    ``spread`` is the standard deviation of the factors' logarithm, 0 for no variation. The factors are the same for the
    same seed, instruction, scene and ``theme`` (an id); each is independent of the other parameters. Numbers that are 0
    or that the instruction ``said`` (names) are kept.
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
