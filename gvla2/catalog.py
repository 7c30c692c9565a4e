"""The catalog of everything on offer: look up by kind and name, build from a configuration."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from gvla2.component import Component, ComponentConfig
from gvla2.discovery import DISABLE_VARIABLE, Offering, Plugin, Problem, describe, discover, unannounced
from gvla2.errors import ConfigurationError, Gvla2Error, PluginError, UnknownComponentError
from gvla2.kinds import HOOKS, KINDS, SEARCH_PATH_HOOK, SKILL_HOOK, SLOTS, kind_of
from gvla2.skills.skill import Skill, fault_of

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
REINSTALL = "reinstall it with `pip install -e .`"
_WORDS_OF_HYDRA = frozenset({"null", "true", "false", "nan", "inf"})


@dataclass(frozen=True)
class Offer:
    """A component and the plugin that offers it."""

    component: Component[Any]
    plugin: Plugin


class Registry:
    """All components by kind and name. Made by :func:`load_plugins`; there is no global one."""

    def __init__(
        self,
        offers: Mapping[str, Mapping[str, Offer]],
        plugins: Iterable[Plugin] = (),
        problems: Iterable[Problem] = (),
        search_paths: Iterable[str] = (),
        skills: Iterable[tuple[Skill, Plugin]] = (),
    ) -> None:
        self._offers = {kind: dict(offers.get(kind, {})) for kind in KINDS}
        self.plugins = tuple(plugins)
        self.problems = tuple(problems)
        self.search_paths = tuple(search_paths)
        self._skills = tuple(skills)

    @property
    def skills(self) -> dict[str, Skill]:
        """Every skill that is offered, by name, in the order in which plugins were found."""
        return {skill.name: skill for skill, _ in self._skills}

    def skill_plugin(self, name: str) -> Plugin:
        """Who offers the skill; raises :class:`KeyError` for one that nobody does."""
        return {skill.name: plugin for skill, plugin in self._skills}[name]

    def offers(self, kind: str) -> dict[str, Offer]:
        """Components with their plugins, by name, sorted."""
        return dict(sorted(self._offers[kind_of(kind).name].items()))

    def components(self, kind: str) -> dict[str, Component[Any]]:
        """Components by name, sorted."""
        return {name: offer.component for name, offer in self.offers(kind).items()}

    kind = components

    def get(self, kind: str, name: str) -> Component[Any]:
        """The component; raises :class:`UnknownComponentError`, which names what exists and what is broken."""
        offers = self._offers[kind_of(kind).name]
        if name not in offers:
            raise UnknownComponentError(kind, name, offers, self.broken_note(kind, name))
        return offers[name].component

    def broken_note(self, kind: str, name: str = "") -> str:
        """What to say of broken, skipped and unannounced plugins when a component of the kind is missing.

        ``name`` is the one that was asked for. "" when there is nothing to say.
        """
        hook = kind_of(kind).hook
        known = {*HOOKS, SEARCH_PATH_HOOK, SKILL_HOOK, DISABLE_VARIABLE} - {hook}
        broken = sorted({p.plugin for p in self.problems if p.hook not in known})
        notes = []
        if broken:
            notes.append(
                f"Broken plugins that might have offered it: {', '.join(broken)} (see `gvla2 plugins`)."
            )
        if os.environ.get(DISABLE_VARIABLE):
            notes.append(f"{DISABLE_VARIABLE} skips: {os.environ[DISABLE_VARIABLE]}.")
        if stale := unannounced_offer(kind, name):
            notes.append(
                f"The plugin '{stale}' of gvla2 offers it, but this installation does not announce it, being older "
                f"than the source: {REINSTALL}."
            )
        return " ".join(notes)

    def build(self, root: object, kind: str, built: dict[str, Any] | None = None) -> Any:
        """Build the component that ``root`` chose for ``kind``, after the components it needs.

        ``root`` is a composed configuration (a dataclass, a DictConfig or a mapping) with a field for each kind;
        the field's ``name`` chooses. A slot (:data:`~gvla2.kinds.SLOTS`) may stand for a kind; None is what it holds
        where it chose ``none``. Raises :class:`UnknownComponentError`, :class:`ConfigurationError` for a
        wrong option or a circle of needs, and :class:`PluginError` for a component that fails or breaks its
        protocol; a :class:`Gvla2Error` of the component itself passes through. ``built`` as for :meth:`build_all`.
        """
        return self.build_all(root, (kind,), built)[kind]

    def build_all(
        self, root: object, kinds: Iterable[str], built: dict[str, Any] | None = None
    ) -> dict[str, Any]:
        """Like :meth:`build` for several kinds; a component that two of them need is built once.

        ``built`` holds components that there are already, by kind, and gets all that are built here, the needed ones
        too. After a failure the components built here are closed, where they have a ``close``.
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
        if nothing_in(root, kind):
            built[kind] = None
            return None
        if kind in path:
            circle = " -> ".join((*path[path.index(kind) :], kind))
            raise ConfigurationError(f"These components need one another in a circle: {circle}.")
        config, component = self.configure(root, kind)
        needs = {need: self._build(root, need, (*path, kind), built) for need in component.needs}
        own = SLOTS.get(kind, kind)
        what = f"The {kind} '{component.name}' of plugin '{self._offers[own][component.name].plugin.name}'"
        try:
            made = component.build(config, **needs)
            if own == "task" and made is not None:
                made = _cluttered(made, config)
        except Gvla2Error:
            raise
        except Exception as error:
            raise PluginError(f"{what} could not be built: {describe(error)}") from error
        lacking = kind_of(own).missing(made)
        if lacking:
            raise PluginError(f"{what} built a {type(made).__name__}, which lacks {', '.join(lacking)}.")
        built[kind] = made
        return made

    def configure(self, root: object, kind: str) -> tuple[ComponentConfig, Component[Any]]:
        """The typed options that ``root`` holds for ``kind``, and the component that they are for."""
        own = kind_of(SLOTS.get(kind, kind)).name
        node = _node(root, kind)
        name = node if isinstance(node, str) else _name_in(node)
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
            raise ConfigurationError(f"The {kind} '{name}' is configured wrongly: {error}") from error
        assert isinstance(typed, ComponentConfig)
        return typed, component


