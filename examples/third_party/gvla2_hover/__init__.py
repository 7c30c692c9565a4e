"""A planner that hovers above the nearest object: a whole gvla2 plugin."""

from dataclasses import dataclass

from gvla2 import Component, ComponentConfig, hookimpl


@dataclass
class HoverConfig(ComponentConfig):
    """Options of the ``hover`` planner: ``height`` of the hand above the object's top, metres."""

    height: float = 0.12


def build(config: HoverConfig):
    """Hovers above the nearest object and touches nothing."""
    from gvla2_hover.planner import HoverPlanner

    return HoverPlanner(config)


@hookimpl
def gvla2_planners():
    return [Component("hover", HoverConfig, build)]


@hookimpl
def gvla2_config_search_path():
    return ["pkg://gvla2_hover.conf"]
