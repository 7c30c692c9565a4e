"""The components of a bench: their options, and their names in tables."""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterable, Mapping
from contextlib import closing
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from gvla2.component import ComponentConfig, described
from gvla2.errors import ConfigurationError, did_you_mean
from gvla2.evaluation.config import RobotBench
from gvla2.evaluation.results import code_digest
from gvla2.plugins.kinds import OWN_TASK
from gvla2.plugins.registry import Registry
from gvla2.robot.backend import OffersTasks
from gvla2.robot.options import DepthNoise


def configured(registry: Registry, root: Mapping[str, Any], kinds: Iterable[str]) -> list[Any]:
    """The typed options of the kinds that are chosen, and of the language model if one of them needs it."""
    chosen = [k for k in kinds if not registry.chooses_nothing(root, k)]
    found = [registry.configure(root, kind) for kind in chosen]
    asking = any("language" in component.needs for _, component in found)
    return [options for options, _ in (*found, *([registry.configure(root, "language")] if asking else []))]


def code_of(typed: Iterable[object], *modules: str) -> str:
    """A digest of the code whose change outdates rows: these modules, and those of the typed options."""
    return code_digest((*modules, *sorted({type(one).__module__ for one in typed})))


def options_of(registry: Registry, kind: str, name: str) -> list[str]:
    """The names of a component's options, sorted."""
    return sorted({field.name for field in fields(registry.get(kind, name).config)} - {"name"})


def given_options(place: str, given: object, owner: str, known: Collection[str]) -> dict[str, Any]:
    """The options that ``place`` on the command line gives ``owner``, which has the ``known`` ones.

    Raises :class:`ConfigurationError` if it is not a mapping of options, or for an unknown one.
    """
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"{place} is {given!r}; give options: {place}.OPTION=VALUE.")
    for option in given:
        if option not in known:
            raise ConfigurationError(
                f"{place}.{option}: {owner} has no such option.{did_you_mean(str(option), known)} "
                f"It has: {', '.join(sorted(known)) or 'none'}."
            )
    return dict(given)


def require_among(place: str, given: Collection[str], known: Collection[str], what: str) -> None:
    """Raises :class:`ConfigurationError` if ``place`` uses a name that is not in this bench."""
    for name in given:
        if name not in known:
            raise ConfigurationError(
                f"{place}.{name}: '{name}' is not among the {what} of this bench ({', '.join(known)})."
            )


def named_tasks(config: RobotBench, registry: Registry) -> list[str]:
    """The bench's ``tasks``, each once; one with a star, ``suite/*``, stands for those that the robot offers so.

    Raises :class:`ConfigurationError` for a task of a suite, or a pattern, that the robot does not offer.
    """
    own = [name for name in config.tasks if OWN_TASK in name or "*" in name]
    if not own:
        return list(dict.fromkeys(config.tasks))
    with closing(registry.build({"robot": config.robot, "camera": config.camera}, "robot")) as robot:
        offered = list(robot.tasks()) if isinstance(robot, OffersTasks) else []
    found: dict[str, None] = {}
    for name in config.tasks:
        matching = fnmatch.filter(offered, name) if name in own else [name]
        if not matching:
            suites = dict.fromkeys(f"{task.partition(OWN_TASK)[0]}{OWN_TASK}*" for task in offered)
            raise ConfigurationError(
                f"robot={config.robot.name} has no task like '{name}'.{did_you_mean(name, [*offered, *suites])} "
                f"It offers: {', '.join(suites) or 'no tasks of its own'} (`gvla2 tasks robot={config.robot.name}`)."
            )
        found |= dict.fromkeys(matching)
    return list(found)


def task_options(config: RobotBench, registry: Registry, name: str) -> dict[str, Any]:
    """The options of a task by its name, with the bench's ``scale`` unless that is 1; a robot's own tasks have none.

    Raises :class:`ConfigurationError` for one that it does not have.
    """
    known = [] if OWN_TASK in name else options_of(registry, "task", name)
    place = f"task_options.{name}"
    options = given_options(place, config.task_options.get(name) or {}, f"the task '{name}'", known)
    if config.scale == 1:
        return options
    if "scale" not in known:
        raise ConfigurationError(f"scale is {config.scale}, but the task '{name}' has no option scale.")
    return {**options, "scale": config.scale}


def given_label(name: str, options: Mapping[str, Any]) -> str:
    """A task or reconstructor in a table: its name and the options given by it."""
    given = options.get(name) or {}
    listed = ", ".join(f"{option}={value}" for option, value in sorted(given.items()))
    return f"{name} ({listed})" if listed else name


def changed_options(config: object, names: Iterable[str]) -> str:
    """The options of these names that differ from their defaults, in a table: "exploration=0.5"; "" for none."""
    usual = type(config)()
    return ", ".join(f"{n}={getattr(config, n)}" for n in names if getattr(config, n) != getattr(usual, n))


def noise_label(noise: DepthNoise) -> str:
    """The depth cameras' noise in a table: its kind, and its numbers where it has any."""
    numbers = asdict(noise)
    listed = [f"{name}={value:g}" for name, value in numbers.items() if name != "kind" and value]
    return f"{noise.kind} ({', '.join(listed)})" if listed else noise.kind


def model_label(language: ComponentConfig) -> str:
    """A language model in a table: its name, or else its address, and how it is asked where that is unusual."""
    model = str(getattr(language, "model", "") or "")
    name = Path(model).name.removesuffix(".gguf") or str(getattr(language, "base_url", "") or language.name)
    return described(language, name, only=("temperature", "max_tokens", "extra"))
