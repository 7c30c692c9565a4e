"""Instructions about named objects, and their success criteria."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.robot.solids import body_points
from gvla2.robot.task import Body, Profile, WorldState

LIFTED, LIFTED_WELL = 0.03, 0.08
"""Metres between a lifted object's lowest point and the table: relaxed and strict."""

WORDINGS = {
    "lift": (
        "lift the {x}",
        "pick up the {x}",
        "raise the {x} off the table",
        "grab the {x} and hold it up",
        "take the {x} and lift it into the air",
    ),
    "put_in": (
        "put the {x} in the {y}",
        "place the {x} into the {y}",
        "pick up the {x} and put it in the {y}",
        "drop the {x} into the {y}, please",
    ),
}
"""Templates of each kind; ``{x}`` is the object, ``{y}`` the other object."""


@dataclass(frozen=True)
class ObjectRequest:
    """The request: its kind, the object ``theme`` and the other object ``goal``: bodies' names, "" for no other."""

    kind: str
    theme: str
    goal: str = ""


def sentence_for(asked: ObjectRequest, labels: dict[str, str], rng: np.random.Generator) -> str:
    """A sentence for it, drawn among :data:`WORDINGS`."""
    templates = WORDINGS[asked.kind]
    chosen = templates[int(rng.integers(len(templates)))]
    return chosen.format(x=labels[asked.theme], y=labels.get(asked.goal, ""))


def interpret(sentence: str, labels: dict[str, str], own: ObjectRequest) -> tuple[ObjectRequest, str]:
    """The objects named by a given sentence's words, and a remark for the goal when it names none."""
    said = " ".join(re.findall(r"[a-z0-9]+", sentence.lower()))
    places = {name: _place(said, label) for name, label in labels.items()}
    named = sorted((n for n, at in places.items() if at >= 0), key=lambda n: places[n])
    if len(named) >= 2 and re.search(r"\b(in|into|inside)\b", said):
        return ObjectRequest("put_in", named[0], named[1]), ""
    if len(named) == 1:
        return ObjectRequest("lift", named[0]), ""
    return own, "; the sentence names none of the objects by its name, so the seed's own goal is judged"


def _place(said: str, label: str) -> int:
    found = re.search(rf"\b{re.escape(label)}s?\b", said)
    return found.start() if found else -1


def success_check(asked: ObjectRequest, bodies: Sequence[Body], table: float) -> tuple[Checks, str]:
    """The predicates of both profiles, and their description; ``table`` is world z, metres."""
    by_name = {body.name: body for body in bodies}
    theme = by_name[asked.theme]
    if asked.kind == "lift":
        return _lifting(theme, table), (
            f"relaxed: no part of the {theme.label} is lower than {LIFTED} m above the table; "
            f"strict: than {LIFTED_WELL} m, and the fingers hold it"
        )
    goal = by_name[asked.goal]
    return _inside(theme, goal), (
        f"relaxed: the {theme.label} is over the {goal.label} and lower than its rim; strict: at rest there, let go "
        f"of, and the {goal.label} still stands"
    )


Checks = dict[Profile, Callable[[WorldState], bool]]


def _lifting(body: Body, table: float) -> Checks:
    def clearance(world: WorldState) -> float:
        return float(_corners(body, world)[:, 2].min() - table)

    return {
        "relaxed": lambda world: clearance(world) > LIFTED,
        "strict": lambda world: clearance(world) > LIFTED_WELL and world.held(body.name),
    }


def _inside(body: Body, goal: Body) -> Checks:
    def relaxed(world: WorldState) -> bool:
        mine, theirs = _corners(body, world), _corners(goal, world)
        low, high, middle = theirs.min(axis=0), theirs.max(axis=0), _middle(mine)
        over = bool(((middle > low) & (middle < high))[:2].all())
        return over and bool(mine[:, 2].min() < high[2]) and not world.held(body.name)

    def strict(world: WorldState) -> bool:
        upright = goal.fixed or bool(world.pose(goal.name)[2, 2] > 0.8 * goal.world_from_body[2, 2])
        lying = world.resting(body.name) and "table" not in world.touching(body.name)
        return relaxed(world) and upright and lying

    return {"relaxed": relaxed, "strict": strict}


def _corners(body: Body, world: WorldState) -> FloatArray:
    """(N, 3) world points whose hull is the body now."""
    return body_points(body, world.pose(body.name))


def _middle(points: FloatArray) -> FloatArray:
    """(3,) the middle of the box about points (N, 3)."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))
