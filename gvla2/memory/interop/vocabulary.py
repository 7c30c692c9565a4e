"""The words of the released layouts, and ours: verdicts, times, shares."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Any

from gvla2.memory.contracts import Outcome
from gvla2.memory.records import clean

OUTCOMES: Mapping[str, Outcome] = MappingProxyType(
    {
        **dict.fromkeys(("success", "succeeded", "verified_success", "pass", "passed"), "verified_success"),
        **dict.fromkeys(("fail", "failed", "failure", "verified_fail", "verified_failure"), "verified_fail"),
        **dict.fromkeys(("uncertain", "unknown", "unverified", ""), "uncertain"),
        "unavailable": "unavailable",
    }
)
"""Every spelling of a status that the releases have used."""

QUALITIES: Mapping[Outcome, float] = MappingProxyType(
    {"verified_success": 0.8, "verified_fail": 0.2, "uncertain": 0.5, "unavailable": 0.5}
)
"""Quality R of a line that has a verdict and no score; its confidence follows as 2|R - .5|."""


def outcome_of(status: object) -> Outcome | None:
    """The verdict that a status means; None for a word that is not known."""
    if isinstance(status, bool):
        return "verified_success" if status else "verified_fail"
    return OUTCOMES.get(str("" if status is None else status).strip().casefold())


def seconds_of(value: object) -> float | None:
    """Seconds since the epoch of a number or an ISO date (UTC where it names no zone); None if it is neither."""
    if isinstance(value, str):
        try:
            date = datetime.fromisoformat(value.strip())
        except ValueError:
            return None
        value = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value) if 0 <= value < 4e11 else None


def date_of(seconds: float) -> str:
    """The ISO date in UTC."""
    return datetime.fromtimestamp(seconds, UTC).isoformat()


def share(value: object) -> float | None:
    """A number held to [0, 1]; None for what is no number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return min(max(float(value), 0.0), 1.0)


def count(value: object) -> int:
    """A count; 0 for what is none."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return 0
    return min(max(int(value), 0), 2**53)


def names(value: object) -> tuple[str, ...]:
    """A list of ids; what is no text in it is left out."""
    return tuple(clean(v, 1000) for v in value if isinstance(v, str)) if isinstance(value, list) else ()


def numbers(value: object) -> dict[str, Any]:
    """The finite numbers of an object by name."""
    if not isinstance(value, Mapping):
        return {}
    return {
        str(k): float(v)
        for k, v in value.items()
        if isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v)
    }
