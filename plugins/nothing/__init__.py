"""The null choices: no reconstruction, no prior, no fusion, no memory, no camera, each a component like any other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.geometry.transform import FloatArray
    from gvla2.geometry.views import Views
    from gvla2.memory.contracts import Learned, Memory, MemoryContext, MemoryEpisode, MemoryTask, Verdict
    from gvla2.reconstruction.contracts import (
        AxisCompensation,
        AxisFit,
        FusionStrategy,
        GeometryPrior,
        Reconstructor,
    )
    from gvla2.robot.backend import CameraFrames, DepthCamera

_OFF = "memory is off"


class NoCamera:
    """Sees nothing: for robots with cameras of their own, and for moves that need none."""

    live = True

    def observe(self, base_from_tcp: FloatArray | None = None) -> CameraFrames:
        """No views."""
        from gvla2.robot.backend import CameraFrames

        return CameraFrames((), ())

    def close(self) -> None:
        """Nothing to release."""


class NoReconstructor:
    """Reconstructs nothing: objects stay as perceived."""

    def reconstruct(self, views: Views) -> None:
        """Always None."""


class NoPrior:
    """Predicts nothing: geometry rests only on the views."""

    def predict(self, views: Views) -> None:
        """Always None."""


class NoAxis:
    """Compensates nothing: the shape is unchanged."""

    def compensate(self, points: FloatArray, views: Views, centre: FloatArray) -> AxisFit:
        """The identity."""
        import numpy as np

        from gvla2.reconstruction.contracts import AxisFit

        none = float("nan")
        reason = "There is no axis compensation."
        return AxisFit(np.ones(3), np.zeros(3), False, none, none, 0, reason, centre)


class NoFusion:
    """Fuses nothing: keeps the geometry of source A (the paper's "no fusion" row)."""

    def fuse(self, a: FloatArray, b: FloatArray, support_a: FloatArray, support_b: FloatArray) -> FloatArray:
        """The centres of A (N, 3), ignoring B."""
        return a


class NoMemory:
    """Remembers nothing: the memory-off arm of an ablation."""

    def recall(self, task: MemoryTask) -> MemoryContext:
        """An empty context that abstains."""
        from gvla2.memory.contracts import MemoryContext

        return MemoryContext(abstained=_OFF)

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Stores nothing; every lesson counts as discarded."""
        from gvla2.memory.contracts import Learned

        return Learned(discarded=len(episode.lessons), notes=(_OFF,))

    def close(self) -> None:
        """Nothing is open."""


def _none(made: type[Any]) -> Component[Any]:
    summary = (made.__doc__ or "").splitlines()[0]
    return Component("none", ComponentConfig, lambda config: made(), summary=summary)


@hookimpl
def gvla2_cameras() -> list[Component[DepthCamera]]:
    """``camera=none``."""
    return [_none(NoCamera)]


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=none``."""
    return [_none(NoReconstructor)]


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=none``."""
    return [_none(NoPrior)]


@hookimpl
def gvla2_axis_compensations() -> list[Component[AxisCompensation]]:
    """``axis=none``."""
    return [_none(NoAxis)]


@hookimpl
def gvla2_fusion_strategies() -> list[Component[FusionStrategy]]:
    """``fusion=none``."""
    return [_none(NoFusion)]


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """``memory=none``."""
    return [_none(NoMemory)]
