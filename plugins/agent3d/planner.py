"""The planner: prompt the model, read its waypoints, lift them into the scene, ask again with the checks' findings."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np

from gvla2.errors import PlanningError
from gvla2.language import LanguageModel, Message, json_in
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.programs import remembered, waypoints_program
from gvla2.planning.scene import Scene
from gvla2.skills.model_planning import Question, nothing_to_ask
from gvla2.skills.path_lifting import MOST_POINTS, PathPoint, lift
from gvla2_plugins.agent3d import Agent3dConfig

EXAMPLE = (
    "tan_sponge 60x50x40\nwhite_bowl 140x140x60 open 130",
    "drop the sponge into the bowl",
    '[["tan_sponge",0,0,100,1],["tan_sponge",0,0,-20,1],["tan_sponge",0,0,-20,0],["tan_sponge",0,0,120,0],'
    '["white_bowl",0,0,100,0],["white_bowl",0,0,20,1]]',
)
"""Objects, task and answer."""
FARTHEST = 1000.0
"""Largest offset, millimetres."""
Step = Sequence[Any]
"""``[name, dx, dy, up, g]`` or ``[name, other, along, up, g]``, millimetres."""
Shown = tuple[str, tuple[Step, ...]]
"""The task and the steps of a remembered path, with the names and lengths of the present scene."""


class Agent3d:
    """Implements :class:`gvla2.planning.contracts.Planner` by a language model's waypoints (paper: 3DAgent)."""

    def __init__(self, config: Agent3dConfig, language: LanguageModel) -> None:
        self.config = config
        self._language = language
        self._options = SkillOptions(speed=config.speed, contact_speed=config.contact_speed)

    def plan(self, request: PlanRequest) -> Plan:
        """A plan along the model's waypoints, or an abstention with the whole conversation.

        Raises :class:`gvla2.language.LanguageModelError` when the model cannot be asked.
        """
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        config, question = self.config, Question(request, positions=False)
        known = self._remembered(question)
        most = max((len(steps) + 1 for _, steps in known), default=MOST_POINTS)
        return question.ask(
            self._language,
            messages(question, known),
            lambda text: self._lifted(read_steps(text, question.brief.ids), question),
            tries=config.tries,
            grammar=grammar(list(question.brief.ids), max_points=most),
            seed=config.explore_seed,
            temperature=config.explore or None,
            max_tokens=config.max_tokens,
        )

    def _lifted(self, steps: Sequence[Step], question: Question) -> Plan:
        request, ids = question.request, question.brief.ids
        plan = lift(path_of(steps, ids, request.scene), request, self._options)
        by_id = [[ids[value] if isinstance(value, str) else value for value in step] for step in steps]
        about = {"roles": plan.roles, "skill": plan.skill, "instruction": request.instruction}
        return replace(plan, program=waypoints_program(by_id, request.scene, **about))

    def _remembered(self, question: Question) -> list[Shown]:
        """At most ``programs`` remembered paths, the best one last, next to the question.

        Only paths that pass the checks in this scene, all of the same skill: a small model repeats what it is shown.
        """
        found: list[Shown] = []
        skill = ""
        for program, task, steps in question.remembered("waypoints"):
            if len(found) == self.config.programs:
                break
            if skill in ("", program.skill) and self._feasible(steps, question):
                skill = program.skill
                found.append((task[:400], steps))
        return found[::-1]

    def _feasible(self, steps: Sequence[Step], question: Question) -> bool:
        """Whether a path can be followed in this scene."""
        try:
            read = read_steps(written(steps), question.brief.ids)
            return self._lifted(read, question).trajectory is not None
        except (PlanningError, ValueError):  # it closes on nothing, or is too long
            return False


