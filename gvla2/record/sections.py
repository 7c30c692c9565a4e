"""The page's content for each stage: rows, bars and sentences, no markup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gvla2.memory.contracts import MemoryItem
from gvla2.planning.contracts import Candidate, Plan
from gvla2.planning.findings import CheckName
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Guard, Orientation
from gvla2.record.contents import EpisodeRecord, Stage
from gvla2.record.drawing import css_colour
from gvla2.record.wording import State, finding, number, state

CHECKS: tuple[tuple[CheckName, str], ...] = (
    ("schema", "Numbers finite, units, frame, count of waypoints"),
    ("workspace", "Inside the workspace, clear of the table, segments and speed"),
    ("gripper", "The gripper opens and closes in a possible order"),
    ("kinematics", "Reachable, away from joint limits and singularities"),
    ("clearance", "Nothing is hit on the way, the grasp fits the hand"),
    ("memory", "Memory's bans and bounds are respected"),
)
"""The six checks and what each requires."""

ANCHORS: dict[Stage, str] = {
    "setup": "top",
    "observe": "seen",
    "perceive": "seen",
    "reconstruct": "refined",
    "recall": "recalled",
    "plan": "planned",
    "check": "checked",
    "execute": "done",
    "verify": "judged",
    "learn": "learnt",
    "judge": "judged",
}


@dataclass(frozen=True)
class Step:
    """One step of the bar under a page's header. ``share`` of the whole time, in percent."""

    name: str
    anchor: str
    state: State
    seconds: float | None
    share: float
    finding: str


def share(value: float | None, whole: float) -> float:
    """A number as percent of another, for a bar; 0 if either is undefined."""
    return 100 * value / whole if value and whole and math.isfinite(value) and math.isfinite(whole) else 0.0


def steps(record: EpisodeRecord) -> list[Step]:
    """All stages, in the order they run."""
    times = record.timings
    total = sum(v for v in times.values() if math.isfinite(v))
    return [
        Step(
            each,
            to,
            state(record, each),
            times.get(each),
            share(times.get(each), total),
            finding(record, each),
        )
        for each, to in ANCHORS.items()
    ]


def swatch(rgb: tuple[float, float, float]) -> str:
    """The seen colour, each channel in [0, 1], in CSS."""
    red, green, blue = (round(255 * float(v)) for v in np.clip(np.nan_to_num(np.asarray(rgb, float)), 0, 1))
    return css_colour((red, green, blue))


def roles_of(object_id: str, plan: Plan | None) -> str:
    """The roles that the plan gives an object."""
    return ", ".join(role for role, other in (plan.roles if plan else {}).items() if other == object_id)


def label_of(thing: SceneObject) -> str:
    """The object's name."""
    return thing.label or thing.id


def called(object_id: str, scene: Scene | None) -> str:
    """The label of the scene object with this id; the id itself ("table") if there is none."""
    things = scene.objects if scene is not None else ()
    return next((label_of(o) for o in things if o.id == object_id), object_id)


def terms(item: MemoryItem) -> list[tuple[str, float, float]]:
    """(name, value, bar in [-100, 100] percent of the largest one) of each term of a memory item's score."""
    largest = max((abs(v) for v in item.terms.values() if math.isfinite(v)), default=0.0)
    return [(name, value, share(value, largest)) for name, value in item.terms.items()]


def effect_words(effect: Mapping[str, object] | None) -> str:
    """A typed effect as a sentence: "grasp_depth >= 0.02 (pick)"."""
    if not effect:
        return ""
    kind, parameter = str(effect.get("kind", "effect")), str(effect.get("parameter", ""))
    skill = f", for the skill “{effect['skill']}”" if effect.get("skill") else ""
    of = f" of the object's {effect['scale']}" if effect.get("scale") else ""
    match kind:
        case "bound":
            return f"{parameter} {effect.get('op', '>=')} {_figure(effect.get('value', 0.0))}{of}{skill}"
        case "prior":
            spread = f" ± {_figure(effect.get('sd'))}" if effect.get("sd") else ""
            times = f"{effect.get('count', 0)} successes"
            return f"{parameter} ≈ {_figure(effect.get('value'))}{spread}{of}, {times}{skill}"
        case "order":
            return f"{parameter}{skill}"
        case "forbid":
            return f"never {parameter}{skill}"
    return ", ".join(f"{key} {value}" for key, value in effect.items())


def parameter_rows(plan: Plan) -> tuple[list[tuple[str, str, list[str]]], list[str]]:
    """(name, value, memory's change) of each parameter, and the remaining notes."""
    notes = list(plan.notes)
    rows = []
    for name, value in plan.parameters.items():
        own = [note for note in notes if note.startswith(f"{name}:")]
        notes = [note for note in notes if note not in own]
        rows.append((name, _figure(value), [note.partition(":")[2].strip() for note in own]))
    return rows, notes


def ranked_candidates(plan: Plan) -> list[tuple[Candidate, float, bool]]:
    """(candidate, bar in percent, chosen) from best to worst; the best one not rejected was chosen."""
    scores = {id(c): c.score if math.isfinite(c.score) else 0.0 for c in plan.candidates}
    order = sorted(plan.candidates, key=lambda c: (bool(c.rejected), -scores[id(c)]))
    largest = max(scores.values(), default=0.0)
    chosen = order[0] if order and not order[0].rejected and plan.trajectory is not None else None
    return [(c, max(0.0, share(scores[id(c)], largest)) if largest > 0 else 0.0, c is chosen) for c in order]


def orientation_words(orientation: Orientation) -> str:
    """The hand's orientation in a few words."""
    toward = direction(orientation.vector)
    match orientation.policy:
        case "hold":
            return "as before"
        case "grasp":
            return f"points {toward}, fingers along {direction(orientation.closing, both=True)}"
        case "axis":
            return f"points {toward}"
        case "twist":
            return f"turned {number(math.degrees(orientation.angle), 0)}° about {toward}"
        case "slerp":
            return f"{number(100 * orientation.angle, 0)} % of the way to {toward}"


def guard_words(guard: Guard) -> str:
    """The conditions of a guard: "25 N", "held back 3 mm"."""
    force = f"{number(guard.force, 1)} N" if guard.force else ""
    stall = f"held back {number(1000 * guard.stall, 1)} mm" if guard.stall else ""
    return " or ".join(words for words in (force, stall) if words)


def direction(vector: tuple[float, float, float], both: bool = False) -> str:
    """A direction: "down", "+x", or its numbers; with ``both`` the sign is ignored ("y")."""
    v = np.asarray(vector, dtype=np.float64)
    length = float(np.linalg.norm(v))
    if not math.isfinite(length) or length < 1e-9:
        return "nowhere"
    v = v / length
    axis = int(np.argmax(np.abs(v)))
    if abs(v[axis]) < 0.995:
        return "(" + ", ".join(number(float(c), 2) for c in v) + ")"
    if both:
        return "xyz"[axis]
    if axis == 2:
        return "down" if v[2] < 0 else "up"
    return ("−" if v[axis] < 0 else "+") + "xy"[axis]


def _figure(value: object) -> str:
    return number(float(value), 4) if isinstance(value, int | float) else str(value)
