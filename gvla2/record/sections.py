"""What the page shows of each stage, worked out: rows, bars and sentences, no markup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gvla2.memory.contracts import MemoryItem
from gvla2.planning.contracts import Candidate, Plan
from gvla2.planning.findings import CheckName, CheckReport, Finding
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Guard, Orientation
from gvla2.record.contents import EpisodeRecord, Stage
from gvla2.record.drawing import css_colour, marker_colour
from gvla2.record.wording import OUTCOMES, State, count, executed, finding, fixed, listing, number, state

CHECKS: tuple[tuple[CheckName, str], ...] = (
    ("schema", "Numbers finite, units, frame, count of waypoints"),
    ("workspace", "Inside the workspace, clear of the table, segments and speed"),
    ("gripper", "The gripper opens and closes in a possible order"),
    ("kinematics", "Reachable, away from joint limits and singularities"),
    ("clearance", "Nothing is hit on the way, the grasp fits the hand"),
    ("memory", "What memory forbids or bounds is respected"),
)
"""The six checks and what each asks."""

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
    """One stage of the strip under the header. ``share`` of the run's time, in percent."""

    stage: Stage
    anchor: str
    state: State
    seconds: float | None
    share: float
    finding: str


@dataclass(frozen=True)
class Tile:
    """One of the three outcomes. ``tone`` colours it; ``marks`` are (name, yes) pairs."""

    title: str
    value: str
    tone: str
    note: str
    marks: tuple[tuple[str, bool], ...] = ()


@dataclass(frozen=True)
class ObjectRow:
    """One scene object: ``marker`` is its colour in the pictures, ``swatch`` the colour that was seen."""

    number: int
    marker: str
    swatch: str
    label: str
    shape: str
    colour: str
    size: str
    position: str
    confidence: float
    points: int
    role: str
    parent: str


@dataclass(frozen=True)
class Term:
    """One term of a memory score; ``share`` in [-100, 100] of the largest one."""

    name: str
    value: float
    share: float


@dataclass(frozen=True)
class CheckCard:
    """One check: ``state`` "passed", "failed" or "silent"; ``worst`` is the measure that says most."""

    name: str
    asks: str
    state: str
    failed: tuple[Finding, ...]
    measures: tuple[Finding, ...]


def steps(record: EpisodeRecord) -> list[Step]:
    """All stages, in the order they run."""
    total = sum(v for v in record.timings.values() if math.isfinite(v)) or 1.0
    return [
        Step(
            stage,
            anchor,
            state(record, stage),
            record.timings.get(stage),
            100 * max(0.0, _finite(record.timings.get(stage, 0.0))) / total,
            finding(record, stage),
        )
        for stage, anchor in ANCHORS.items()
    ]


def tiles(record: EpisodeRecord) -> list[Tile]:
    """Three outcomes that must not be mixed up: motion, verifier's verdict, referee's word."""
    return [_motion_tile(record), _verdict_tile(record), _referee_tile(record)]


def _motion_tile(record: EpisodeRecord) -> Tile:
    title = "Carried out?"
    if record.parts:
        done = record.report is not None and record.report.completed
        count_done, of = len(record.parts) + done, len(record.whole)
        left = bool(record.plan and record.plan.remaining)
        value = f"{count_done} of {of} parts" + (" and more" if left else "")
        whole = done and not left
        note = "What the robot reports about its own motion, of the parts of the program that it came to."
        return Tile(
            title,
            value,
            "good" if whole else "bad",
            f"{executed(record) or 'The last part did not move'}. {note}",
        )
    if record.report is not None:
        done = record.report.completed
        note = "What the robot reports about its own motion. Carried out is not yet succeeded."
        return Tile(
            title,
            "Yes" if done else "Not to the end",
            "good" if done else "bad",
            f"{executed(record)}. {note}",
        )
    if record.plan is not None and record.plan.abstention is not None:
        return Tile(title, "Declined", "unsure", "The planner gave a reason and nothing was moved.")
    if record.checks is not None and not record.checks.passed:
        return Tile(title, "Not started", "bad", "The checks before motion rejected the plan.")
    return Tile(title, "Not started", "idle", "The run did not come as far as moving.")


def _verdict_tile(record: EpisodeRecord) -> Tile:
    verdict, title = record.verdict, "Verifier’s verdict"
    if verdict is None:
        return Tile(title, "None", "idle", "Nothing was there to be judged.")
    by = verdict.verifier or record.choices.get("verifier", "the verifier")
    note = f"Given by “{by}” from what the cameras and the hand measured, not from true state. Memory learns from it."
    if record.parts:
        note = f"Of the last part of the program. {note}"
    if verdict.outcome == "unavailable":
        return Tile(title, "Unavailable", "idle", note)
    tone = {"verified_success": "good", "verified_fail": "bad"}.get(verdict.outcome, "unsure")
    value = f"{OUTCOMES[verdict.outcome].capitalize()} {fixed(verdict.quality, 2)}"
    return Tile(title, value, tone, note)


def _referee_tile(record: EpisodeRecord) -> Tile:
    judgement, title = record.judgement, "Referee (simulation only)"
    if judgement is None:
        return Tile(title, "None", "idle", "Nobody who knows the true state judged this run.")
    value, tone = (
        ("Success", "good")
        if judgement.eased and judgement.strict
        else ("Eased only", "good")
        if judgement.eased
        else ("Strict only", "unsure")
        if judgement.strict
        else ("Not achieved", "bad")
    )
    note = "From the simulation’s true state; the robot and its memory never see this."
    return Tile(title, value, tone, note, (("eased", judgement.eased), ("strict", judgement.strict)))


