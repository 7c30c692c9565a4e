"""How the rasteriser's kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Real = Any  # float32 in the compiled code, for which Python has no type of its own
Ints = NDArray[np.int32] | NDArray[np.int64]
F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile on the first call, keep the result on disk, and run without the interpreter's lock.

    Division by zero gives infinity, as in numpy; products and sums may be fused but never reordered, so that an
    answer depends on the machine at most in the last bit.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}
    return cast(F, numba.njit(cache=True, nogil=True, **options)(function))
