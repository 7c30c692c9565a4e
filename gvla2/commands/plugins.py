"""``gvla2 plugins``: what can be chosen, with which options, from where, and what is broken."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import json
import re
import sys
import typing
from collections.abc import Sequence
from typing import Any

from omegaconf import OmegaConf

from gvla2.commands.tables import console, row, table
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, UnknownComponentError
from gvla2.planning.skill import Skill
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.kinds import KINDS
from gvla2.plugins.registry import Offer, Registry, load_plugins
from gvla2.record.text import printable

SKILL = "skill"
"""Skills are listed like a kind, but all of them are available at once: none is chosen."""

EPILOG = f"""\
  gvla2 plugins                 everything that can be chosen
  gvla2 plugins planner         the planners with their options
  gvla2 plugins planner skill   one of them
  gvla2 plugins skill [NAME]    the skills that every planner may call, with their roles and parameters

Kinds: {", ".join(KINDS)}, skill, and those that plugins add.
GVLA2_DISABLE_PLUGINS=name1,name2 skips plugins in every command.
"""


_ROLE = re.compile(r":\w+:`~?(?:[\w.]*\.)?(\w+)`")
"""A reference of the documentation, of which the terminal shows the name."""


@dataclasses.dataclass(frozen=True)
class Option:
    """One option of a component: its dotted name, type and default for display."""

    name: str
    type: str
    default: str


def main(argv: Sequence[str]) -> int:
    """Print the catalog. Broken plugins are reported; the exit status stays 0."""
    parser = argparse.ArgumentParser(
        "gvla2 plugins", epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kind", nargs="?", default="", metavar="KIND")
    parser.add_argument("name", nargs="?", default="", metavar="NAME")
    asked = parser.parse_args(argv)
    registry = load_plugins()
    try:
        kinds = [registry.kind_of(asked.kind).name] if asked.kind not in ("", SKILL) else []
        if asked.name and kinds:
            registry.get(asked.kind, asked.name)
        if asked.name and asked.kind == SKILL and asked.name not in registry.skills:
            raise UnknownComponentError(SKILL, asked.name, registry.skills)
    except ConfigurationError as error:
        print(f"gvla2: {printable(str(error))}", file=sys.stderr)
        return 2
    out = console()
    listing = table("kind", "choice", "what it is", "from")
    for kind in kinds or ([] if asked.kind else registry.kinds):
        for name, offer in registry.offers(kind).items():
            if not asked.name or name == asked.name:
                row(listing, kind, name, offer.component.summary, _origin(offer.plugin))
        listing.add_section()
    if listing.row_count:
        out.print(listing)
    for kind in kinds:
        for name, offer in registry.offers(kind).items():
            if not asked.name or name == asked.name:
                _print_options(kind, offer)
    if asked.kind in ("", SKILL):
        shown = [skill for name, skill in registry.skills.items() if not asked.name or name == asked.name]
        _print_skills(registry, shown, details=bool(asked.name))
    if not asked.kind:
        out.print(
            "`gvla2 plugins KIND` shows the options; `gvla2 run KIND=CHOICE KIND.OPTION=VALUE` sets them."
        )
    if registry.problems:
        troubles = table("broken plugin", "hook", "problem", style="red")
        for problem in registry.problems:
            row(troubles, problem.plugin, problem.hook or "-", problem.message)
        out.print(troubles)
    return 0


def options(config: type) -> list[Option]:
    """The options of a component's dataclass, nested ones by dotted names; ``name`` is not an option."""
    return [option for option in _options(config, OmegaConf.structured(config)) if option.name != "name"]


def _options(config: type, node: Any) -> list[Option]:
    try:
        hints = typing.get_type_hints(config)
    except NameError:  # a type imported for type checkers only
        hints = {}
    defaults: Any = OmegaConf.to_container(node, resolve=False, enum_to_str=True)
    found = []
    for field in dataclasses.fields(config):
        hint, default = hints.get(field.name, field.type), defaults[field.name]
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            nested = _options(hint, node[field.name])
            found += [Option(f"{field.name}.{o.name}", o.type, o.default) for o in nested]
        else:
            plain = isinstance(hint, type) and not typing.get_args(hint)
            shown = "required" if default == "???" else json.dumps(default, ensure_ascii=False)
            name = hint.__name__ if plain else str(hint).replace("typing.", "")
            found.append(Option(field.name, name, shown))
    return found


def _print_options(kind: str, offer: Offer) -> None:
    out, component = console(), offer.component
    needs = f"  needs {', '.join(component.needs)}" if component.needs else ""
    out.print(f"\n{kind}={component.name}{needs}", style="bold", markup=False)
    config = component.config
    for each in config.__mro__[: config.__mro__.index(ComponentConfig)]:
        described = inspect.cleandoc(vars(each).get("__doc__") or "")
        if dataclasses.is_dataclass(each) and not described.startswith(
            f"{each.__name__}("
        ):  # what it writes itself
            out.print(printable(_ROLE.sub(r"\1", described)) + "\n", style="dim", markup=False)
    listing = table("option", "type", "default")
    for option in options(config):
        row(listing, f"{kind}.{option.name}", option.type, option.default)
    out.print(listing if listing.row_count else "no options")


def _print_skills(registry: Registry, skills: Sequence[Skill], *, details: bool) -> None:
    out = console()
    listing = table("skill", "called", "what it does", "from")
    for skill in skills:
        plugin = registry.skills_offered[skill.name][1]
        row(listing, skill.name, skill.signature(), skill.description, _origin(plugin))
    out.print(listing)
    if details:
        roles = table("role", "what it is", "needed", "relations")
        for role in skills[0].roles:
            row(roles, role.name, role.meaning, "yes" if role.required else "no", ", ".join(role.relations))
        parameters = table("parameter", "unit", "range", "meaning")
        for p in skills[0].parameters:
            row(parameters, p.name, p.unit or "-", f"{p.least:g} to {p.most:g}", p.meaning)
        out.print(roles, parameters)


def _origin(plugin: Plugin) -> str:
    return f"{plugin.name} ({plugin.origin})" if plugin.origin else plugin.name
