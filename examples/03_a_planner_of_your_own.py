"""A plugin without a distribution, as in a notebook: register a hook, compose a configuration, build, check.

For a plugin that everybody can install see examples/third_party.

    python examples/03_a_planner_of_your_own.py planner.height=0.3
"""

import sys
from dataclasses import dataclass
from types import SimpleNamespace

import gvla2
from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.commands.hydra_job import composed
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.testing import check_planner
from gvla2.testing.inputs import plan_request


@dataclass
class RiseConfig(ComponentConfig):
    """Options of ``rise``: ``height`` in metres."""

    height: float = 0.1


class RisePlanner:
    """Raises the hand, whatever it is asked."""

    def __init__(self, config: RiseConfig) -> None:
        self.height = config.height

    def plan(self, request: PlanRequest) -> Plan:
        x, y, z = (float(v) for v in request.start[:3, 3])
        steps = (0.5 * self.height, self.height)
        return Plan(Trajectory(tuple(Waypoint((x, y, z + s), 1.0, "rise") for s in steps)), "rise")


@hookimpl
def gvla2_planners() -> list[Component[RisePlanner]]:
    """``planner=rise``."""
    return [Component("rise", RiseConfig, RisePlanner)]


gvla2.register(SimpleNamespace(gvla2_planners=gvla2_planners), "rise")  # or a module, or a class
config, registry = composed("run", ["planner=rise", *sys.argv[1:]])
planner = registry.build(config, "planner")
check_planner(planner)  # raises a ConformanceError that says what is wrong
print("rise is a planner.")
print(planner.plan(plan_request()).trajectory.xyzg().round(3))
