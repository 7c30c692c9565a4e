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
            value = (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            return None
    number = finite_number(value)
    return number if number is not None and 0 <= number < 4e11 else None


def date_of(seconds: float) -> str | None:
    """The ISO date in UTC; None for a time that no calendar has, as a clock gone wrong gives it."""
    try:
        return datetime.fromtimestamp(seconds, UTC).isoformat()
    except (ValueError, OverflowError, OSError):
        return None


def finite_number(value: object) -> float | None:
    """A number as a finite float; None for what is no number, or beyond all floats."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:  # JSON's whole numbers have no bound
        return None
    return number if math.isfinite(number) else None


def share(value: object) -> float | None:
    """A number held to [0, 1]; None for what is no number."""
    number = finite_number(value)
    return None if number is None else min(max(number, 0.0), 1.0)


def count(value: object) -> int:
    """A count; 0 for what is none."""
    number = finite_number(value)
    return 0 if number is None else int(min(max(number, 0.0), 2.0**53))


def names(value: object) -> tuple[str, ...]:
    """A list of ids; what is no text in it is left out."""
    return tuple(clean(v, 1000) for v in value if isinstance(v, str)) if isinstance(value, list) else ()


def numbers(value: object) -> dict[str, Any]:
    """The finite numbers of an object by name."""
    if not isinstance(value, Mapping):
        return {}
    return {str(k): number for k, v in value.items() if (number := finite_number(v)) is not None}