def structured(component: Component[Any]) -> DictConfig:
    """The component's options as a typed OmegaConf node, with ``name`` filled in."""
    node = OmegaConf.structured(component.config)
    node.name = component.name
    assert isinstance(node, DictConfig)
    return node


def load_plugins() -> Registry:
    """Find the installed plugins and take stock of what they offer; never fails because of a plugin.

    Of two components of one kind and name the first wins, in the order of :func:`gvla2.discovery.discover`;
    the other is reported as a problem.
    """
    plugins, offerings, problems = discover()
    return assemble(plugins, offerings, problems)


def unannounced_offer(kind: str, name: str) -> str:
    """The plugin of gvla2's own package that offers the component, yet has no entry point here; "" for none.

    Entry points are written when gvla2 is installed; an editable installation does not see later ones.
    """
    if not name:
        return ""
    _, offerings, _ = discover(unannounced())
    return next(
        (
            offering.plugin.name
            for offering in offerings
            if offering.hook == kind_of(kind).hook
            and any(getattr(item, "name", None) == name for item in offering.items)
        ),
        "",
    )


def assemble(
    plugins: Iterable[Plugin], offerings: Iterable[Offering], problems: Iterable[Problem] = ()
) -> Registry:
    """A registry of what hooks returned; what is not fit becomes a problem."""
    found = list(problems)
    offers: dict[str, dict[str, Offer]] = {kind: {} for kind in KINDS}
    paths: list[str] = []
    skills: dict[str, tuple[Skill, Plugin]] = {}
    for offering in offerings:
        for item in offering.items:
            if offering.hook == SEARCH_PATH_HOOK:
                fault = _fault_of_path(item)
                if not fault:
                    paths.append(str(item))
            elif offering.hook == SKILL_HOOK:
                fault = fault_of(item)
                if not fault:
                    assert isinstance(item, Skill)
                    if item.name in skills:
                        owner = skills[item.name][1].name
                        fault = f"'{item.name}' is already offered by plugin '{owner}', which wins. Rename this one."
                    else:
                        skills[item.name] = item, offering.plugin
            else:
                taken = offers[HOOKS[offering.hook].name]
                fault = _fault_of_component(item, HOOKS[offering.hook].name, taken)
                if not fault:
                    assert isinstance(item, Component)
                    taken[item.name] = Offer(item, offering.plugin)
            if fault:
                found.append(Problem(offering.plugin.name, offering.hook, fault))
    return Registry(offers, plugins, found, paths, skills.values())


