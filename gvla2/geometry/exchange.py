"""Read-only arrays for what passes between components, and assertions about what a component returns.

A run makes these of plugins, and so does :mod:`gvla2.testing`; they raise :class:`ConformanceError`.
"""

from __future__ import annotations

from copy import copy
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import ConformanceError, GeometryError
from gvla2.geometry.transform import check_rigid

T = TypeVar("T")


def read_only(value: T) -> T:
    """The value with every array in it read-only: itself, or those in tuples and dataclasses.

    These are rebuilt around views: who made an array, a camera with a buffer of its own, may still write to it.
    """
    made: Any = value
    if isinstance(value, np.ndarray):
        made = value.view()
        made.setflags(write=False)
    elif type(value) is tuple:
        made = tuple(read_only(part) for part in made)
    elif is_dataclass(value) and not isinstance(value, type):
        made = copy(value)
        for one in fields(value):
            object.__setattr__(made, one.name, read_only(getattr(value, one.name)))
    return made  # type: ignore[no-any-return]


def require(condition: object, message: str) -> None:
    """Raise :class:`ConformanceError` unless the condition holds."""
    if not condition:
        raise ConformanceError(message)


def require_type(value: object, expected: type | tuple[type, ...], what: str) -> None:
    """The value is of the type (or one of the types)."""
    if not isinstance(value, expected):  # else its words are not needed: those of a scene take milliseconds
        names = " or ".join(t.__name__ for t in (expected if isinstance(expected, tuple) else (expected,)))
        raise ConformanceError(f"{what} must be {names}, got {type(value).__name__}: {value!r:.200}.")


def require_array(value: Any, shape: tuple[int | None, ...], what: str, finite: bool = True) -> NDArray[Any]:
    """The value as an array of the shape (None: any length), finite unless said otherwise."""
    array = np.asarray(value)
    fits = array.ndim == len(shape) and all(
        n is None or n == m for n, m in zip(shape, array.shape, strict=True)
    )
    wanted = tuple("any" if n is None else n for n in shape)
    require(fits, f"{what} must have the shape {wanted}, got {array.shape}.")
    require(array.dtype.kind in "fiub", f"{what} must be numbers, got dtype {array.dtype}.")
    require(not finite or np.isfinite(array).all(), f"{what} has entries that are not finite.")
    return array


def require_rigid(value: ArrayLike, what: str) -> None:
    """The value is a rigid motion (4, 4)."""
    try:
        check_rigid(value, what)
    except GeometryError as error:
        raise ConformanceError(str(error)) from error


def require_share(value: float, what: str) -> None:
    """The value lies in [0, 1]."""
    require(0.0 <= float(value) <= 1.0, f"{what} must lie in [0, 1], got {value}.")
