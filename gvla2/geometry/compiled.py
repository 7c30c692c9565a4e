"""Loops compiled by numba for what is asked often: a camera's pixels, the joints of an arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compiled on the first call, kept on disk; while it runs, other threads do too.

    Sums keep their order; division by zero gives infinity, as in numpy.
    """
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy")(function))
