"""The geometric verifier: rules on what the robot itself could see and feel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges

if TYPE_CHECKING:
    from gvla2.memory.contracts import Verifier

RANGES = {
    "same_place": (0.001, 0.5, "m"),
    "risen": (0.001, 0.6, "m"),
    "empty_width": (0, 0.1, "m"),
    "margin": (0, 0.2, "m"),
}


@dataclass
class GeometricConfig(ComponentConfig):
    """Options of the ``geometric`` verifier, metres.

    An object found within ``same_place`` of its old place has not moved; one ``risen`` higher was lifted; fingers
    further apart than ``empty_width`` hold something; ``margin`` is how far outside a goal's footprint a centre may lie
    and still count as inside (perception is that coarse).
    """

    same_place: float = 0.02
    risen: float = 0.03
    empty_width: float = 0.001
    margin: float = 0.005

    def __post_init__(self) -> None:
        check_ranges(self, "verifier", RANGES)


def _build(config: GeometricConfig) -> Verifier:
    """Judges robot episodes by the execution report and the scenes perceived before and after."""
    from gvla2_plugins.geometric.verifier import GeometricVerifier

    return GeometricVerifier(config)


@hookimpl
def gvla2_verifiers() -> list[Component[Verifier]]:
    """The one verifier of this plugin."""
    return [Component("geometric", GeometricConfig, _build)]
