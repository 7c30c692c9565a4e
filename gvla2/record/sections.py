"""The page's content for each stage: rows, bars and sentences, no markup."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gvla2.episode.record import EpisodeRecord
from gvla2.planning.contracts import Candidate, Plan
from gvla2.planning.scene import Scene, SceneObject
from gvla2.record.wording import STAGES, Step, finding, number, state


def share(value: float | None, whole: float) -> float:
    """A number as percent of another, for a bar; 0 if either is undefined."""
    return 100 * value / whole if value and whole and math.isfinite(value) and math.isfinite(whole) else 0.0


def steps(record: EpisodeRecord) -> list[Step]:
    """All stages, in the order they run."""
    times = record.timings
    return [Step(each, state(record, each), times.get(each), finding(record, each)) for each in STAGES]


def label_of(thing: SceneObject) -> str:
    """The object's name."""
    return thing.label or thing.id


def called(object_id: str, scene: Scene | None) -> str:
    """The label of the scene object with this id; the id itself ("table") if there is none."""
    things = scene.objects if scene is not None else ()
    return next((label_of(o) for o in things if o.id == object_id), object_id)


def call_words(record: EpisodeRecord) -> list[str]:
    """The plan's calls with labels in place of ids: "place(red cube, drawer, in)"."""
    scene, calls = record.scene, record.plan.calls if record.plan else ()
    named = [replace(c, theme=called(c.theme, scene), goal=called(c.goal, scene)) for c in calls]
    return list(map(str, named))


def parameter_rows(plan: Plan) -> tuple[list[tuple[str, str, list[str]]], list[str]]:
    """(name, value, memory's change) of each parameter, and the remaining notes."""
    notes = list(plan.notes)
    rows = []
    for name, value in plan.parameters.items():
        own = [note for note in notes if note.startswith(f"{name}:")]
        notes = [note for note in notes if note not in own]
        rows.append((name, figure(value), [note.partition(":")[2].strip() for note in own]))
    return rows, notes


def ranked_candidates(plan: Plan) -> list[tuple[Candidate, float, bool]]:
    """(candidate, bar in percent, chosen) from best to worst; the best one not rejected was chosen."""
    scores = {id(c): c.score if math.isfinite(c.score) else 0.0 for c in plan.candidates}
    order = sorted(plan.candidates, key=lambda c: (bool(c.rejected), -scores[id(c)]))
    largest = max(scores.values(), default=0.0)
    chosen = order[0] if order and not order[0].rejected and plan.trajectory is not None else None
    return [(c, max(0.0, share(scores[id(c)], largest)) if largest > 0 else 0.0, c is chosen) for c in order]


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


def figure(value: object) -> str:
    """A number with four decimals at most, anything else as its text."""
    return number(float(value), 4) if isinstance(value, int | float) else str(value)
