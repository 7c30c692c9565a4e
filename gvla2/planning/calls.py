"""Skill calls: the steps of a program, by ids of perceived objects, language-independent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from gvla2.component import Range, check_ranges

Relation = Literal["", "on", "in", "to", "beside", "left_of", "right_of", "behind", "front_of"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)
"""How the theme should lie relative to the goal; "" if the skill has only one way."""

WAYS = {"left": (0.0, 1.0), "right": (0.0, -1.0), "forward": (1.0, 0.0), "back": (-1.0, 0.0)}
"""Directions as unit vectors (x, y), seen from the robot."""


@dataclass(frozen=True)
class SkillCall:
    """One step of a program: ``skill`` on the object ``theme``, and its target.

    ``theme`` and ``goal`` are ids of scene objects; ``xy`` is the target of the theme's centre, world metres, for a
    free place, or for one side of a goal that it is put on or in. ``relation`` is that of the goal. ``amount`` is how
    far in metres (lifted, pushed, pulled) and ``direction`` a unit vector (x, y), x away from the robot and y to its
    left. ``theta`` sets parameters of the skill by name, in their own units. Raises :class:`ValueError` for an invalid
    relation or number.
    """

    skill: str
    theme: str
    goal: str = ""
    xy: tuple[float, float] | None = None
    relation: Relation = ""
    amount: float | None = None
    direction: tuple[float, float] | None = None
    theta: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise ValueError(
                f"No relation '{self.relation}'; there are {', '.join(r for r in RELATIONS if r)}."
            )
        numbers = [*(self.xy or ()), *(self.direction or ()), *self.theta.values()]
        numbers += [] if self.amount is None else [self.amount]
        if not all(math.isfinite(n) for n in numbers):
            raise ValueError(f"A number of {self.skill}({self.theme}) is not finite.")

    def __str__(self) -> str:
        """As written in a program: ``place(object_1, object_3, in)``."""
        said = [self.theme, self.goal, self.relation]
        said += [f"({', '.join(f'{v:.3f}' for v in self.xy)}) m"] if self.xy is not None else []
        said += [f"{self.amount:g} m"] if self.amount is not None else []
        if self.direction is not None:
            said.append(f"towards ({', '.join(f'{v:.2f}' for v in self.direction)})")
        said += [f"{name}={value:g}" for name, value in self.theta.items()]
        return f"{self.skill}({', '.join(word for word in said if word)})"


@dataclass
class GraspOptions:
    """How grasps are chosen, metres.

    The opened hand must be wider than the object by ``clearance`` (default: 2 mm of perceived width and 1 mm on each
    side). A hand that is opened just enough leaves the gap ``snug`` on each side. ``facing`` is the least cosine
    between a surface's normal and the closing direction: rubber pads hold steeper surfaces, but not reliably.
    """

    clearance: float = 0.004
    snug: float = 0.008
    facing: float = 0.7

    def __post_init__(self) -> None:
        check_ranges(self, "planner.grasp", GRASP_RANGES)


GRASP_RANGES: Mapping[str, Range] = {
    "clearance": (0, 0.05, "m"),
    "snug": (0, 0.05, "m"),
    "facing": (0, 1, ""),
}


@dataclass(kw_only=True)
class SkillOptions:
    """How skills are executed: metres, m/s. Light enough to be a part of a planner's configuration.

    ``lift_height`` is how far an object is lifted when the call gives no amount; ``push_distance`` how far it is
    pushed when the call gives a direction only; ``speed`` of the tool in free space, ``contact_speed`` in contact.
    ``parameters`` replaces the defaults of the skills' parameters by name (``{standoff: 0.06, place_height: 0.01}``,
    listed by ``gvla2 plugins skill NAME``); ``grasp`` is how grasps are chosen. ``tries`` is the maximum
    number of candidates checked in full. ``explore`` > 0 varies the numbers of each plan around their values, by this
    relative spread and at most by half; ``explore_seed`` selects the variation.
    """

    lift_height: float = 0.25
    push_distance: float = 0.10
    speed: float = 0.25
    contact_speed: float = 0.08
    parameters: dict[str, float] = field(default_factory=dict)
    grasp: GraspOptions = field(default_factory=GraspOptions)
    tries: int = 16
    explore: float = 0.0
    explore_seed: int = 0


OPTION_RANGES: Mapping[str, Range] = {
    "lift_height": (0, 0.6, "m"),
    "push_distance": (0.001, 1, "m"),
    "speed": (0.01, 0.5, "m/s"),
    "contact_speed": (0.01, 0.25, "m/s"),
    "tries": (1, 1000, ""),
    "explore": (0, 2, ""),
    "explore_seed": (0, 2**63 - 1, ""),
    "programs": (0, 1000, ""),
    "max_tokens": (1, 1_000_000, ""),
}
"""Ranges of :class:`SkillOptions`, and of what planners that ask a model have in common, for their configurations."""


def written(call: SkillCall, names: Mapping[str, str]) -> str:
    """The line of a program that makes the call, with names by id; "" if the language cannot express it.

    Parameters that the call sets are left out: memory stores them separately.
    """
    ways = [way for way, vector in WAYS.items() if vector == call.direction]
    if call.xy is not None or (call.direction is not None and not ways):
        return ""
    parts = [names[i] for i in (call.theme, call.goal) if i]
    parts += [call.relation] if call.relation else []
    parts += ways
    parts += [f"{1e3 * call.amount:.0f}"] if call.amount is not None else []
    return f"{call.skill}({', '.join(parts)})"
