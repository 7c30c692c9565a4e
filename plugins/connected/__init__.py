"""The plainest perceiver: each connected component above the table is an object. A baseline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.geometry.views import Observation
    from gvla2.planning.contracts import Perceiver
    from gvla2.planning.scene import Box, Scene


@dataclass
class ConnectedConfig(ComponentConfig):
    """Options of the ``connected`` perceiver. ``min_height``: points lower above the table belong to it, metres."""

    min_height: float = 0.004


class ConnectedPerceiver:
    """Connected components of the points above the table, each with a box around it, and nothing else: a baseline."""

    def __init__(self, config: ConnectedConfig) -> None:
        self._config = config

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """One object per cluster; the instruction is not used. Raises :class:`~gvla2.errors.PerceptionError` when no
        camera delivers depth, or no level plane is found.
        """
        from gvla2.perception.clusters import cloud_of, clusters
        from gvla2.perception.frames import frames_of, raised
        from gvla2.perception.objects import numbered, object_of, over_workspace
        from gvla2.planning.scene import Scene

        frames, table, notes = frames_of(observation.views, workspace)
        masks = [raised(frame, table, workspace, self._config.min_height) for frame in frames]
        found, height = clusters(frames, masks), table.height_over(workspace)
        objects = [
            object_of(*cloud_of(frames, [image == k for image in found]), height, 1.0, f"object{k}")
            for k in range(1 + max(int(image.max()) for image in found))
        ]
        inside = numbered(over_workspace(objects, workspace))
        return Scene(inside, height, workspace, "connected", tuple(notes))


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``connected``."""
    return [Component("connected", ConnectedConfig, ConnectedPerceiver)]
