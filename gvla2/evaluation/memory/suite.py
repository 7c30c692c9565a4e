"""The memory suite: all tests in the order of the table."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

from gvla2.errors import ConfigurationError
from gvla2.evaluation.memory import (
    poison,
    quality,
    retrieval,
    upkeep,
    writing,
)
from gvla2.evaluation.memory.figure import Test

SUITE = "memory"
VERSION = 1
"""Version of the tests: rows of another version are measured again."""


@cache
def all_tests() -> tuple[Test, ...]:
    """Every test."""
    parts = (retrieval, writing, poison, upkeep, quality)
    return tuple(test for part in parts for test in part.tests())


def chosen_tests(names: Sequence[str]) -> list[Test]:
    """The tests with these names or with rows of these names; all if none are given.

    Raises :class:`~gvla2.errors.ConfigurationError` for a name that is neither.
    """
    tests = all_tests()
    known = {name: None for test in tests for name in (test.name, *(row.name for row in test.rows))}
    for name in names:
        if name not in known:
            raise ConfigurationError(f"No test '{name}'. Available: {', '.join(known)}.")
    wanted = set(names)
    return [
        test
        for test in tests
        if not wanted or test.name in wanted or wanted & {row.name for row in test.rows}
    ]
