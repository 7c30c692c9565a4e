"""What the robot suite's rows are about: tasks with their options, and in a learnable world families of things."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
from typing import Any

from gvla2.catalog import Registry
from gvla2.commands.bench_config import BenchConfig
from gvla2.errors import ConfigurationError
from gvla2.evaluation.robot.design import PAPER

LEARNABLE = "learnable"
FAMILY = ", family "
"""Between a task and the number of a family in a row's name."""


def subjects(config: BenchConfig, registry: Registry) -> dict[str, dict[str, Any]]:
    """The rows of the bench in their order: each one's name, and the task's name and options.

    In a learnable world there is a row a family, and the world is that of the bench's first seed. Raises
    :class:`ConfigurationError` for options that a task does not have.
    """
    found: dict[str, dict[str, Any]] = {}
    names = list(dict.fromkeys(config.tasks)) or default_tasks(config, registry)
    for task in config.task_options:
        if task not in names:
            raise ConfigurationError(
                f"task_options.{task}: '{task}' is none of the tasks of this bench ({', '.join(names)})."
            )
    for name in [n for n in PAPER if n in names] + [n for n in names if n not in PAPER]:
        options = task_options(config, registry, name)
        told = ", ".join(f"{option}={value}" for option, value in sorted(options.items()))
        label = f"{name} ({told})" if told else name
        if config.scale != 1:
            _require(registry, name, "scale", f"scale is {config.scale}")
            options["scale"] = config.scale
        if config.world != LEARNABLE:
            found[label] = {"name": name, **options}
            continue
        _require(registry, name, "family", f"world is {LEARNABLE}")
        world = {"world": LEARNABLE, "world_seed": config.seeds[0], "families": config.families}
        for family in range(config.families):
            found[f"{label}{FAMILY}{family}"] = {"name": name, **options, **world, "family": family}
    return found


def subject_options(config: BenchConfig, registry: Registry, label: str) -> dict[str, Any]:
    """The task and options of a row; of another task, which only explores for the control, without options."""
    found = subjects(config, registry)
    if label in found:
        return found[label]
    return {"name": label, **({"scale": config.scale} if config.scale != 1 else {})}


def default_tasks(config: BenchConfig, registry: Registry) -> list[str]:
    """The tasks where none are named: the paper's fourteen, or all that have something to learn."""
    if config.world != LEARNABLE:
        return list(PAPER)
    return [name for name in registry.components("task") if _can_be_built(registry, name)]


def kind_of(label: str) -> str:
    """The task of a row's name, without its family."""
    return label.partition(FAMILY)[0]


def _can_be_built(registry: Registry, name: str) -> bool:
    if "family" not in _known(registry, name):
        return False
    try:
        registry.build({"task": {"name": name, "world": LEARNABLE}}, "task")
    except ConfigurationError:
        return False
    return True


def task_options(config: BenchConfig, registry: Registry, name: str) -> dict[str, Any]:
    """What ``task_options`` gives a task. Raises :class:`ConfigurationError` for an option that it does not have."""
    given = config.task_options.get(name) or {}
    if not isinstance(given, Mapping):
        raise ConfigurationError(
            f"task_options.{name} is {given!r}; give options: task_options.{name}.OPTION=VALUE."
        )
    known = sorted(_known(registry, name) - {"name"})
    for option in given:
        if option not in known:
            close = get_close_matches(str(option), known, n=1)
            hint = f" Did you mean '{close[0]}'?" if close else ""
            raise ConfigurationError(
                f"task_options.{name}.{option}: the task '{name}' has no such option.{hint} "
                f"It has: {', '.join(known) or 'none'}."
            )
    return dict(given)


def _require(registry: Registry, name: str, option: str, why: str) -> None:
    if option not in _known(registry, name):
        raise ConfigurationError(f"{why}, but the task '{name}' has no option '{option}'.")


def _known(registry: Registry, name: str) -> set[str]:
    return {field.name for field in fields(registry.get("task", name).config)}
