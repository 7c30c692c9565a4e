"""Chaining: which of a program's calls make one plan.

Picking an object up and then placing it is one placement; several placements into containers are one trajectory if it
is short enough. Any other call is planned alone, so that the robot looks again before the next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Abstention
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.meaning import meant, whole_meant

MOST = 3
"""Most objects in one trajectory: it has at most 20 waypoints, and each object takes six."""
WIDE = 0.06
"""A container's opening is wider than this, metres, so that objects fit side by side."""
INTO = ("", "on", "in", "to")


@dataclass(frozen=True)
class Part:
    """Calls that make one plan. Each call ``took`` so many calls of the program, and is the k-th of n with its goal."""

    calls: tuple[SkillCall, ...]
    took: tuple[int, ...]
    shares: tuple[tuple[int, int], ...]


def first_part(program: Sequence[SkillCall], scene: Scene) -> Part:
    """The first part of a program, of which all skills and objects exist."""
    calls: list[SkillCall] = []
    took: list[int] = []
    at = 0
    while at < len(program) and len(calls) < MOST:
        call, count = _merged(program[at:], scene)
        if calls and not _goes_along(call, calls, scene):
            break
        calls.append(call)
        took.append(count)
        at += count
        if not _fills(call, scene):
            break
    goals = [c.goal for c in calls]
    shares = tuple((goals[:k].count(g), goals.count(g)) if g else (0, 1) for k, g in enumerate(goals))
    return Part(tuple(calls), tuple(took), shares)


def _merged(rest: Sequence[SkillCall], scene: Scene) -> tuple[SkillCall, int]:
    """The first call, merged with the next if that places what the first one picks, and the number of calls used."""
    first = rest[0]
    if len(rest) < 2 or rest[1].skill != "place" or first.goal or first.xy or first.direction:
        return first, 1
    what, then = meant(first, scene), rest[1]
    if isinstance(what, Abstention) or what.skill not in ("pick", "twist", "draw"):
        return first, 1
    same = {first.theme, what.theme.id}
    if what.skill == "pick":
        same |= {whole_meant(scene[i], scene).id for i in same}
        same |= {i for i in [then.theme] if whole_meant(scene[i], scene).id in same}
    if then.theme not in same:
        return first, 1
    theta = {**first.theta, **then.theta}
    if what.skill == "pick":
        theta.pop("lift_height", None)  # placing has its own lift
        return replace(then, theta=theta), 2
    return replace(then, skill=what.skill, theme=what.theme.id, theta=theta), 2


def _goes_along(call: SkillCall, calls: Sequence[SkillCall], scene: Scene) -> bool:
    """Whether a call can be planned without looking again: it fills a container, too, and moves another object."""
    themes, goals = {c.theme for c in calls}, {c.goal for c in calls}
    return _fills(call, scene) and call.theme not in themes | goals and call.goal not in themes


def _fills(call: SkillCall, scene: Scene) -> bool:
    return (
        call.skill == "place" and call.relation in INTO and bool(call.goal) and is_container(scene[call.goal])
    )


def is_container(thing: SceneObject) -> bool:
    """Whether it is for putting things into: open at the top, and lower than wide."""
    wide = float(thing.extents[:2].min())
    whole = thing.shape != "region" and not thing.parent
    return whole and thing.opening > WIDE and thing.top - thing.bottom < wide