def _cluttered(task: Any, config: ComponentConfig) -> Any:
    """The task among the distractors that its options ask for."""
    from gvla2.robot.clutter import cluttered

    return cluttered(task, config)


def nothing_in(root: object, kind: str) -> bool:
    """Whether the kind is a slot (:data:`~gvla2.kinds.SLOTS`) that ``root`` leaves empty."""
    return kind in SLOTS and _name_in(_node(root, kind)) in ("", "none")


def _node(root: object, kind: str) -> Any:
    return root.get(kind) if isinstance(root, Mapping | DictConfig) else getattr(root, kind, None)


def _name_in(node: Any) -> str:
    name = node.get("name") if isinstance(node, Mapping | DictConfig) else getattr(node, "name", None)
    return name if isinstance(name, str) else ""


def _fault_of_component(item: object, kind: str, taken: Mapping[str, Offer]) -> str:
    """Why this is not a component to offer, or ""."""
    if not isinstance(item, Component):
        return f"returned {item!r}, which is not a Component."
    name: Any = item.name  # nobody has checked before what a plugin passes
    build: Any = item.build
    if not isinstance(name, str) or not _NAME.fullmatch(name) or name.lower() in _WORDS_OF_HYDRA:
        return f"the name {name!r} cannot be chosen on the command line; use letters, digits, '_' and '-'."
    if not callable(build):
        return f"'{name}' has a build that cannot be called."
    unknown = [need for need in item.needs if need not in KINDS]
    if unknown:
        return f"'{name}' needs {unknown[0]!r}, which is no kind. Kinds: {', '.join(KINDS)}."
    fault = _fault_of_config(item)
    if fault:
        return f"'{name}' cannot be configured: {fault}"
    if name in taken:
        return (
            f"'{name}' is already offered by plugin '{taken[name].plugin.name}', which wins. Rename this one."
        )
    return ""


def _fault_of_config(component: Component[Any]) -> str:
    config: Any = component.config
    if not (isinstance(config, type) and issubclass(config, ComponentConfig)):
        return f"its config is {config!r}, not a dataclass that extends ComponentConfig."
    if "__dataclass_fields__" not in vars(config) and vars(config).get("__annotations__"):
        return f"{config.__name__} is not marked @dataclass, so its own fields would be ignored."
    try:
        structured(component)
    except Exception as error:  # whatever OmegaConf or a default factory raises
        return f"{config.__name__} does not fit OmegaConf: {describe(error)}"
    return ""


def _fault_of_path(item: object) -> str:
    if not isinstance(item, str) or not item.startswith(("pkg://", "file://")):
        return f"returned {item!r}; a search path is a string such as 'pkg://mine.conf' or 'file:///presets'."
    if item.startswith("pkg://"):
        package = item.removeprefix("pkg://").replace("/", ".")
        try:
            exists = find_spec(package) is not None
        except (ImportError, ValueError):
            exists = False
        if not exists:
            return f"the package of the search path '{item}' cannot be found."
    return ""
