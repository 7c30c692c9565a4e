"""Tasks of the learnable world: a published task whose things behave as their family does."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.planning.colours import colours_in
from gvla2.robot.task import Task, TaskInstance, TaskSite
from gvla2_plugins.tabletop.learnable_ranges import COLOURED, TRAITS, Family, families
from gvla2_plugins.tabletop.learnable_things import CHANGES, NEEDED

if TYPE_CHECKING:
    from gvla2_plugins.tabletop import ScaledConfig


class Learnable:
    """Implements :class:`gvla2.robot.task.Task` over a published one: its layout, sentence and success check, and
    things of one family in the colour and with the property that the world's seed gave them.
    """

    def __init__(self, kind: str, config: ScaledConfig, make: Callable[[ScaledConfig], Task]) -> None:
        if config.world != "learnable":
            raise ConfigurationError(
                f"task.world is '{config.world}'; it is plain or learnable (see docs/learnable_worlds.md)."
            )
        if kind not in TRAITS:
            raise ConfigurationError(
                f"task={kind} has nothing to learn in the learnable world; these have: {', '.join(TRAITS)}."
            )
        if not 1 <= config.families <= len(COLOURED) or not -1 <= config.family < config.families:
            raise ConfigurationError(
                f"task.families lies in [1, {len(COLOURED)}] and task.family in [-1, families), got "
                f"families={config.families}, family={config.family}."
            )
        if config.world_seed < 0:
            raise ConfigurationError(f"task.world_seed is {config.world_seed}; it must not be negative.")
        self.families = families(kind, config.world_seed, config.families)
        self._kind, self._family = kind, config.family
        self._task = make(replace(config, **NEEDED.get(kind, {})))  # type: ignore[arg-type]

    @property
    def instructions(self) -> tuple[str, ...]:
        """The published paraphrases that name the colour: only the colour distinguishes the families."""
        return tuple(said for said in self._task.instructions if "{colour}" in said) or _NAMING[self._kind]

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode, about the family that ``instruction`` names, else the chosen one, else one of all."""
        family = self._chosen(rng, instruction)
        others = [one for one in self.families if one is not family]
        self._rng_sentence = int(rng.integers(len(self.instructions)))
        here = replace(site, colours=(family.colour, *(one.colour for one in others[:1])))
        instance = CHANGES[self._kind](self._task, rng, here, family, others)
        words = dict.fromkeys(("colour",), family.colour) | {"target": _target(instance)}
        sentence = self.instructions[self._rng_sentence].format(**words)
        return replace(
            instance,
            instruction=sentence if instruction is None else instruction,
            goal=f"{instance.goal} (a world with something to learn)",
            solution=None,  # the scripted solution assumes published behaviour
        )

    def _chosen(self, rng: np.random.Generator, instruction: str | None) -> Family:
        drawn = self.families[int(rng.integers(len(self.families)))]
        if self._family >= 0:
            drawn = self.families[self._family]
        said = [one for one in self.families if one.colour in colours_in(instruction or "")]
        return said[0] if len(said) == 1 else drawn


_NAMING = {
    "open_wine": (
        "open the {colour} bottle",
        "unscrew the cap of the {colour} bottle",
        "twist the cap off the {colour} bottle and lift it",
        "take the cap off the {colour} bottle",
    )
}
"""Sentences of kinds whose published ones name no colour."""


def _target(instance: TaskInstance) -> str:
    """The colour of the painted square, "" where there is none."""
    return next((b.label.split()[0] for b in instance.layout.bodies if b.label.endswith(" square")), "")
