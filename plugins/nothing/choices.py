"""The null choices: each contract's way to do nothing."""

from __future__ import annotations

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.memory.contracts import Learned, MemoryContext, MemoryEpisode, MemoryTask, Verdict
from gvla2.reconstruction.contracts import AxisFit
from gvla2.robot.backend import CameraFrames

_OFF = "memory is off"


class NoCamera:
    """Has no cameras."""

    @property
    def live(self) -> bool:
        """True: it shows nothing false."""
        return True

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """No views."""
        return CameraFrames((), ())

    def close(self) -> None:
        """Nothing to release."""


class NoReconstructor:
    """Leaves objects as perceived."""

    def reconstruct(self, views: Views) -> None:
        """Always None."""


class NoPrior:
    """Knows nothing beyond the views."""

    def predict(self, views: Views) -> None:
        """Always None."""


class NoAxis:
    """Leaves every axis unchanged."""

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The identity."""
        none = float("nan")
        return AxisFit(
            np.ones(3), np.zeros(3), False, none, none, 0, "There is no axis compensation.", centre, np.eye(3)
        )


class NoFusion:
    """Keeps source A (the paper's "no fusion" row)."""

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """The centres of A (N, 3), ignoring B."""
        return a


class NoMemory:
    """Recalls nothing, saying that memory is off; learns nothing."""

    def recall(self, task: MemoryTask) -> MemoryContext:
        """An empty context that abstains."""
        return MemoryContext(abstained=_OFF)

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Stores nothing; every lesson counts as discarded."""
        return Learned(discarded=len(episode.lessons), notes=(_OFF,))

    def close(self) -> None:
        """Nothing is open."""
