"""Shared parts of conformance checks, besides the assertions of :mod:`gvla2.geometry.exchange`, as a run makes them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gvla2.errors import ConformanceError
from gvla2.geometry.exchange import require
from gvla2.plugins.kinds import Kind, kind_of


def require_members(made: object, kind: str | Kind) -> None:
    """The component has all members of its kind's protocol."""
    own = kind_of(kind) if isinstance(kind, str) else kind
    lacking = own.missing(made)
    require(not lacking, f"{type(made).__name__} is not a {own.name}: it lacks {', '.join(lacking)}.")


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
