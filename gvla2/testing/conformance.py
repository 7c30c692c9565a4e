"""Shared parts of conformance checks: one error type, and common assertions."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import GeometryError, Gvla2Error
from gvla2.geometry.transform import check_rigid
from gvla2.kinds import Kind, kind_of


class ConformanceError(Gvla2Error, AssertionError):
    """A component breaks the contract of its kind; the message says which sentence, and what was found instead."""


def require(condition: object, message: str) -> None:
    """Raise :class:`ConformanceError` unless the condition holds."""
    if not condition:
        raise ConformanceError(message)


def require_type(value: object, expected: type | tuple[type, ...], what: str) -> None:
    """The value is of the type (or one of the types)."""
    names = " or ".join(t.__name__ for t in (expected if isinstance(expected, tuple) else (expected,)))
    require(
        isinstance(value, expected), f"{what} must be {names}, got {type(value).__name__}: {value!r:.200}."
    )


def require_members(made: object, kind: str | Kind) -> None:
    """The component has all members of its kind's protocol."""
    own = kind_of(kind) if isinstance(kind, str) else kind
    lacking = own.missing(made)
    require(not lacking, f"{type(made).__name__} is not a {own.name}: it lacks {', '.join(lacking)}.")


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


@contextmanager
def allowed(what: str, *errors: type[Exception]) -> Iterator[None]:
    """Exceptions that the contract does not name (all but ``errors``) become a ConformanceError."""
    try:
        yield
    except Exception as error:
        if isinstance(error, (ConformanceError, *errors)):
            raise
        names = ", ".join(e.__name__ for e in errors)
        may = f"may raise only {names}" if names else "must not raise"
        raise ConformanceError(f"{what} {may}, but raised {type(error).__name__}: {error}") from error
