"""One lesson said twice: how two pieces of evidence become one."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


def merge_quality(quality: float, count: int, new: float) -> tuple[float, float]:
    """Mean quality R over all episodes that say the same, and its confidence 2|R - .5|."""
    mean = (quality * count + new) / (count + 1)
    return mean, 2 * abs(mean - 0.5)


def merge_signatures(first: Mapping[str, float], count: int, second: Mapping[str, float]) -> dict[str, float]:
    """Running mean of each named number; one that only one side has is kept."""
    merged = {**first, **second}
    for name in first.keys() & second.keys():
        merged[name] = (first[name] * count + second[name]) / (count + 1)
    return merged


def merge_effects(first: Mapping[str, Any] | None, second: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Two effects on the same parameter as one, as JSON.

    Priors pool mean, deviation and count (parallel variance); of two bounds the tighter one holds; a prohibition
    stays. An effect whose numbers are absent or not finite gives way to the other.
    """
    if second is None or not _sound(second):
        return dict(first) if first else None
    if first is None or not _sound(first) or first.get("kind") != second.get("kind"):
        return dict(second)
    if (first.get("scale") or "") != (second.get("scale") or ""):
        return dict(second)
    if first["kind"] == "prior":
        return _pool(first, second)
    if first["kind"] == "bound":
        tightest = max if second.get("op", ">=") == ">=" else min
        return {**second, "value": tightest(float(first["value"]), float(second["value"]))}
    return dict(second)


def _pool(first: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Mean and sample deviation of both groups together (Chan et al., 1983)."""
    n, m = max(int(first.get("count", 1)), 1), max(int(second.get("count", 1)), 1)
    a, b = float(first["value"]), float(second["value"])
    squares = (n - 1) * float(first.get("sd", 0.0)) ** 2 + (m - 1) * float(second.get("sd", 0.0)) ** 2
    squares += (b - a) ** 2 * n * m / (n + m)
    total = n + m
    return {
        **second,
        "value": (a * n + b * m) / total,
        "sd": math.sqrt(squares / (total - 1)),
        "count": total,
    }


def _sound(effect: Mapping[str, Any]) -> bool:
    try:
        numbers = [float(effect.get(name, 0.0)) for name in ("sd", "count")]
        if effect.get("kind") in ("bound", "prior"):
            numbers.append(float(effect["value"]))
    except (KeyError, TypeError, ValueError):
        return False
    return all(map(math.isfinite, numbers))


def merge_vectors(first: NDArray[np.float32], count: int, second: NDArray[np.float32]) -> NDArray[np.float32]:
    """Unit mean direction (D,) of ``count`` texts like the first and one like the second."""
    if first.shape != second.shape:
        return second
    total = first.astype(np.float64) * count + second
    length = float(np.linalg.norm(total))
    return (total / length).astype(np.float32) if length > 0 else second
