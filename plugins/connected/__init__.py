"""The plainest perceiver: each connected component above the table is an object. A baseline."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.planning.contracts import Perceiver


@dataclass
class ConnectedConfig(ComponentConfig):
    """Options of the ``connected`` perceiver. ``min_height``: points lower above the table belong to it, metres."""

    min_height: float = 0.004


def _build(config: ConnectedConfig) -> Perceiver:
    """Connected components of the points above the table, and nothing else: a baseline."""
    from gvla2_plugins.connected.perceiver import ConnectedPerceiver

    return ConnectedPerceiver(config)


@hookimpl
def gvla2_perceivers() -> list[Component[Perceiver]]:
    """The perceiver ``connected``."""
    return [Component("connected", ConnectedConfig, _build)]
