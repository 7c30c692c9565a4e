"""The grammar of a language model's program: only skills and objects that fit here, in llama.cpp's form.

A small model that can write nothing else is wrong far less often.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence

from gvla2.planning.contracts import PlanRequest
from gvla2.planning.scene_brief import SceneBrief
from gvla2.programs.faithful import Named
from gvla2.skills.affordances import goals, themes
from gvla2.skills.skill import Skill

LAST = ("pick",)
"""Skills listed last; otherwise small models start every program with them."""
ONTO = ("on", "in")
SIDES = re.compile(r"\b(left|right|behind|front|beside|besides|next|near|nearer|side|by|close|closer)\b")
"""Words of a wish that may mean a side of the goal."""
WAYS_SAID = re.compile(
    r"\b(left|right|forward|forwards|back|backwards?|away|towards?|cm|mm|centimet\w+|millimet\w+|inch\w*)\b"
)
"""Words of a wish that may mean a direction or a distance."""
Fitting = Mapping[str, Mapping[str, Sequence[str]]]
"""By skill, the names of its possible themes, each with the names of its possible goals."""


def fitting(request: PlanRequest, skills: Mapping[str, Skill], brief: SceneBrief) -> Fitting:
    """The skills with a possible theme in the scene, except implied ones."""
    scene, hand, names = request.scene, request.arm.hand, brief.names
    found: dict[str, dict[str, list[str]]] = {}
    for name in sorted((s for s in skills if not skills[s].implied), key=lambda s: s in LAST):
        can = {
            names[o.id]: [names[g.id] for g in goals(skills[name], o, scene)]
            for o in themes(skills[name], scene, hand)
        }
        if skills[name].aimed and not skills[name].free:
            can = {theme: to for theme, to in can.items() if to}
        if can:
            found[name] = can
    return found


def grammar(
    skills: Mapping[str, Skill], can: Fitting, wish: str, named: Sequence[Named] = (), *, most: int = 6
) -> str:
    """llama.cpp's grammar of a program of at most ``most`` calls, one per line, each skill with what it fits.

    Sides of a goal, and directions, are allowed if the wish mentions any. The first call has all that is ``named``, as
    far as such a call exists.
    """
    sides, ways = (bool(words.search(wish.casefold())) for words in (SIDES, WAYS_SAID))
    calls = [
        rule
        for s, each in can.items()
        for theme, to in each.items()
        if (rule := _rule(skills[s], theme, to, sides, ways))
    ]
    first, held = calls, list[Named]()
    for one in named:
        narrowed = [
            rule
            for s, each in can.items()
            for theme, to in each.items()
            if (wanted := _about(s, theme, to, [*held, one])) is not None
            and (rule := _rule(skills[s], theme, wanted, sides, ways, led=wanted is not to))
        ]
        if narrowed:
            first, held = narrowed, [*held, one]
    rules = (
        f'root ::= first ("\\n" call){{0,{most - 1}}} "\\n"?',
        f"first ::= {' | '.join(first)}",
        f"call ::= {' | '.join(calls)}",
        'way ::= "left" | "right" | "forward" | "back"',
        "amount ::= [1-9] [0-9]{0,2}",
    )
    return "\n".join(rules) + "\n"


def _about(skill: str, theme: str, to: Sequence[str], named: Sequence[Named]) -> Sequence[str] | None:
    """The goals with which a call on the theme has all that is named; None if there is no such call."""
    for one in named:
        if one.skills:
            if skill not in one.skills:
                return None
            continue
        if theme in one.about:
            continue
        to = [] if one.handled else [g for g in to if g in one.about]
        if not to:
            return None
    return to


def _rule(skill: Skill, theme: str, to: Sequence[str], sides: bool, ways: bool, *, led: bool = False) -> str:
    """One skill on one theme with its possible goals; "" if it needs a goal and has none. ``led``: the goal is not
    optional, because the wish names it.
    """
    goal, aims = skill.role("goal"), []
    if to and goal is not None:
        relations = [r for r in goal.relations if r in ONTO or (sides and r != "to")]
        how = f' ", " ({_choice(relations)})' if relations and skill.aimed else ""
        aims.append(f'", " ({_choice(to)}){how}')
    if skill.free and skill.aimed and ways:
        aims.append('", " way ", " amount')
    if skill.aimed and not aims:
        return ""
    aim = f" ({' | '.join(aims)})" if aims else ""
    if aim and not skill.aimed and not (led and to):
        aim += "?"
    amount = ' (", " amount)?' if skill.amount and goal is None else ""
    return f'({json.dumps(f"{skill.name}({theme}")}{aim}{amount} ")")'


def _choice(words: Sequence[str]) -> str:
    return " | ".join(json.dumps(w) for w in words)
