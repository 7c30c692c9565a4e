"""The requested arms of the robot and agents suites: plain names, or variants with their own options."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import given_options, options_of
from gvla2.errors import ConfigurationError
from gvla2.evaluation.robot.design import CONTROLS, MEMORY_OF
from gvla2.plugins.registry import Registry, nothing_in

MEMORY = ("memory", "retriever", "embedder", "inducer", "judge")
WITHOUT_BANK = ("off", "none", "best_theta")
"""Sources of arms that are not memories with a bank."""


@dataclass(frozen=True)
class BenchArm:
    """One arm: its ``name``, source and configuration.

    ``source`` is ``off``, ``best_theta``, ``shuffled`` or the name of a memory; ``options`` are the memory's;
    ``replan`` further attempts are allowed in an episode, None for the bench's number. ``explored`` is how many of the
    explored layouts of a row it learns from, None for all.
    """

    name: str
    source: str
    options: Mapping[str, Any] = field(default_factory=dict)
    replan: int | None = None
    explored: int | None = None

    @property
    def memory(self) -> str:
        """The name of the memory component."""
        return "none" if self.source == "off" else MEMORY_OF.get(self.source, self.source)

    @property
    def variant(self) -> str:
        """How it differs from the plain arm of its name: "governed, admission=False"; "" if it does not."""
        plain = self.source == self.name or MEMORY_OF.get(self.name) == self.source
        told = [] if plain else [self.source]
        told += [f"{name}={value}" for name, value in sorted(self.options.items())]
        counts = (("replan", self.replan), ("explored", self.explored))
        return ", ".join([*told, *(f"{name}={value}" for name, value in counts if value is not None)])


def arms_of(config: BenchConfig) -> list[BenchArm]:
    """The arms of a bench in order: names of ``config.arms``, some of which ``config.own_arms`` defines."""
    return [arm_named(config, name) for name in config.chosen_arms]


def arm_named(config: BenchConfig, name: str) -> BenchArm:
    """One arm by its name; raises :class:`ConfigurationError` if its value is not a mapping of options."""
    given = config.own_arms.get(name) or {}
    if not isinstance(given, Mapping):
        raise ConfigurationError(f"arms.{name} is {given!r}; give options: arms.{name}={{memory: governed}}.")
    told = dict(given)
    source = str(told.pop("memory", MEMORY_OF.get(name, name) if name != "shuffled" else name))
    counts = {count: told.pop(count, None) for count in ("replan", "explored")}
    for count, value in counts.items():
        if value is not None and (not isinstance(value, int) or isinstance(value, bool) or value < 0):
            raise ConfigurationError(f"arms.{name}.{count} is {value!r}; it is a count, 0 or more.")
    return BenchArm(name, source, told, **counts)


def check_arms(config: BenchConfig, registry: Registry) -> None:
    """Raises :class:`ConfigurationError` for an arm, a memory or an option that does not exist."""
    memories = registry.components("memory")
    for arm in arms_of(config):
        if arm.source not in CONTROLS and arm.source not in memories:
            there = ", ".join(dict.fromkeys([*CONTROLS, *MEMORY_OF, *memories]))
            raise ConfigurationError(
                f"No arm '{arm.source}'. Available: {there}; or a variant of one of them with a name of its own: "
                f"arms.NAME={{memory: governed, admission: false}}."
            )
        if arm.source in ("off", "none") and arm.explored is not None:
            raise ConfigurationError(
                f"arms.{arm.name}.explored does nothing: '{arm.source}' learns from nothing."
            )
        known = [] if arm.source in WITHOUT_BANK else options_of(registry, "memory", arm.memory)
        own = {*known, "replan", "explored"} - {"url"}
        given_options(f"arms.{arm.name}", arm.options, f"'{arm.source}'", own)


def has_bank(registry: Registry, arm: BenchArm) -> bool:
    """Whether the arm's memory keeps its bank in a configurable file."""
    return arm.source not in WITHOUT_BANK and "url" in options_of(registry, "memory", arm.memory)


def chosen_memory(config: BenchConfig, registry: Registry, arm: BenchArm, bank: str) -> dict[str, Any]:
    """What to build for an arm's memory; one that has a ``url`` option keeps its bank in the file ``bank``."""
    options = {"name": arm.memory, **arm.options}
    if has_bank(registry, arm):
        options |= {"url": f"sqlite:///{bank}"}
    return {
        **{kind: getattr(config, kind) for kind in (*MEMORY[1:], "verifier", "language")},
        "memory": options,
    }


def configured(registry: Registry, root: Mapping[str, Any], kinds: Iterable[str]) -> list[Any]:
    """The typed options of the kinds (empty slots have none), and of the language model if one of them asks it."""
    found = [registry.configure(root, kind) for kind in kinds if not nothing_in(root, kind)]
    asking = any("language" in component.needs for _, component in found)
    return [options for options, _ in (*found, *([registry.configure(root, "language")] if asking else []))]
