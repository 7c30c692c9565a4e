"""Programs: a planner's plan in its own language, kept after a success and adapted to other scenes.

Names of objects become roles (``theme``, ``goal``, ``object_2``), so that a program applies to other objects of the
same kind; lengths that scale with the object become shares of its size. :func:`adapted` turns a program back into the
names and millimetres of the present scene.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from gvla2.errors import PlanningError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint

_MARK = re.compile(r"<(?=\s*/?\s*memory\b)", re.IGNORECASE)


def remembered(text: str) -> str:
    """Memory's text for a prompt, between marks that it cannot break out of; "" if it is empty."""
    return f"<memory>\n{_MARK.sub('(', text.strip())}\n</memory>" if text.strip() else ""


Language = Literal["calls", "waypoints"]
LONGEST = 40
"""Steps of a program; more than any plan of the loop can hold."""
_NAME = re.compile(r"\{(\w{1,20})\}")
_SHARE = re.compile(r"(-?\d{1,2}(?:\.\d{1,4})?)([hw])")
_LINE = re.compile(r"""[\w {}(),.:=<>!'"\[\]*/+-]{0,200}""", re.ASCII)
"""A line of a program of calls; a remembered one is untrusted."""
FARTHEST = 2000.0
"""Largest length of a waypoint, millimetres."""


@dataclass(frozen=True)
class Program:
    """``steps`` in a ``language``, with role names in braces for objects.

    * ``calls``: a step is a line, ``place({theme}, {goal}, in)``.
    * ``waypoints``: a step is ``["{theme}", dx, dy, up, g]``, from the middle of the object's top to the tool in
      millimetres, x away from the robot, y to its left; or ``["{theme}", "{goal}", along, up, g]``, along from the
      first object's middle towards the second's. A length may be a share: ``"-0.5h"`` of the first object's height,
      ``"0.4w"`` of its longer level side. ``g`` is the hand's opening in [0, 1].

    ``roles`` gives the kinds of objects in the roles ("red cup cylinder"), ``instruction`` is the one it was written
    for.
    """

    language: Language
    steps: tuple[Any, ...]
    roles: Mapping[str, str] = field(default_factory=dict)
    skill: str = ""
    instruction: str = ""
    source: str = ""

    def to_json(self) -> dict[str, Any]:
        """As the effect of a lesson, see :class:`gvla2.memory.contracts.Lesson`."""
        return {
            "kind": "program",
            "skill": self.skill,
            "language": self.language,
            "instruction": self.instruction,
            "roles": dict(self.roles),
            "steps": [list(s) if isinstance(s, tuple) else s for s in self.steps],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str = "") -> Program:
        """The inverse of :meth:`to_json`; raises :class:`PlanningError` for anything else."""
        steps, roles = data.get("steps"), data.get("roles", {})
        sound = isinstance(steps, list | tuple) and isinstance(roles, Mapping) and 0 < len(steps) <= LONGEST
        if data.get("kind") != "program" or data.get("language") not in ("calls", "waypoints") or not sound:
            raise PlanningError(f"Not a program: {dict(data)!r:.200}.")
        calls = data["language"] == "calls"
        known = frozenset(map(str, roles))
        lines = all(
            isinstance(s, str) and _LINE.fullmatch(s) and known >= {*_NAME.findall(s)} for s in steps or ()
        )
        if not (lines if calls else all(_is_waypoint(s, known) for s in steps or ())):
            raise PlanningError(f"A program with invalid steps: {steps!r:.200}.")
        return cls(
            data["language"],
            tuple(s if calls else tuple(s) for s in steps or ()),
            {str(k): str(v) for k, v in roles.items()},
            str(data.get("skill", "")),
            str(data.get("instruction", "")),
            source,
        )


def _role_names(ids: Sequence[str], roles: Mapping[str, str]) -> dict[str, str]:
    """A role for each of the ids of a program: the plan's own, then numbered ones."""
    named = {i: role for role, i in roles.items() if role in ("theme", "goal")}
    return {i: named.get(i) or f"object_{k}" for k, i in enumerate(dict.fromkeys(ids))}


