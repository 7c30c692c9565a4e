"""Whether two typed effects contradict each other. Exact: no words are read."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

Effect = Mapping[str, Any]


def effects_conflict(first: Effect, second: Effect) -> str:
    """How two typed effects contradict each other, "" where they don't.

    Bounds that leave nothing between them; means too far apart for their deviations (or by half, where single
    successes have none); what is both forbidden and successful. Two programs never do: there are many ways to succeed.
    """
    if "program" in (first.get("kind"), second.get("kind")) or not same_parameter(first, second):
        return ""
    kinds = (first.get("kind"), second.get("kind"))
    name = str(first.get("parameter"))
    if "forbid" in kinds:
        return f"{name} is forbidden and succeeded" if "prior" in kinds else ""
    try:
        a, b = float(first.get("value", math.nan)), float(second.get("value", math.nan))
        deviations = [float(effect.get("sd", 0.0)) for effect in (first, second)]
        counts = [max(int(effect.get("count", 1)), 1) for effect in (first, second)]
    except (TypeError, ValueError, OverflowError):
        return ""
    if not all(map(math.isfinite, (a, b, *deviations))):
        return ""
    scale = max(abs(a), abs(b))
    if kinds == ("bound", "bound"):
        ops = (first.get("op", ">="), second.get("op", ">="))
        low, high = (a, b) if ops[0] == ">=" else (b, a)
        if set(ops) == {">=", "<="} and low - high > 1e-9 * scale:
            return f"{name} at least {low:.4g} against at most {high:.4g}"
    if kinds == ("prior", "prior"):
        weights = [count - 1 for count in counts]
        pooled = math.sqrt(
            sum(w * sd**2 for w, sd in zip(weights, deviations, strict=True)) / max(sum(weights), 1)
        )
        if abs(a - b) > max(3.0 * pooled, (0.5 if min(counts) < 3 else 0.25) * scale):
            return f"{name} {a:.4g} against {b:.4g}"
    return ""


def same_parameter(first: Effect, second: Effect) -> bool:
    """Whether both are about one parameter of one skill and object, where these are given."""
    if str(first.get("parameter", "")) != str(second.get("parameter", "")):
        return False
    if (first.get("scale") or "") != (second.get("scale") or ""):
        return False  # metres and shares of a side do not compare
    return all(
        not first.get(name) or not second.get(name) or first[name] == second[name]
        for name in ("skill", "object")
    )
