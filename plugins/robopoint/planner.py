"""The planner: ask what the instruction is about, have each object and place pointed at, call the skill."""

from __future__ import annotations

import ast
import io
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from PIL import Image

from gvla2.errors import PlanningError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.language import LanguageModel, Message, UnusableAnswerError, ask_typed, json_in, picture
from gvla2.planning.calls import RELATIONS, Relation, SkillCall
from gvla2.planning.contracts import Abstention, Plan, PlanRequest, RefusedError
from gvla2.planning.scene import Scene
from gvla2.planning.skill import Skill
from gvla2.skills.carry_out import carry_out
from gvla2.skills.model_planning import context, instruction_in, nothing_to_ask
from gvla2.skills.table import STANDARD

if TYPE_CHECKING:
    from gvla2_plugins.robopoint import RoboPointConfig

T = TypeVar("T")

SUFFIX = (
    "Your answer should be formatted as a list of tuples, i.e. [(x1, y1), (x2, y2), ...], where each tuple contains "
    "the x and y coordinates of a point satisfying the conditions above. The coordinates should be between 0 and "
    "{scale:g}, indicating the normalized pixel locations of the points in the image."
)
"""RoboPoint's published prompt."""
BESIDES = {
    "beside": "beside", "left_of": "to the left of", "right_of": "to the right of",
    "behind": "behind", "front_of": "in front of",
}  # fmt: skip
"""Relations whose goal is a free place, in the model's training words."""
AGREEMENT = 0.5
"""Share of the points that must lie on one object, or on the free table, to select it."""
LEVEL = 0.02
"""Points on the table are within this of its height, metres."""
LONGEST = 80
"""Maximum number of characters of an object's name."""
MAX_POINTS = 200
"""Maximum number of points in an answer; more mean that the model is repeating itself."""
MAX_CHARACTERS = 20_000
AGREE = 0.015
"""Neighbouring points that are nearer to one another lie on one surface, metres."""
NEIGHBOURS = 9
"""Number of valid pixels used for a depth: a patch of 3 by 3 if none is missing."""
REACH = 12
"""Where depth is missing, it is taken from at most this many pixels away."""

_LIST = re.compile(r"\[\s*\([^\[\]]*\]")


@dataclass(frozen=True)
class PointingTask:
    """A skill's name, the words for the theme, and for the goal if there is one, with its relation."""

    skill: str
    theme: str
    goal: str = ""
    relation: Relation = ""


class RoboPointPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner`; what moves is what a skill proposed and checked."""

    def __init__(self, config: RoboPointConfig, language: LanguageModel) -> None:
        self.config, self._language = config, language

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention; raises :class:`~gvla2.language.LanguageModelError` if no model answers."""
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        said: list[Mapping[str, Any]] = []

        def ask(content: Any, parse: Callable[[str], T]) -> T:
            asked: list[Message] = [{"role": "user", "content": content}]
            tries = self.config.tries
            found = ask_typed(self._language, asked, parse, purpose="plan", tries=tries)
            said.extend(found.transcript)
            return found.answer

        try:
            plan = carry_out((self._call(request, ask),), request)
        except RefusedError as refused:
            plan = Plan(None, abstention=refused.abstention)
        except (PlanningError, UnusableAnswerError) as error:
            said += getattr(error, "transcript", ())
            plan = Plan(None, abstention=Abstention("other", str(error)))
        return replace(plan, transcript=(*said, *plan.transcript))

    def _call(self, request: PlanRequest, ask: Callable[[Any, Callable[[str], Any]], Any]) -> SkillCall:
        """The skill call that the instruction and the picture give; raises :class:`RefusedError`."""
        skills, view = request.skills or STANDARD, request.observation.views[0]

        def point(words: str) -> list[Sighting]:
            text = "\n\n".join([*context(request), f"{words} {SUFFIX.format(scale=self.config.scale)}"])
            shown = [picture(encoded(view, self.config.longest)), {"type": "text", "text": text}]
            seen: list[Sighting] = ask(
                shown, lambda text: sights(text, self.config.scale, view, request.scene)
            )
            return seen

        words = "\n\n".join([*context(request), question(request, skills)])
        task: PointingTask = ask(words, lambda text: read_task(text, skills))
        if task.skill == "none":
            message = f"None of {', '.join(skills)} was seen in the instruction."
            raise RefusedError("unknown_skill", message)
        theme = voted(task.theme, point(f"Locate several points on the {task.theme}."))
        if not task.goal:
            return SkillCall(task.skill, theme, relation=task.relation)
        if task.relation not in BESIDES:
            try:
                goal = voted(task.goal, point(f"Locate several points on the {task.goal}."))
                return SkillCall(task.skill, theme, goal=goal, relation=task.relation)
            except RefusedError as refused:  # a name that matches no perceived object may still be a place
                if refused.abstention.kind != "nothing_matches" or not skills[task.skill].free:
                    raise
        where = f"{BESIDES.get(task.relation, 'on')} the {task.goal}"
        seen = point(f"Find some spots within the vacant space {where}.")
        free = [s.point for s in seen if abs(s.point[2] - request.scene.table_height) < LEVEL]
        if len(free) < AGREEMENT * len(seen):
            message = f"Where the model pointed for a place {where}, the table is not free."
            raise RefusedError("no_goal", message)
        x, y = (float(v) for v in np.median(free, axis=0)[:2])
        return SkillCall(task.skill, theme, xy=(x, y))


def voted(words: str, seen: Sequence[Sighting]) -> str:
    """The id of the object that most points for the ``words`` lie on; raises :class:`RefusedError`."""
    votes = Counter(s.object for s in seen if s.object).most_common(2)
    where = f"Where the model pointed for '{words}'"
    if not votes:
        raise RefusedError("nothing_matches", f"{where}, no object was perceived.")
    (best, count), rest = votes[0], votes[1:]
    if count < AGREEMENT * len(seen) or any(other == count for _, other in rest):
        message = f"{where}, there are several objects, or none at most points."
        raise RefusedError("ambiguous", message)
    return best


def sights(text: str, scale: float, view: View, scene: Scene) -> list[Sighting]:
    """What the points of an answer show, without those that show nothing; raises :class:`ValueError` if all do."""
    seen, why = [], ""
    for u, v in read_points(text, scale):
        try:
            seen.append(sight(view, u, v, scene))
        except PlanningError as error:
            why = str(error)
    if not seen:
        raise ValueError(why)
    return seen


def question(request: PlanRequest, skills: Mapping[str, Skill]) -> str:
    """The question to the model for what an instruction is about."""
    lines = "\n".join(f"{s.signature()}: {s.description}" for s in skills.values())
    return (
        f"A robot can do this:\n{lines}\n\nThe instruction is: {instruction_in(request)}\n\nWhich skill "
        "does it ask for, with what object, and, where it says so, in which relation to what goal? Name objects in the "
        'instruction\'s words. Where it asks for none of these skills, or for several, the skill is "none". Answer '
        'with JSON alone: {"skill": "...", "theme": "...", "goal": "...", "relation": "..."}; "relation" is one of '
        f'{", ".join(r for r in RELATIONS if r)} or empty, "goal" may be empty.'
    )


def read_task(text: str, skills: Mapping[str, Skill]) -> PointingTask:
    """The answer to :func:`question`; raises :class:`ValueError` on what is wrong with it."""
    answer = json_in(text)
    if not isinstance(answer, dict):
        raise ValueError("It is not a JSON object.")
    skill, theme, goal, relation = (answer.get(k, "") for k in ("skill", "theme", "goal", "relation"))
    for what, word, words in (("skill", skill, (*skills, "none")), ("relation", relation, RELATIONS)):
        if word not in words:
            raise ValueError(f"There is no {what} {word!r:.40}; there are {', '.join(filter(None, words))}.")
    if not (isinstance(theme, str) and isinstance(goal, str)) or max(len(theme), len(goal)) > LONGEST:
        raise ValueError("'theme' and 'goal' are short texts.")
    if skill != "none" and not theme.strip():
        raise ValueError("'theme' is empty; name the object.")
    return PointingTask(skill, theme.removeprefix("the "), goal.removeprefix("the "), relation)


@dataclass(frozen=True)
class Sighting:
    """What a pixel shows: ``point`` (3,) in the world, metres, and the id of the ``object`` there, "" for none."""

    point: FloatArray
    object: str = ""


def encoded(view: View, longest: int) -> bytes:
    """The view's image as PNG with its longer side at most ``longest`` pixels; shares of the picture stay the same."""
    image = Image.fromarray(np.asarray(view.image))
    image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def read_points(text: str, scale: float = 1.0) -> tuple[tuple[float, float], ...]:
    """The points (u, v) of an answer's one list, in shares of the picture; :class:`ValueError` with what is wrong.

    A list is ``[(0.41, 0.52), ...]``, x to the right and y down, each from 0 to ``scale``. Text is parsed, never run.
    """
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"The answer has {len(text)} characters; give the list alone.")
    found = {*_LIST.findall(text)}
    if len(found) > 1:
        raise ValueError("There are several lists of points in the answer; give one.")
    try:
        points = [(float(u), float(v)) for u, v in ast.literal_eval("".join(found))]
    except (SyntaxError, ValueError, TypeError, RecursionError, MemoryError):
        form = "[(0.41, 0.52), (0.38, 0.47)]"
        raise ValueError(f"There is no list of points such as {form} in the answer.") from None
    if not 1 <= len(points) <= MAX_POINTS:
        raise ValueError(f"The list has more than {MAX_POINTS} points; give a few.")
    for u, v in points:
        if not (0.0 <= u <= scale and 0.0 <= v <= scale):
            raise ValueError(
                f"The point ({u:g}, {v:g}) lies outside the picture; coordinates are 0 to {scale:g}."
            )
    return tuple((u / scale, v / scale) for u, v in points)


def sight(view: View, u: float, v: float, scene: Scene) -> Sighting:
    """What is seen at the shares ``u`` and ``v`` of a picture's width and height, 1 being its last pixel.

    It is the median of the nearest measured points on one surface: an isolated one (a flying pixel at an edge) is
    outvoted by its neighbours; one confirmed by some of them is used, so that a thin handle is not mistaken for what
    lies behind it. Pixels of the robot's own arm count as not measured. Raises :class:`PlanningError` for a camera
    without depth, and if no depth was measured nearby.
    """
    if view.depth is None:
        raise PlanningError(f"The camera '{view.name}' measures no depth; choose one that does.")
    points = view.points()
    known = np.isfinite(points).all(axis=-1)
    if view.robot_mask is not None:
        known &= ~view.robot_mask
    pixels = np.argwhere(known)  # (N, 2) rows and columns
    off = np.linalg.norm(pixels + 0.5 - [v * view.camera.height, u * view.camera.width], axis=1)
    near = pixels[np.argsort(off, kind="stable")[:NEIGHBOURS]][: np.count_nonzero(off <= REACH)]
    if not len(near):
        where = f"({u:.2f}, {v:.2f}) in the picture of '{view.name}'"
        raise PlanningError(f"No depth was measured within {REACH} pixels of {where}.")
    found = points[tuple(near.T)]
    beside = np.linalg.norm(found - found[0], axis=1) < AGREE
    point = np.median(found[beside] if beside.sum() >= min(3, len(found)) else found, axis=0)
    return Sighting(point, scene.object_at(point))
