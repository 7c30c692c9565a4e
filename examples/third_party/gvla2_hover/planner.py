"""The planner itself; imported when `planner=hover` was chosen."""

import math

from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint


class HoverPlanner:
    """Two waypoints: high above the nearest object, then ``height`` above it, pointing down."""

    def __init__(self, config):
        self.height = config.height

    def plan(self, request: PlanRequest) -> Plan:
        """A plan for whatever was said; an abstention when there is nothing to hover above."""
        hand = request.start[:3, 3]
        things = sorted(request.scene.objects, key=lambda thing: math.dist(thing.centre, hand))
        if not things:
            return Plan(None, abstention=Abstention("nothing_matches", "The scene is empty."))
        x, y, z = *things[0].centre[:2], things[0].top + self.height
        down = Orientation("axis", vector=(0.0, 0.0, -1.0))
        stops = (("approach", z + 0.05), ("hover", z))
        path = tuple(Waypoint((float(x), float(y), float(h)), 1.0, stage, down) for stage, h in stops)
        return Plan(Trajectory(path), "hover", {"theme": things[0].id}, {"height": self.height})
