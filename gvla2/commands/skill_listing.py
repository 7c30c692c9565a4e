"""The skills in ``gvla2 plugins``: what every planner may call, with roles, numbers and units."""

from __future__ import annotations

from typing import Any

from gvla2.catalog import Registry
from gvla2.commands.tables import console, row, table
from gvla2.errors import UnknownComponentError
from gvla2.skills.skill import Skill

SKILL = "skill"
"""The word for them, in the place of a kind: all are offered at once, none is chosen."""


def find_skill(registry: Registry, name: str) -> Skill:
    """The skill of that name; raises :class:`UnknownComponentError` with the names that exist."""
    if name not in registry.skills:
        raise UnknownComponentError(SKILL, name, registry.skills)
    return registry.skills[name]


def print_skills(registry: Registry, name: str = "") -> None:
    """All skills as a table, or one with its roles and numbers."""
    out = console()
    listing = table("skill", "called", "what it does", "from")
    for each in registry.skills.values():
        if name in ("", each.name):
            plugin = registry.skill_plugin(each.name)
            origin = f"{plugin.name} ({plugin.origin})" if plugin.origin else plugin.name
            row(listing, each.name, each.signature(), each.description, origin)
    if not registry.skills:
        row(listing, "-", "-", "nothing is offered", "")
    out.print(listing)
    if name:
        one = find_skill(registry, name)
        roles = table("role", "what it is", "needed", "relations")
        for role in one.roles:
            row(roles, role.name, role.meaning, "yes" if role.required else "no", ", ".join(role.relations))
        out.print(roles)
        numbers = table("parameter", "unit", "range", "meaning")
        for p in one.parameters:
            row(numbers, p.name, p.unit or "-", f"{p.least:g} to {p.most:g}", p.meaning)
        out.print(numbers)


def skills_json(registry: Registry, name: str = "") -> list[dict[str, Any]]:
    """The skills as JSON objects, narrowed to a name."""
    return [
        {
            "name": skill.name,
            "signature": skill.signature(),
            "description": skill.description,
            "plugin": registry.skill_plugin(skill.name).name,
            "roles": [
                {"name": r.name, "meaning": r.meaning, "required": r.required, "relations": list(r.relations)}
                for r in skill.roles
            ],
            "parameters": [
                {"name": p.name, "unit": p.unit, "meaning": p.meaning, "range": [p.least, p.most]}
                for p in skill.parameters
            ],
        }
        for skill in registry.skills.values()
        if name in ("", skill.name)
    ]
