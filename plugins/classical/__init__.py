"""The classical perceiver: geometry and colour alone, no learned weights."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.perception.options import NamingOptions

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver


@dataclass
class ClassicalConfig(NamingOptions, ComponentConfig):
    """Options of the ``classical`` perceiver. Lengths in metres.

    ``min_height``: what rises less is table (or paint on it); more where the depth is noisy. ``min_points``: fewer
    points, over all views, are a speck. ``min_region``: the smallest painted patch, square metres. ``jump``:
    neighbouring pixels further apart are on different surfaces. ``colour_step``: neighbouring pixels whose looks
    differ by more (see ``gvla2.planning.colours``) are of different objects. ``gap``: an object with free space of
    this height under it does not stand on the table. ``fragment_reach``: pieces of one look that are further apart
    are different objects. ``textured``: share of neighbouring pixels that differ in look above which a body is finely
    painted, so that its paint separates no pieces. Names of known objects: see :class:`NamingOptions`.
    """

    min_height: float = 0.004
    min_points: int = 24
    min_region: float = 4e-4
    jump: float = 0.014
    colour_step: float = 22.0
    gap: float = 0.03
    fragment_reach: float = 0.05
    textured: float = 0.13


def _build(config: ClassicalConfig) -> Perceiver:
    """Finds objects on a table by plane, depth, colour and shape; needs no weights."""
    from gvla2_plugins.classical.perceiver import ClassicalPerceiver

    return ClassicalPerceiver(config)


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``classical``."""
    return [Component("classical", ClassicalConfig, _build)]
