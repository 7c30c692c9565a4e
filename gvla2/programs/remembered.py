"""Remembered paths: successes with the names and sizes of now, to show to a planner that writes waypoints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from gvla2.errors import PlanningError
from gvla2.planning.calls import SkillOptions
from gvla2.planning.colours import FAMILIES
from gvla2.planning.contracts import PlanRequest
from gvla2.planning.programs import told
from gvla2.planning.scene_brief import SceneBrief
from gvla2.programs.waypoints import path_of, read_steps, written
from gvla2.skills.lifting import lift
from gvla2.skills.mentions import may_mean, roles_said


@dataclass(frozen=True)
class Remembered:
    """A path that succeeded before, with the present ``names`` in order, and the ``task`` that it was for."""

    task: str
    steps: tuple[tuple[Any, ...], ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its things, in order."""
        return tuple(dict.fromkeys(p for step in self.steps for p in step[:2] if isinstance(p, str)))


def remembered_paths(
    request: PlanRequest, brief: SceneBrief, programs: int, options: SkillOptions
) -> list[Remembered]:
    """At most so many successes in the most similarly worded tasks, the most similar last, next to the question.

    Only paths of skills that the instruction's verb may mean, whose roles things in the scene can fill: the moved
    object and the goal that it names, if any; and only those that pass the checks here. What passed them in another
    scene need not do so in this one, and a small model repeats what it is shown. All those shown are of one skill.
    """
    wish, scene = request.instruction, request.scene
    said = roles_said(wish, scene)
    found: list[tuple[float, str, Remembered]] = []
    for place, program in enumerate(request.advice.programs):
        if program.language != "waypoints" or not may_mean(program.skill, wish):
            continue
        steps = told(program, scene, brief.names, wish, said)
        if steps is not None:
            alike = _alike(wish, program.instruction) - 0.01 * place  # memory's own order settles ties
            task = " ".join(program.instruction.split())[:400]
            found.append((alike, program.skill, Remembered(task, steps)))
    found.sort(key=lambda each: -each[0])
    ranked = (path for _, skill, path in found if skill == found[0][1])
    return list(islice((p for p in ranked if _leads(p.steps, brief, request, options)), programs))[::-1]


def _alike(wish: str, other: str) -> float:
    """The share of words that both have in common, ignoring colours."""
    mine, theirs = (set(re.findall(r"[a-z]+", text.casefold())) - set(FAMILIES) for text in (wish, other))
    return len(mine & theirs) / max(1, len(mine | theirs))


def _leads(
    steps: Sequence[Sequence[Any]], brief: SceneBrief, request: PlanRequest, options: SkillOptions
) -> bool:
    """Whether a path can be followed in this scene."""
    try:
        read = read_steps(written(steps), brief.ids, bare=False)
        plan = lift(path_of(read, brief.ids, request.scene, bare=False), request, options)
    except (PlanningError, ValueError):  # it closes on nothing, or is too long
        return False
    return plan.trajectory is not None