def story(record: EpisodeRecord) -> str:
    """The run in a few plain sentences."""
    parts: list[str] = []
    if record.scene is not None:
        seen = listing((o.label or o.id for o in record.scene.objects), 5)
        parts.append(
            f"The robot saw {count(len(record.scene.objects), 'object')}{f' ({seen})' if seen else ''}."
        )
    if record.recalled is not None and record.recalled.items:
        parts.append(f"Memory offered {count(len(record.recalled.items), 'record')}.")
    plan = record.plan
    if plan is not None and plan.trajectory is not None:
        named = f" with the skill “{plan.skill}”" if plan.skill else ""
        before = f"After {count(len(record.parts), 'part')} of its program it" if record.parts else "It"
        parts.append(f"{before} planned {count(len(plan.trajectory), 'waypoint')}{named}.")
    elif plan is not None and record.parts:
        parts.append(
            f"{count(len(record.parts), 'part')} of the program went well, the next could not be planned."
        )
    elif plan is not None:
        parts.append("The planner declined, so nothing was moved.")
    if record.checks is not None and not record.checks.passed:
        parts.append("The checks before motion rejected the plan.")
    if record.report is not None:
        parts.append(f"It carried out {executed(record)}.")
    verdict = record.verdict
    if verdict is not None:
        word = "could not judge" if verdict.outcome == "unavailable" else f"says {OUTCOMES[verdict.outcome]}"
        parts.append(f"Its own verifier {word}.")
    if record.judgement is not None:
        eased, strict = ("met" if v else "not met" for v in (record.judgement.eased, record.judgement.strict))
        parts.append(
            f"By true state the eased and the strict goal are {eased}."
            if eased == strict
            else f"By true state the eased goal is {eased}, the strict one is {strict}."
        )
    return " ".join(parts) or "The run ended before anything was seen."


def object_rows(scene: Scene, plan: Plan | None) -> list[ObjectRow]:
    """The object table, in the order and with the numbers of the pictures."""
    roles: dict[str, list[str]] = {}
    for role, object_id in (plan.roles if plan else {}).items():
        roles.setdefault(object_id, []).append(role)
    labels = {o.id: o.label or o.id for o in scene.objects}
    rows = []
    for k, thing in enumerate(scene.objects):
        rgb = np.clip(np.nan_to_num(np.asarray(thing.rgb, dtype=np.float64)), 0, 1) * 255
        rows.append(
            ObjectRow(
                number=k + 1,
                marker=css_colour(marker_colour(k)),
                swatch=css_colour((round(rgb[0]), round(rgb[1]), round(rgb[2]))),
                label=thing.label or thing.id,
                shape=thing.shape,
                colour=thing.colour,
                size=" × ".join(number(1000 * float(e), 0) for e in thing.extents),
                position=", ".join(f"{float(v):.3f}" for v in thing.centre),
                confidence=_finite(thing.confidence),
                points=len(thing.points),
                role=", ".join(roles.get(thing.id, [])),
                parent=labels.get(thing.parent, thing.parent),
            )
        )
    return rows


def called(object_id: str, scene: Scene | None) -> str:
    """The label of the scene object with this id; the id itself ("table") where there is none."""
    things = scene.objects if scene is not None else ()
    return next((o.label or o.id for o in things if o.id == object_id), object_id)


def terms(item: MemoryItem) -> list[Term]:
    """The terms of a memory item's score, each as a bar."""
    largest = max((abs(_finite(v)) for v in item.terms.values()), default=0.0) or 1.0
    return [Term(name, value, 100 * _finite(value) / largest) for name, value in item.terms.items()]


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
    """(name, value, what memory changed) of each parameter, and the notes that belong to none."""
    notes = list(plan.notes)
    rows = []
    for name, value in plan.parameters.items():
        own = [note for note in notes if note.startswith(f"{name}:")]
        notes = [note for note in notes if note not in own]
        rows.append((name, _figure(value), [note.partition(":")[2].strip() for note in own]))
    return rows, notes


def ranked_candidates(plan: Plan) -> list[tuple[Candidate, float, bool]]:
    """(candidate, bar in percent, chosen) from best to worst; the best that was not rejected was chosen."""
    order = sorted(plan.candidates, key=lambda c: (bool(c.rejected), -_finite(c.score)))
    largest = max((_finite(c.score) for c in order), default=0.0)
    chosen = order[0] if order and not order[0].rejected and plan.trajectory is not None else None
    return [
        (c, 100 * max(0.0, _finite(c.score)) / largest if largest > 0 else 0.0, c is chosen) for c in order
    ]


def check_cards(checks: CheckReport) -> list[CheckCard]:
    """The six checks in their order."""
    cards = []
    for name, asks in CHECKS:
        own = [f for f in checks.findings if f.check == name]
        failed = tuple(f for f in own if not f.passed)
        measures = tuple(f for f in own if f.passed and (f.message or f.value is not None))
        cards.append(
            CheckCard(name, asks, "failed" if failed else "passed" if own else "silent", failed, measures)
        )
    return cards


def orientation_words(orientation: Orientation) -> str:
    """How the hand is turned, in a few words."""
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
    """What ends a guarded motion early: "25 N", "held back 3 mm"."""
    force = f"{number(guard.force, 1)} N" if guard.force else ""
    stall = f"held back {number(1000 * guard.stall, 1)} mm" if guard.stall else ""
    return " or ".join(words for words in (force, stall) if words)


def direction(vector: tuple[float, float, float], both: bool = False) -> str:
    """A direction: "down", "+x", or its numbers; with ``both`` either way along it is meant ("y")."""
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


def _finite(value: float) -> float:
    return float(value) if math.isfinite(value) else 0.0


def _figure(value: object) -> str:
    return number(float(value), 4) if isinstance(value, int | float) else str(value)
