"""A ball that goes into a bowl: a whole gvla2 task."""

from dataclasses import dataclass

from gvla2 import Component, ComponentConfig, hookimpl


@dataclass
class BowlConfig(ComponentConfig):
    """Options of ``ball_in_bowl``: diameters in metres."""

    ball: float = 0.05
    bowl: float = 0.15


def build(config: BowlConfig):
    """Put the ball of the named colour into the bowl."""
    from gvla2_bowl.task import BallInBowl

    return BallInBowl(config)


@hookimpl
def gvla2_tasks():
    return [Component("ball_in_bowl", BowlConfig, build)]
