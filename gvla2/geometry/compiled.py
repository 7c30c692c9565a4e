"""Loops compiled by numba whose answers are those of the same loop in Python, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compiled on the first call, kept on disk; while it runs, other threads do too. Sums keep their order."""
    return cast(F, numba.njit(cache=True, nogil=True)(function))
