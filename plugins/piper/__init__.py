"""AgileX's Piper arm: a real-robot backend that sends nothing unless it is armed."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.backend import DepthCamera, RobotBackend


@dataclass
class PiperConfig(ComponentConfig):
    """Options of ``piper``; metres, radians, seconds.

    ``bus`` is python-can's interface (``socketcan``, ``slcan``), or ``none`` to plan without an arm; ``channel`` is the
    interface's channel.
    ``armed`` allows motion, after a word typed on the terminal; without it everything is planned, checked and shown,
    and nothing is sent. ``speed`` is the share of full joint speed (0.2 at most), ``tool_speed`` m/s, ``acceleration``
    rad/s², ``grip_effort`` Nm (2 at most). The base stands at ``base_position`` in the world, turned by ``base_yaw``;
    the tool stays in the box from ``workspace_low`` to ``workspace_high`` and its fingertips ``table_margin`` above
    ``table_height``. ``tcp_offset`` is from the flange to between the fingertips. ``log`` is the file of all commands
    ("" for the user's state folder).
    """

    bus: str = "socketcan"
    channel: str = "can0"
    armed: bool = False
    speed: float = 0.15
    tool_speed: float = 0.15
    acceleration: float = 1.0
    grip_effort: float = 1.0
    base_position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    base_yaw: float = 0.0
    table_height: float = 0.0
    table_margin: float = 0.002
    workspace_low: list[float] = field(default_factory=lambda: [0.05, -0.45, 0.0])
    workspace_high: list[float] = field(default_factory=lambda: [0.60, 0.45, 0.60])
    tcp_offset: float = 0.1358
    tracking_limit: float = 0.10
    log: str = ""


def _build(config: PiperConfig, camera: DepthCamera) -> RobotBackend:
    """AgileX's Piper: dry-run unless armed, held at the first sign of trouble."""
    from gvla2_plugins.piper.backend import Piper

    return Piper(config, camera)


@hookimpl
def gvla2_robots() -> list[Component[RobotBackend]]:
    """The Piper, with the chosen camera."""
    return [Component("piper", PiperConfig, _build, needs=("camera",))]
