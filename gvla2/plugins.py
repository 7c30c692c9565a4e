"""Plugins, as the rest of gvla2 and your own scripts see them.

    registry = load_plugins()
    registry.components("planner")           # what there is, by name
    registry.problems                        # what is broken, and why
    planner = registry.build(config, "planner")

:mod:`gvla2.kinds` has the table of kinds, :mod:`gvla2.discovery` loads entry points, :mod:`gvla2.manager` calls the
hooks by pluggy's rules, :mod:`gvla2.catalog` looks up and builds, :mod:`gvla2.hydra_bridge` makes components choices
on the command line.
"""

from gvla2.catalog import Offer, Registry, load_plugins
from gvla2.discovery import Plugin, PluginProblem
from gvla2.fitness import structured
from gvla2.kinds import KINDS, Kind, kind_of

__all__ = [
    "KINDS",
    "Kind",
    "Offer",
    "Plugin",
    "PluginProblem",
    "Registry",
    "kind_of",
    "load_plugins",
    "structured",
]
