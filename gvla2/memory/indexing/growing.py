"""Arrays that grow: room is doubled, so that adding one row at a time costs constant time on average."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)


def grown(array: NDArray[T], rows: int, fill: float = 0) -> NDArray[T]:
    """``array`` itself where it has at least ``rows`` rows, else a copy with room for half as many more.

    New rows hold ``fill``.
    """
    if len(array) >= rows:
        return array
    room = max(rows, len(array) + len(array) // 2, 16)
    if fill == 0:
        larger = np.zeros((room, *array.shape[1:]), array.dtype)
    else:
        larger = np.full((room, *array.shape[1:]), fill, array.dtype)
    larger[: len(array)] = array
    return larger
