"""Runs as recordings for the viewer rerun: ``gvla2 run view=rerun``. Off by default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.errors import MissingDependencyError

if TYPE_CHECKING:
    from gvla2.record.tracker import Viewer


@dataclass
class RerunConfig(ComponentConfig):
    """Options of ``rerun``: the name of the ``file`` in each episode's folder; ``rerun FILE`` opens it.

    ``points`` is the most points kept of the cameras' measurements.
    """

    file: str = "episode.rrd"
    points: int = 60_000


def _rerun(config: RerunConfig) -> Viewer:
    """Cameras, points, objects, path, joints and film on one time line, as a file for rerun."""
    try:
        from gvla2_plugins.rerun_view.recording import RerunViewer
    except ImportError as error:
        install = "pip install 'gvla2[view]'"
        raise MissingDependencyError("rerun", "view=rerun", install, "MIT or Apache-2.0") from error
    return RerunViewer(config)


@hookimpl
def gvla2_views() -> list[Component[Viewer]]:
    """``view=rerun``."""
    return [Component("rerun", RerunConfig, _rerun)]
