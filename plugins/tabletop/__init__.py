"""Tasks on a table, re-authored from the published sizes: pick and lift, push a block, switch a lamp on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.task import Task


@dataclass
class PickAndLiftConfig(ComponentConfig):
    """Options of ``pick_and_lift``; metres and kilograms."""

    cubes: int = 3
    size: float = 0.05
    mass: float = 0.125
    area: tuple[float, float] = (0.43, 0.565)
    gap: float = 0.10


@dataclass
class PushBlockConfig(ComponentConfig):
    """Options of ``push_block``; metres and kilograms. ``distance`` is from the block to the target's centre."""

    size: float = 0.0563
    mass: float = 0.356
    target: float = 0.10
    distance: tuple[float, float] = (0.15, 0.30)


@dataclass
class LampOnConfig(ComponentConfig):
    """Options of ``lamp_on``; metres, N/m. ``height`` is the button's top above the table."""

    diameter: float = 0.033
    height: float = 0.024
    travel: float = 0.010
    stiffness: float = 400.0


def _pick_and_lift(config: PickAndLiftConfig) -> Task:
    """Lift the cube of the named colour, beside others of other colours."""
    from gvla2_plugins.tabletop.pick_and_lift import PickAndLift

    return PickAndLift(config)


def _push_block(config: PushBlockConfig) -> Task:
    """Push a block onto a square painted on the table."""
    from gvla2_plugins.tabletop.push_block import PushBlock

    return PushBlock(config)


def _lamp_on(config: LampOnConfig) -> Task:
    """Press the sprung button of a lamp."""
    from gvla2_plugins.tabletop.lamp_on import LampOn

    return LampOn(config)


@hookimpl
def gvla2_tasks() -> list[Component[Task]]:
    """The tabletop tasks."""
    return [
        Component("pick_and_lift", PickAndLiftConfig, _pick_and_lift),
        Component("push_block", PushBlockConfig, _push_block),
        Component("lamp_on", LampOnConfig, _lamp_on),
    ]
