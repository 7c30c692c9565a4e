"""The null choices: no reconstruction, no prior, no fusion, no memory, each a component like any other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.memory.contracts import Memory
    from gvla2.reconstruction.contracts import (
        AxisCompensation,
        FusionStrategy,
        GeometryPrior,
        Reconstructor,
    )
    from gvla2.robot.backend import DepthCamera


def _build_reconstructor(config: ComponentConfig) -> Reconstructor:
    """Reconstructs nothing: objects stay as perceived."""
    from gvla2_plugins.nothing.choices import NoReconstructor

    return NoReconstructor()


def _build_prior(config: ComponentConfig) -> GeometryPrior:
    """Predicts nothing: geometry rests only on the views."""
    from gvla2_plugins.nothing.choices import NoPrior

    return NoPrior()


def _build_axis(config: ComponentConfig) -> AxisCompensation:
    """Compensates nothing: the shape is unchanged."""
    from gvla2_plugins.nothing.choices import NoAxis

    return NoAxis()


def _build_fusion(config: ComponentConfig) -> FusionStrategy:
    """Fuses nothing: keeps the geometry of source A."""
    from gvla2_plugins.nothing.choices import NoFusion

    return NoFusion()


def _build_memory(config: ComponentConfig) -> Memory:
    """Remembers nothing: the memory-off arm of an ablation."""
    from gvla2_plugins.nothing.choices import NoMemory

    return NoMemory()


def _build_camera(config: ComponentConfig) -> DepthCamera:
    """Sees nothing: for robots with cameras of their own, and for moves that need none."""
    from gvla2_plugins.nothing.choices import NoCamera

    return NoCamera()


@hookimpl
def gvla2_cameras() -> list[Component[DepthCamera]]:
    """``camera=none``."""
    return [Component("none", ComponentConfig, _build_camera)]


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=none``."""
    return [Component("none", ComponentConfig, _build_reconstructor)]


@hookimpl
def gvla2_geometry_priors() -> list[Component[GeometryPrior]]:
    """``prior=none``."""
    return [Component("none", ComponentConfig, _build_prior)]


@hookimpl
def gvla2_axis_compensations() -> list[Component[AxisCompensation]]:
    """``axis=none``."""
    return [Component("none", ComponentConfig, _build_axis)]


@hookimpl
def gvla2_fusion_strategies() -> list[Component[FusionStrategy]]:
    """``fusion=none``."""
    return [Component("none", ComponentConfig, _build_fusion)]


@hookimpl
def gvla2_memories() -> list[Component[Memory]]:
    """``memory=none``."""
    return [Component("none", ComponentConfig, _build_memory)]