def kind_of(obj: SceneObject) -> str:
    """An object's kind, in words to search another scene: its label and shape."""
    return f"{obj.label} {obj.shape}"


def calls_program(lines: Sequence[str], ids: Mapping[str, str], scene: Scene, **about: Any) -> Program:
    """A program of calls from its ``lines``, whose names are keys of ``ids`` (to scene ids).

    ``about``: the plan's ``roles`` (role to id), ``skill`` and ``instruction``.
    """
    words = re.compile(r"[A-Za-z_]\w*")
    used = [ids[w] for line in lines for w in words.findall(line) if w in ids]
    roles = _role_names(used, about.pop("roles", {}))
    steps = [
        words.sub(lambda m: "{" + roles[ids[m.group()]] + "}" if m.group() in ids else m.group(), line)
        for line in lines
    ]
    return Program("calls", tuple(steps), {roles[i]: kind_of(scene[i]) for i in roles}, **about)


def waypoints_program(steps: Sequence[Sequence[Any]], scene: Scene, **about: Any) -> Program:
    """A program of waypoints from steps with scene ids for names and millimetres for lengths."""
    used = [part for step in steps for part in step[:2] if isinstance(part, str)]
    roles = _role_names(used, about.pop("roles", {}))
    general = [_generalised(step, roles, scene[step[0]]) for step in steps]
    return Program("waypoints", tuple(general), {roles[i]: kind_of(scene[i]) for i in roles}, **about)


def bind(program: Program, scene: Scene, instruction: str) -> dict[str, str]:
    """Role to the id of the object of this scene that fits it best; roles without a fit are left out.

    Kinds are compared by the words of label and shape, ignoring colours; among equals the best match with the
    instruction's words is taken, then the first in the scene. No object has two roles.
    """
    said = set(re.findall(r"\w+", instruction.casefold()))
    bound: dict[str, str] = {}
    for role, kind in program.roles.items():
        words = kind.casefold().split()
        best: tuple[float, str] = (0.0, "")
        for obj in scene.objects:
            own = set(kind_of(obj).casefold().split()) - {obj.colour.casefold()}
            alike = len(own & set(words)) / max(1, len(own))
            taken = obj.id in bound.values()
            if taken or alike < 0.5 or (obj.shape == "region") != ("region" in words):
                continue
            named = len(said & {*obj.label.casefold().split(), obj.colour.casefold()} - {""})
            best = max(best, (alike + named, obj.id), key=lambda b: b[0])
        if best[1]:
            bound[role] = best[1]
    return bound


def adapted(
    program: Program, scene: Scene, names: Mapping[str, str], instruction: str
) -> tuple[Any, ...] | None:
    """The steps with the names (by id) and millimetres of this scene; None if a role has no fitting object."""
    bound = bind(program, scene, instruction)
    if set(program.roles) - set(bound):
        return None

    def named(text: str) -> str:
        return _NAME.sub(lambda m: names[bound[m.group(1)]], text)

    if program.language == "calls":
        return tuple(map(named, program.steps))

    def absolute(part: Any, obj: SceneObject) -> Any:
        if not isinstance(part, str):
            return part
        share = _SHARE.fullmatch(part)
        if share is None:
            return named(part)
        height, length = _sizes(obj)
        return round(float(share.group(1)) * (height if share.group(2) == "h" else length))

    return tuple(
        tuple(absolute(part, scene[bound[step[0][1:-1]]]) for part in step) for step in program.steps
    )


def _is_waypoint(step: Any, roles: frozenset[str]) -> bool:
    if not isinstance(step, list | tuple) or len(step) != 5:
        return False

    def is_role(part: Any) -> bool:
        return isinstance(part, str) and part[:1] + part[-1:] == "{}" and part[1:-1] in roles

    def is_length(part: Any) -> bool:
        if isinstance(part, str):
            return _SHARE.fullmatch(part) is not None
        return isinstance(part, int | float) and not isinstance(part, bool) and abs(part) <= FARTHEST

    first, second, along, up, opening = step
    lengths = [along, up, opening, *([] if is_role(second) else [second])]
    sized = is_role(first) and all(map(is_length, lengths))
    return sized and not isinstance(opening, str) and 0.0 <= opening <= 1.0