def messages(question: Question, known: Sequence[Shown]) -> list[Message]:
    """The question, after answered examples: one of the format, then remembered paths with present names and sizes.

    Memory's text is enclosed in marks, as data.
    """
    about = {part for _, steps in known for step in steps for part in step if isinstance(part, str)}
    lines = sorted(question.brief.text.splitlines(), key=lambda line: line.partition(" ")[0] not in about)
    objects = "\n".join(lines)  # those of the remembered paths first
    form = files(__package__).joinpath("prompt.md").read_text("utf-8").strip()
    asked: list[Message] = [{"role": "system", "content": form}]
    for seen, task, answer in (EXAMPLE, *((objects, task, written(steps)) for task, steps in known)):
        asked += [
            {"role": "user", "content": _described(seen, task)},
            {"role": "assistant", "content": answer},
        ]
    memory, now = remembered(question.request.advice.text), _described(objects, question.instruction)
    words = filter(None, (memory, question.rejection, now))
    return [*asked, {"role": "user", "content": "\n".join(words)}]


def _described(objects: str, task: str) -> str:
    return f"Objects (name, length x width x height in mm):\n{objects}\nTask: {task}"


def read_steps(text: str, ids: Mapping[str, str]) -> list[Step]:
    """The waypoints of an answer, with names as written. Raises :class:`ValueError` with a sentence for the model."""
    found = json_in(text)
    if isinstance(found, dict):
        found = next((v for v in found.values() if isinstance(v, list)), None)
    if not isinstance(found, list) or not found or not all(isinstance(s, list) for s in found):
        raise ValueError("It is not a list of waypoints, each a list.")
    if len(found) > MOST_POINTS:
        raise ValueError(f"It has {len(found)} waypoints; {MOST_POINTS} at most can be executed.")
    return [_checked(step, ids) for step in found]


def _checked(step: list[Any], ids: Mapping[str, str]) -> Step:
    shown = json.dumps(step)[:80]
    if len(step) != 5:
        raise ValueError(f"{shown} is not a waypoint: it needs five elements.")
    towards = isinstance(step[1], str)
    names, numbers = step[: 1 + towards], step[1 + towards :]
    for name in names:
        if not isinstance(name, str) or name not in ids:
            raise ValueError(f"There is nothing called {json.dumps(name)[:80]}; there are {', '.join(ids)}.")
    if towards and names[0] == names[1]:
        raise ValueError(f"{names[0]} is not on the way to itself.")
    if not all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers):
        raise ValueError(f"{shown} has an element that is neither a name nor a number.")
    if not all(abs(n) <= FARTHEST for n in numbers) or not 0 <= numbers[-1] <= 1:
        raise ValueError(f"{shown} has a number out of range: millimetres, and g from 0 to 1.")
    return step


def written(steps: Sequence[Step]) -> str:
    """Waypoints as an answer has them."""
    return json.dumps(steps, separators=(",", ":"))


def path_of(steps: Sequence[Step], ids: Mapping[str, str], scene: Scene) -> list[PathPoint]:
    """The points of the hand's path, world metres."""
    points = []
    for name, second, third, up, g in steps:
        first = scene[ids[name]]
        if isinstance(second, str):
            direction = (scene[ids[second]].centre - first.centre)[:2]
            offset = 1e-3 * third * direction / max(float(np.linalg.norm(direction)), 1e-9)
        else:
            offset = 1e-3 * np.array([second, third])
        x, y = (float(v) for v in first.centre[:2] + offset)
        points.append(PathPoint((x, y, first.top + 1e-3 * up), float(g), first.id))
    return points


def grammar(names: Sequence[str], *, max_points: int = MOST_POINTS) -> str:
    """llama.cpp's grammar of an answer: a plain list, which takes the fewest tokens, of at most ``max_points``."""
    lines = (
        f'root ::= "[" point ("," point){{1,{max(2, max_points) - 1}}} "]"',
        'point ::= "[" name "," ((int "," int) | (name "," int)) "," int "," [01] "]"',
        f"name ::= {' | '.join(json.dumps(json.dumps(n)) for n in names)}",
        'int ::= "-"? [0-9]{1,3}',
    )
    return "\n".join(lines) + "\n"
