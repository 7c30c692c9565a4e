"""The plugin machinery: how a hook's components become choices on the command line.

:mod:`kinds` has the table of kinds, :mod:`discovery` loads entry points, :mod:`manager` calls the hooks by pluggy's
rules and checks what they return, :mod:`registry` looks components up and builds them, and
:mod:`hydra_config` makes them choices on the command line.

    from gvla2.plugins.registry import load_plugins

    registry = load_plugins()
    registry.components("planner")           # what there is, by name
    registry.problems                        # what is broken, and why
    planner = registry.build(config, "planner")
"""