def _generalised(step: Sequence[Any], roles: Mapping[str, str], obj: SceneObject) -> tuple[Any, ...]:
    """Depths below a top are shares of the height; offsets within reach of the object are shares of its length."""
    name, *middle, up, g = step
    height, length = _sizes(obj)
    low = f"{up / height:.2f}h" if up < 0 and height > 1.0 else up
    aside = [
        "{" + roles[v] + "}" if isinstance(v, str)
        else f"{v / length:.2f}w" if v and abs(v) <= 0.75 * length else v
        for v in middle
    ]  # fmt: skip
    return ("{" + roles[name] + "}", *aside, low, g)


def _sizes(obj: SceneObject) -> tuple[float, float]:
    """Height and longer level side, millimetres."""
    return 1e3 * (obj.top - obj.bottom), 1e3 * float(max(obj.extents[:2]))


STILL = 0.002
"""Waypoints nearer than this are merged, metres."""
ASIDE = 0.03
"""Distance from an object's middle beyond which a place is given by the direction to another object, metres."""
ALONG = 0.95
"""Least cosine between such an offset and the direction to the other object."""
OVER = 0.06
"""An object carried this near to the goal's middle, horizontal metres, is given relative to the goal. The hand may be
farther off by as much as it holds the object off its middle."""


def relative_steps(trajectory: Trajectory, scene: Scene, roles: Mapping[str, str]) -> list[list[Any]]:
    """``[id, dx, dy, up, g]`` or ``[id, other, along, up, g]`` per waypoint, millimetres; see ``Program``.

    Waypoints at one place are merged, and those after the release are left out: they did not contribute to the success.
    Empty if the plan names no theme of the scene.
    """
    known = {o.id: o for o in scene.objects}
    theme, goal = known.get(roles.get("theme", "")), known.get(roles.get("goal", ""))
    if theme is None:
        return []
    way = _distinct(trajectory)
    hold = next((np.asarray(w.xyz) for w, opened in way if not opened and way[0][1]), theme.centre)
    near = OVER + float(np.linalg.norm((hold - theme.centre)[:2]))
    steps: list[list[Any]] = []
    for waypoint, opened in way:
        at = np.asarray(waypoint.xyz)
        near_goal = goal is not None and float(np.linalg.norm((at - goal.centre)[:2])) < near
        taken = bool(waypoint.carries) or any(s[-1] == 0 for s in steps)
        first = goal if goal is not None and near_goal and taken else theme
        other = theme if first is goal else goal
        steps.append(_step(at, opened, first, other))
        if len(steps) > 1 and opened and not steps[-2][-1]:
            break  # release
    return steps


def _distinct(trajectory: Trajectory) -> list[tuple[Waypoint, bool]]:
    """The distinct waypoints, each with whether the hand is open there.

    Before a narrow grasp the hand opens only a little: open means wider than the middle of its openings. A hand that
    never changes pushes or presses, and counts as closed.
    """
    openings = [waypoint.gripper for waypoint in trajectory]
    middle = (min(openings) + max(openings)) / 2
    kept: list[tuple[Waypoint, bool]] = []
    for waypoint in trajectory:
        opened = waypoint.gripper > middle
        still = kept and float(np.linalg.norm(np.subtract(waypoint.xyz, kept[-1][0].xyz))) < STILL
        if not still or kept[-1][1] != opened:
            kept.append((waypoint, opened))
    return kept


def _step(at: FloatArray, opened: bool, first: SceneObject, other: SceneObject | None) -> list[Any]:
    up, g = round(1e3 * float(at[2] - first.top)), int(opened)
    offset = (at - first.centre)[:2]
    if other is not None and float(np.linalg.norm(offset)) > ASIDE:
        way = (other.centre - first.centre)[:2]
        length = float(np.linalg.norm(way))
        along = float(offset @ way) / max(length, 1e-9)
        if abs(along) > ALONG * float(np.linalg.norm(offset)):
            return [first.id, other.id, round(1e3 * along), up, g]
    dx, dy = (round(1e3 * float(v)) for v in offset)
    return [first.id, dx, dy, up, g]
