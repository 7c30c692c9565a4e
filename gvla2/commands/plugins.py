"""``gvla2 plugins``: what can be chosen, with which options, from where, and what is broken."""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import json
import sys
import typing
from collections.abc import Sequence
from typing import Any

from omegaconf import OmegaConf

from gvla2.commands.tables import console, row, table
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, UnknownComponentError
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.kinds import KINDS
from gvla2.plugins.registry import Offer, Registry, load_plugins
from gvla2.plugins.validation import structured
from gvla2.record.text import printable
from gvla2.skills.skill import Skill

SKILL = "skill"
"""The word for skills, used like a kind: all are available at once, none is chosen."""

EPILOG = f"""\
  gvla2 plugins                 everything that can be chosen
  gvla2 plugins planner         the planners with their options
  gvla2 plugins planner skill   one of them
  gvla2 plugins skill [NAME]    the skills that every planner may call, with their roles and numbers

Kinds: {", ".join(KINDS)}, skill, and those that plugins add.
GVLA2_DISABLE_PLUGINS=name1,name2 skips plugins in every command.
"""


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
    parser.add_argument("--json", action="store_true", help="the same for programs")
    asked = parser.parse_args(argv)
    registry = load_plugins()
    try:
        if asked.kind == SKILL:
            find_skills(registry, asked.name)
        elif asked.kind:
            registry.get(asked.kind, asked.name) if asked.name else registry.kind_of(asked.kind)
    except ConfigurationError as error:
        print(f"gvla2: {printable(str(error))}", file=sys.stderr)
        return 2
    if asked.json:
        print(json.dumps(as_json(registry, asked.kind, asked.name), indent=2))
    elif asked.kind == SKILL:
        _print_skills(registry, asked.name)
    else:
        _print(registry, asked.kind, asked.name)
    return 0


def options(config: type) -> list[Option]:
    """The options of a component's dataclass, nested ones by dotted names; ``name`` is not an option."""
    return [option for option in _options(config, OmegaConf.structured(config)) if option.name != "name"]


def _options(config: type, node: Any) -> list[Option]:
    try:
        hints = typing.get_type_hints(config)
    except NameError:  # a type imported for type checkers only
        hints = {}
    defaults = OmegaConf.to_container(node, resolve=False, enum_to_str=True)
    assert isinstance(defaults, dict)
    found = []
    for field in dataclasses.fields(config):
        hint = hints.get(field.name, field.type)
        if isinstance(hint, type) and dataclasses.is_dataclass(hint):
            nested = _options(hint, node[field.name])
            found += [Option(f"{field.name}.{o.name}", o.type, o.default) for o in nested]
        else:
            default = defaults[field.name]
            shown = "required" if default == "???" else json.dumps(default, ensure_ascii=False)
            found.append(Option(field.name, _type_name(hint), shown))
    return found


def as_json(registry: Registry, kind: str = "", name: str = "") -> dict[str, Any]:
    """The catalog as a JSON object, narrowed to a kind and a name."""
    return {
        "components": {
            k: [_offer_json(o) for n, o in registry.offers(k).items() if name in ("", n)]
            for k in ([kind] if kind else registry.kinds)
            if k != SKILL
        },
        "skills": [_skill_json(registry, s) for s in find_skills(registry, name)]
        if kind in ("", SKILL)
        else [],
        "plugins": [dataclasses.asdict(plugin) for plugin in registry.plugins],
        "problems": [dataclasses.asdict(problem) for problem in registry.problems],
    }


def _offer_json(offer: Offer) -> dict[str, Any]:
    component = offer.component
    defaults = OmegaConf.to_container(structured(component), resolve=False, enum_to_str=True)
    return {
        "name": component.name,
        "summary": component.summary,
        "plugin": dataclasses.asdict(offer.plugin),
        "needs": list(component.needs),
        "options": [dataclasses.asdict(option) for option in options(component.config)],
        "defaults": defaults,
    }


def _print(registry: Registry, kind: str, name: str) -> None:
    out = console()
    listing = table("kind", "choice", "what it is", "from")
    for k in [kind] if kind else registry.kinds:
        offers = {n: o for n, o in registry.offers(k).items() if name in ("", n)}
        for n, offer in offers.items():
            row(listing, k, n, offer.component.summary, _origin(offer.plugin))
        if not offers:
            row(listing, k, "-", "nothing is offered", "")
        listing.add_section()
    out.print(listing)
    if kind:
        for n, offer in registry.offers(kind).items():
            if name in ("", n):
                _print_options(out, kind, n, offer)
    else:
        _print_skills(registry)
        out.print(
            "`gvla2 plugins KIND` shows the options; `gvla2 run KIND=CHOICE KIND.OPTION=VALUE` sets them."
        )
    if registry.problems:
        out.print()
        troubles = table("broken plugin", "hook", "problem", style="red")
        for problem in registry.problems:
            row(troubles, problem.plugin, problem.hook or "-", problem.message)
        out.print(troubles)


def _print_options(out: Any, kind: str, name: str, offer: Offer) -> None:
    rows = options(offer.component.config)
    needs = ", ".join(offer.component.needs)
    out.print(f"\n[bold]{kind}={name}[/bold]{'  needs ' + needs if needs else ''}")
    config = offer.component.config
    described = "" if config is ComponentConfig else inspect.getdoc(config) or ""
    if described and not described.startswith(f"{config.__name__}("):  # dataclass's own words
        out.print(printable(described), style="dim", markup=False)
    if not rows:
        out.print("no options", style="dim")
        return
    listing = table("option", "type", "default")
    for option in rows:
        row(listing, f"{kind}.{option.name}", option.type, option.default)
    out.print(listing)


def _origin(plugin: Plugin) -> str:
    return f"{plugin.name} ({plugin.origin})" if plugin.origin else plugin.name


def find_skills(registry: Registry, name: str = "") -> list[Skill]:
    """The skill of that name, or all; raises :class:`UnknownComponentError` with the names that exist."""
    if name and name not in registry.skills:
        raise UnknownComponentError(SKILL, name, registry.skills)
    return [registry.skills[name]] if name else list(registry.skills.values())


def _print_skills(registry: Registry, name: str = "") -> None:
    out = console()
    skills = find_skills(registry, name)
    listing = table("skill", "called", "what it does", "from")
    for each in skills:
        row(listing, each.name, each.signature(), each.description, _origin(registry.skill_plugin(each.name)))
    if not skills:
        row(listing, "-", "-", "nothing is offered", "")
    out.print(listing)
    if name:
        roles = table("role", "what it is", "needed", "relations")
        for role in skills[0].roles:
            row(roles, role.name, role.meaning, "yes" if role.required else "no", ", ".join(role.relations))
        numbers = table("parameter", "unit", "range", "meaning")
        for p in skills[0].parameters:
            row(numbers, p.name, p.unit or "-", f"{p.least:g} to {p.most:g}", p.meaning)
        out.print(roles, numbers)


def _skill_json(registry: Registry, skill: Skill) -> dict[str, Any]:
    return {
        "name": skill.name,
        "signature": skill.signature(),
        "description": skill.description,
        "plugin": registry.skill_plugin(skill.name).name,
        "roles": [dataclasses.asdict(role) for role in skill.roles],
        "parameters": [
            {"name": p.name, "unit": p.unit, "meaning": p.meaning, "range": [p.least, p.most]}
            for p in skill.parameters
        ],
    }


def _type_name(hint: Any) -> str:
    return (
        hint.__name__
        if isinstance(hint, type) and not typing.get_args(hint)
        else str(hint).replace("typing.", "")
    )
