"""The subjects of the robot suite's rows: tasks with their options, and in a learnable world families of things."""

from __future__ import annotations

from typing import Any

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import given_options, options_of, require_among
from gvla2.errors import ConfigurationError
from gvla2.evaluation.robot.design import PAPER, ordered
from gvla2.plugins.registry import Registry

LEARNABLE = "learnable"
FAMILY = ", family "
"""Between a task and the number of a family in a row's name."""


def subjects(config: BenchConfig, registry: Registry) -> dict[str, dict[str, Any]]:
    """The rows of the bench in their order: each one's name, and the task's name and options.

    In a learnable world there is a row per family, and the world is that of the bench's first seed. Raises
    :class:`ConfigurationError` for options that a task does not have.
    """
    found: dict[str, dict[str, Any]] = {}
    names = ordered(config.tasks or default_tasks(config, registry))
    require_among("task_options", config.task_options, names, "tasks")
    world = {"world": LEARNABLE, "world_seed": config.seeds[0], "families": config.families}
    for name in names:
        options = task_options(config, registry, name)
        label = task_label(config, name)
        if config.world != LEARNABLE:
            found[label] = {"name": name, **options}
            continue
        if "family" not in options_of(registry, "task", name):
            raise ConfigurationError(f"world is {LEARNABLE}, but the task '{name}' has no option 'family'.")
        for family in range(config.families):
            found[f"{label}{FAMILY}{family}"] = {"name": name, **options, **world, "family": family}
    return found


def task_label(config: BenchConfig, name: str) -> str:
    """A task in a table: its name and given options."""
    given = config.task_options.get(name) or {}
    told = ", ".join(f"{option}={value}" for option, value in sorted(given.items()))
    return f"{name} ({told})" if told else name


def task_options(config: BenchConfig, registry: Registry, name: str) -> dict[str, Any]:
    """The options of a task by its name, with the bench's ``scale`` unless that is 1.

    Raises :class:`ConfigurationError` for one that it does not have.
    """
    known, place = options_of(registry, "task", name), f"task_options.{name}"
    options = given_options(place, config.task_options.get(name) or {}, f"the task '{name}'", known)
    if config.scale == 1:
        return options
    if "scale" not in known:
        raise ConfigurationError(f"scale is {config.scale}, but the task '{name}' has no option scale.")
    return {**options, "scale": config.scale}


def subject_options(config: BenchConfig, registry: Registry, label: str) -> dict[str, Any]:
    """The task and options of a row; another task, which only explores for the control, has no options."""
    found = subjects(config, registry)
    if label in found:
        return found[label]
    return {"name": label, **({"scale": config.scale} if config.scale != 1 else {})}


def default_tasks(config: BenchConfig, registry: Registry) -> list[str]:
    """The default tasks: the paper's fourteen, or all that have something to learn."""
    if config.world != LEARNABLE:
        return list(PAPER)
    return [name for name in registry.components("task") if _can_be_built(registry, name)]


def kind_of(label: str) -> str:
    """The task of a row's name, without its family."""
    return label.partition(FAMILY)[0]


def _can_be_built(registry: Registry, name: str) -> bool:
    if "family" not in options_of(registry, "task", name):
        return False
    try:
        registry.build({"task": {"name": name, "world": LEARNABLE}}, "task")
    except ConfigurationError:
        return False
    return True
