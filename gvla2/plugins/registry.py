"""The catalog of everything on offer: look up by kind and name, build from a configuration."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from gvla2.component import PROJECT, Component, ComponentConfig
from gvla2.errors import ConfigurationError, Gvla2Error, PluginError, UnknownComponentError, kept_alive
from gvla2.hookspecs import SKILL_HOOK
from gvla2.planning.skill import Skill
from gvla2.plugins.discovery import DISABLE_VARIABLE, Plugin, PluginProblem, describe, discover
from gvla2.plugins.kinds import KINDS, NONE, OWN_TASK, SLOTS, Kind, kind_of
from gvla2.plugins.manager import collect, structured


@dataclass(frozen=True)
class Offer:
    """A component and the plugin that offers it."""

    component: Component[Any]
    plugin: Plugin


@dataclass(frozen=True, eq=False, repr=False)
class Registry:
    """All components by kind and name, and skills by name, made by :func:`load_plugins`; there is no global one.

    ``kinds`` lists those of the core, then those that plugins declare.
    """

    components_offered: Mapping[str, Mapping[str, Offer]]
    plugins: Sequence[Plugin] = ()
    problems: Sequence[PluginProblem] = ()
    search_paths: Sequence[str] = ()
    skills_offered: Mapping[str, tuple[Skill, Plugin]] = field(default_factory=dict)
    kinds: Mapping[str, Kind] = field(default_factory=lambda: KINDS)

    @property
    def groups(self) -> dict[str, Kind]:
        """The Hydra groups that choose among components, slots too, each with its kind."""
        return {**self.kinds, **{slot: self.kinds[kind] for slot, kind in SLOTS.items()}}

    def kind_of(self, group: str) -> Kind:
        """The kind that a Hydra group chooses from; raises :class:`ConfigurationError` with the names that exist."""
        return kind_of(SLOTS.get(group, group), self.kinds)

    @property
    def skills(self) -> dict[str, Skill]:
        """Every skill on offer, by name, in the order in which plugins were found."""
        return {name: skill for name, (skill, _) in self.skills_offered.items()}

    def offers(self, kind: str) -> dict[str, Offer]:
        """Components with their plugins, by name, sorted."""
        return dict(sorted(self.components_offered.get(self.kind_of(kind).name, {}).items()))

    def components(self, kind: str) -> dict[str, Component[Any]]:
        """Components by name, sorted."""
        return {name: offer.component for name, offer in self.offers(kind).items()}

    def get(self, kind: str, name: str) -> Component[Any]:
        """The component; raises :class:`UnknownComponentError`, which names what exists and what is broken."""
        offers = self.offers(kind)
        if name not in offers:
            raise UnknownComponentError(kind, name, offers, self.broken_note(kind))
        return offers[name].component

    def broken_note(self, kind: str) -> str:
        """The note on broken and skipped plugins when a component of the kind is missing; "" without any."""
        own = self.kind_of(kind).hook
        others = {SKILL_HOOK, DISABLE_VARIABLE, *(each.hook for each in self.kinds.values())} - {own}
        broken = [each for each in self.problems if each.hook not in others]  # of a misspelt hook too
        why = "; ".join(
            f"{each.plugin}, {f'{each.hook} {each.message}'.strip().rstrip('.')}" for each in broken
        )
        note = f"Broken plugins that might have offered it: {why}." if broken else ""
        skipped = os.environ.get(DISABLE_VARIABLE)
        return f"{note} {DISABLE_VARIABLE} skips: {skipped}.".strip() if skipped else note

    def build(self, root: object, kind: str, built: dict[str, Any] | None = None) -> Any:
        """Build the component that ``root`` chose for ``kind``, after the components it needs.

        ``root`` is a composed configuration (a dataclass, a DictConfig or a mapping) with a field for each kind; the
        field's ``name`` chooses. A slot (:data:`~gvla2.plugins.kinds.SLOTS`) may stand for a kind; it gives None
        where it chose ``none``. Raises :class:`UnknownComponentError`, :class:`ConfigurationError` for a wrong option
        or circular needs, and :class:`PluginError` for a component that fails or breaks its protocol; a
        :class:`Gvla2Error` of the component itself passes through. ``built`` as for :meth:`build_all`.
        """
        return self.build_all(root, (kind,), built)[kind]

    def build_all(
        self, root: object, kinds: Iterable[str], built: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        """Like :meth:`build` for several kinds; a component that two of them need is built once.

        ``built`` holds existing components by kind, and gets all that are built here, the needed ones too. After a
        failure the components built here are closed if they have a ``close``.
        """
        built = {} if built is None else built
        before = len(built)
        try:
            return {kind: self._build(root, kind, (), built) for kind in kinds}
        except BaseException:
            for made in reversed(list(built.values())[before:]):
                close = getattr(made, "close", None)
                if callable(close):
                    close()
            raise

    def _build(self, root: object, kind: str, path: tuple[str, ...], built: dict[str, Any]) -> Any:
        if kind in built:
            return built[kind]
        if self.chooses_nothing(root, kind):
            built[kind] = None
            return None
        if kind in path:
            circle = " -> ".join((*path[path.index(kind) :], kind))
            raise ConfigurationError(f"These components need each other in a circle: {circle}.")
        if kind == "task" and (task := self._task_of_robot(root, path, built)):
            built[kind] = task
            return task
        config, component = self.configure(root, kind)
        needs = {need: self._build(root, need, (*path, kind), built) for need in component.needs}
        own = self.kind_of(kind)
        plugin = self.offers(kind)[component.name].plugin
        what = f"The {kind} '{component.name}' of plugin '{plugin.name}'"
        try:
            with kept_alive():
                made = component.build(config, **needs)
        except Gvla2Error:
            raise
        except Exception as error:
            raise PluginError(f"{what} could not be built: {describe(error)}") from error
        # gvla2's own are type-checked; the protocol's package need not be imported for them.
        lacking = [] if plugin.distribution == PROJECT else own.missing(made)
        if lacking:
            raise PluginError(f"{what} built a {type(made).__name__}, which lacks {', '.join(lacking)}.")
        built[kind] = _checked(made, config, what) if own.name == "task" else made
        return built[kind]

    def _task_of_robot(self, root: object, path: tuple[str, ...], built: dict[str, Any]) -> str:
        """The chosen task's name if the robot offers it; "" for a task of the catalog.

        A robot that offers tasks lays out no others: raises :class:`UnknownComponentError`, which names some of them.
        """
        from gvla2.robot.backend import OffersTasks

        name, robot = self.chosen(root, "task"), built.get("robot")
        if OWN_TASK in name:
            robot = self._build(root, "robot", (*path, "task"), built)
        offered = robot.tasks() if isinstance(robot, OffersTasks) else {}
        if name in offered or not (offered or OWN_TASK in name):
            return name if name in offered else ""
        who = self.chosen(root, "robot")
        note = f"`gvla2 tasks robot={who}` lists the tasks of this robot." if offered else ""
        raise UnknownComponentError(f"task of robot '{who}'", name, offered, note)

    def configure(self, root: object, kind: str) -> tuple[ComponentConfig, Component[Any]]:
        """The typed options that ``root`` holds for ``kind``, and the component they configure."""
        own = self.kind_of(kind).name
        node, name = self._choice(root, kind), self.chosen(root, kind)
        if not name:
            raise ConfigurationError(f"The configuration chooses no {kind}. Choose one with {kind}=NAME.")
        component = self.get(own, name)
        if isinstance(node, component.config):
            return node, component
        if dataclasses.is_dataclass(node):
            raise ConfigurationError(
                f"The {kind} '{name}' takes a {component.config.__name__}, not a {type(node).__name__}."
            )
        given = OmegaConf.create({"name": name}) if isinstance(node, str) else node
        try:
            typed = OmegaConf.to_object(OmegaConf.merge(structured(component), given))
        except OmegaConfBaseException as error:
            known = ", ".join(field.name for field in dataclasses.fields(component.config)[1:])
            raise ConfigurationError(
                f"The {kind} '{name}' is configured wrongly: {str(error).partition(chr(10))[0]}. "
                f"Its options: {known or 'none'}."
            ) from error
        assert isinstance(typed, ComponentConfig)
        return typed, component

    def chosen(self, root: object, kind: str) -> str:
        """The name that ``root`` chooses for ``kind``; "" for none at all."""
        node = self._choice(root, kind)
        if isinstance(node, Mapping | DictConfig):
            node = node.get("name")
        name = node if isinstance(node, str) else getattr(node, "name", None)
        return name if isinstance(name, str) else ""

    def chooses_nothing(self, root: object, kind: str) -> bool:
        """Whether ``root`` leaves a slot empty, or chooses ``none`` of a kind that has no component of that name."""
        name, own = self.chosen(root, kind), self.kinds.get(kind)
        if kind in SLOTS:
            return name in ("", NONE)
        return own is not None and own.may_be_none and name == NONE and NONE not in self.offers(kind)

    def _choice(self, root: object, kind: str) -> Any:
        """The entry of ``root`` for the kind; a command's configuration may not know kinds that plugins declare."""
        node = root.get(kind) if isinstance(root, Mapping | DictConfig) else getattr(root, kind, None)
        return self.kinds[kind].default if node is None and kind in self.kinds and kind not in KINDS else node


