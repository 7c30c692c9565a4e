"""The optional libraries of arms: pinocchio, coal and OMPL."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from gvla2.errors import MissingDependencyError

_PURPOSES = {"pinocchio": "An arm's kinematics", "coal": "Collision checking", "ompl": "Motion planning"}


def library(name: str) -> Any:
    """The module ``name``, such as "coal" or "ompl.base"; raises :class:`MissingDependencyError` without it."""
    try:
        return import_module(name)
    except ImportError as error:
        purpose = _PURPOSES[name.partition(".")[0]]
        raise MissingDependencyError(name, purpose, 'pip install "gvla2[sim]"') from error
