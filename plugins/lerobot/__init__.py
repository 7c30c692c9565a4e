"""``policy=lerobot``: checkpoints of LeRobot (ACT, diffusion, SmolVLA and others), by LeRobot's own loaders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.robot.policy import Policy


@dataclass
class LerobotConfig(ComponentConfig):
    """Options of a policy of LeRobot.

    ``path``: the checkpoint's folder, ``pretrained_model`` as `lerobot-train` writes it, or its name on the Hugging
    Face hub. ``rate`` is that of its training data, actions a second; ``seconds`` after which an episode is given up;
    ``device`` is PyTorch's: cpu or cuda. Pictures are scaled to those that it was trained with; its cameras must be
    among the robot's.
    """

    path: str = ""
    rate: float = 20.0
    seconds: float = 30.0
    device: str = "cpu"


def _build(config: LerobotConfig) -> Policy:
    """A trained policy that drives the robot in closed loop; needs lerobot."""
    from gvla2_plugins.lerobot.policy import LerobotPolicy

    return LerobotPolicy(config)


@hookimpl
def gvla2_policies() -> list[Component[Policy]]:
    """``policy=lerobot``, also chosen by ``policy=FOLDER``."""
    return [Component("lerobot", LerobotConfig, _build)]
