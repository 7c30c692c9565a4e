"""gvla2: geometry-aware, memory-guided robot planning, every part a plugin.

``import gvla2`` stays light: it loads no numerical library.
The extension points are in :mod:`gvla2.hookspecs`; the loop that uses them is in :mod:`gvla2.episode`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gvla2.component import Component, ComponentConfig, hookimpl, register, unregister
from gvla2.errors import Gvla2Error

if TYPE_CHECKING:
    from pathlib import Path

    from gvla2.episode.record import EpisodeRecord

__version__ = "0.2.0"

__all__ = [
    "Component",
    "ComponentConfig",
    "Gvla2Error",
    "__version__",
    "hookimpl",
    "register",
    "run",
    "unregister",
]


def run(folder: Path | str | None = None, /, **options: Any) -> EpisodeRecord:
    """One episode, as ``gvla2 run`` runs it: ``gvla2.run(task="push_block", seed=3)``.

    ``options`` are those of the command line; dotted ones as ``**{"planner.lift_height": 0.3}``. The record has the
    observation, scene, plan, report, verdict and success check; into ``folder``, if given, go its files, film and
    page. Raises :class:`Gvla2Error` for a configuration that does not work or a robot that does not start; an episode
    that failed is a result.
    """
    from gvla2.commands.run import run_here

    return run_here(options, folder)