def load_plugins(groups: Collection[str] | None = None) -> Registry:
    """Find the installed and the registered plugins and list what they offer; a broken one never makes it fail.

    ``groups`` are the Hydra groups to load, all by default: a command that needs few starts faster.

    Of two components of one kind and name, and of two skills of one name, the first in the order of pluggy's calls wins
    (see :mod:`gvla2.hookspecs`); the other is reported as a problem.
    """
    problems: list[PluginProblem] = []
    found = collect(discover(problems), problems, groups)
    offers: dict[str, dict[str, Offer]] = {}
    for kind, offered in found.components.items():
        wins = _first_of_each_name(offered, found.kinds[kind].hook, problems)
        offers[kind] = {name: Offer(component, plugin) for name, (component, plugin) in wins.items()}
    skills = _first_of_each_name(found.skills, SKILL_HOOK, problems)
    return Registry(offers, found.plugins, tuple(problems), tuple(found.search_paths), skills, found.kinds)


def _first_of_each_name(
    offered: Iterable[tuple[Any, Plugin]], hook: str, problems: list[PluginProblem]
) -> dict[str, tuple[Any, Plugin]]:
    first: dict[str, tuple[Any, Plugin]] = {}
    for item, plugin in offered:
        if item.name in first:
            owner = first[item.name][1].name
            message = f"'{item.name}' is already offered by plugin '{owner}', which wins. Rename this one."
            problems.append(PluginProblem(plugin.name, hook, message))
        else:
            first[item.name] = item, plugin
    return first


def _checked(task: Any, config: ComponentConfig, who: str) -> Any:
    """The task, its episodes checked, among the distractors that its options ask for."""
    from gvla2.robot.clutter import cluttered
    from gvla2.robot.task import CheckedTask

    return cluttered(CheckedTask(task, who), config)
