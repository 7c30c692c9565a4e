"""Connected components above the table, each with a box around it."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.views import Observation
from gvla2.perception.clusters import clusters
from gvla2.perception.frames import frames_of, raised
from gvla2.perception.objects import numbered, object_of, over_workspace
from gvla2.planning.scene import Box, Scene
from gvla2_plugins.connected import ConnectedConfig


class ConnectedPerceiver:
    """Implements :class:`gvla2.planning.contracts.Perceiver`."""

    def __init__(self, config: ConnectedConfig) -> None:
        self._config = config

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """One object per cluster; the instruction is not used. Raises :class:`~gvla2.errors.PerceptionError` when no
        camera delivers depth, or no level plane is found.
        """
        del instruction
        frames, table, notes = frames_of(observation.views, workspace)
        masks = [raised(frame, table, workspace, self._config.min_height) for frame in frames]
        found = clusters(frames, masks)
        height = table.height_over(workspace)
        objects = []
        for k in range(found.count):
            rgb = np.concatenate([f.view.image[m == k] for f, m in zip(frames, found.maps, strict=True)])
            objects.append(object_of(found.points(frames, k), rgb / 255.0, height, 1.0, f"object{k}"))
        inside = numbered(over_workspace(objects, workspace))
        return Scene(inside, height, workspace, "connected", tuple(notes))
