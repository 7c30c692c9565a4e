"""Programs of waypoints as language models write them: their grammar, schema and positions, and remembered ones."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gvla2.errors import PlanningError
from gvla2.language import json_in
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import PlanRequest
from gvla2.planning.programs import adapted
from gvla2.planning.scene import Scene
from gvla2.planning.scene_brief import SceneBrief
from gvla2.skills.path_lifting import MOST_POINTS, PathPoint, lift

FARTHEST = 1000.0
"""Largest offset, millimetres."""
Step = list[Any]


@dataclass(frozen=True)
class RememberedPath:
    """A path that succeeded before, with the names and lengths of the present scene, and its ``task``."""

    task: str
    steps: tuple[tuple[Any, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its objects, in order."""
        return tuple(dict.fromkeys(p for step in self.steps for p in step[:2] if isinstance(p, str)))


def remembered_paths(
    request: PlanRequest, brief: SceneBrief, programs: int, options: SkillOptions
) -> list[RememberedPath]:
    """At most ``programs`` remembered paths, the best one last, next to the question.

    Only paths that pass the checks in this scene, all of the same skill: a small model repeats what it is shown.
    """
    found: list[RememberedPath] = []
    skill = ""
    for program in request.advice.programs:
        if len(found) == programs:
            break
        if program.language != "waypoints" or skill not in ("", program.skill):
            continue
        steps = adapted(program, request.scene, brief.names, request.instruction)
        if steps is not None and _feasible(steps, brief, request, options):
            skill = program.skill
            found.append(RememberedPath(" ".join(program.instruction.split())[:400], steps))
    return found[::-1]


def _feasible(
    steps: Sequence[Sequence[Any]], brief: SceneBrief, request: PlanRequest, options: SkillOptions
) -> bool:
    """Whether a path can be followed in this scene."""
    try:
        read = read_steps(written(steps), brief.ids, bare=False)
        plan = lift(path_of(read, brief.ids, request.scene, bare=False), request, options)
    except (PlanningError, ValueError):  # it closes on nothing, or is too long
        return False
    return plan.trajectory is not None


def read_steps(text: str, ids: Mapping[str, str], *, bare: bool) -> list[Step]:
    """The waypoints of an answer, with names as written. Raises :class:`ValueError` with a sentence for the model."""
    found = json_in(text)
    if isinstance(found, dict):
        found = next((v for v in found.values() if isinstance(v, list)), None)
    if not isinstance(found, list) or not found or not all(isinstance(s, list) for s in found):
        raise ValueError("It is not a list of waypoints, each a list.")
    if len(found) > MOST_POINTS:
        raise ValueError(f"It has {len(found)} waypoints; {MOST_POINTS} at most can be carried out.")
    return [_bare(step) if bare else _relative(step, ids) for step in found]


def written(steps: Sequence[Sequence[Any]]) -> str:
    """Waypoints as an answer has them."""
    return json.dumps(steps, separators=(",", ":"))


def path_of(steps: Sequence[Step], ids: Mapping[str, str], scene: Scene, *, bare: bool) -> list[PathPoint]:
    """The points of the hand's path, world metres."""
    if bare:
        return [
            PathPoint((1e-3 * x, 1e-3 * y, scene.table_height + 1e-3 * z), float(g)) for x, y, z, g in steps
        ]
    points = []
    for name, second, third, up, g in steps:
        first = scene[ids[name]]
        at = np.array([*first.centre[:2], first.top + 1e-3 * up])
        if isinstance(second, str):
            direction = (scene[ids[second]].centre - first.centre)[:2]
            at[:2] += 1e-3 * third * direction / max(float(np.linalg.norm(direction)), 1e-9)
        else:
            at[:2] += 1e-3 * np.array([second, third])
        x, y, z = (float(v) for v in at)
        points.append(PathPoint((x, y, z), float(g), first.id))
    return points


def with_ids(steps: Sequence[Step], ids: Mapping[str, str]) -> list[Step]:
    """The steps with scene ids instead of names."""
    return [[ids[value] if isinstance(value, str) else value for value in step] for step in steps]


def schema(names: Sequence[str], *, bare: bool) -> dict[str, Any]:
    """JSON schema of an answer."""
    number = {"type": "integer", "minimum": -FARTHEST, "maximum": FARTHEST}
    name = {"type": "string", "enum": list(names)}
    hand = {"type": "integer", "enum": [0, 1]}
    forms = (
        [[number, number, number, hand]]
        if bare
        else [[name, number, number, number, hand], [name, name, number, number, hand]]
    )
    waypoints = [
        {"type": "array", "prefixItems": form, "minItems": len(form), "maxItems": len(form), "items": False}
        for form in forms
    ]
    items = waypoints[0] if bare else {"anyOf": waypoints}
    return {
        "type": "object",
        "properties": {"path": {"type": "array", "items": items, "minItems": 2, "maxItems": MOST_POINTS}},
        "required": ["path"],
        "additionalProperties": False,
    }


def grammar(names: Sequence[str], *, bare: bool, max_points: int = MOST_POINTS) -> str:
    """llama.cpp's grammar of an answer: a plain list, which takes the fewest tokens, of at most ``max_points``."""
    rest = '((int "," int) | (name "," int)) "," int "," [01] "]"'
    if bare:
        points = ['point ::= "[" int "," int "," int "," [01] "]"']
    else:
        name = " | ".join(json.dumps(json.dumps(n)) for n in names)
        points = [f'point ::= "[" name "," {rest}', f"name ::= {name}"]
    root = f'root ::= "[" point ("," point){{1,{max(2, max_points) - 1}}} "]"'
    return "\n".join([root, *points, 'int ::= "-"? [0-9]{1,3}']) + "\n"


def _relative(step: Step, ids: Mapping[str, str]) -> Step:
    towards = len(step) == 5 and isinstance(step[1], str)
    names, numbers = step[: 1 + towards], step[1 + towards :]
    if len(step) != 5:
        raise ValueError(f"{_shown(step)} is not a waypoint: it needs five elements.")
    for name in names:
        if not isinstance(name, str) or name not in ids:
            raise ValueError(f"There is nothing called {_shown(name)}; there are {', '.join(ids)}.")
    if towards and names[0] == names[1]:
        raise ValueError(f"{names[0]} is not on the way to itself.")
    return [*names, *_numbers(numbers, step)]


def _bare(step: Step) -> Step:
    if len(step) != 4:
        raise ValueError(f"{_shown(step)} is not a waypoint: it needs x, y, z and g.")
    return _numbers(step, step)


def _numbers(numbers: Sequence[Any], step: Step) -> list[float]:
    if not all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers):
        raise ValueError(f"{_shown(step)} has an element that is neither a name nor a number.")
    if not all(abs(n) <= FARTHEST for n in numbers) or not 0 <= numbers[-1] <= 1:
        raise ValueError(f"{_shown(step)} has a number out of range: millimetres, and g from 0 to 1.")
    return list(numbers)


def _shown(value: Any) -> str:
    return json.dumps(value)[:80]
