"""The words, numbers and rows of an episode for pages and terminals; no markup."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from gvla2.episode.record import EpisodeRecord, Stage
from gvla2.planning.contracts import Candidate, Plan
from gvla2.planning.scene import Scene, SceneObject
from gvla2.record.text import count, listing, one_line

State = Literal["done", "warn", "failed", "skipped"]
"""How a stage ended: normally; with a reservation (abstained, rejected); aborted; not reached."""

Tone = Literal["good", "bad", "unsure"]

OUTCOMES = {
    "verified_success": "success",
    "verified_fail": "failure",
    "uncertain": "uncertain",
    "unavailable": "no verdict",
}
"""The verifier's outcomes in words."""

TONES: Mapping[str, Tone] = {"verified_success": "good", "verified_fail": "bad", "uncertain": "unsure"}
"""Their tones."""


@dataclass(frozen=True)
class Step:
    """One step of the bar under a page's header: its name, how it ended, its wall seconds, and what it found."""

    name: str
    state: State
    seconds: float | None
    finding: str


def number(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, "–" for none or not-a-number."""
    return "–" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


def fixed(value: float | None, digits: int) -> str:
    """A number with exactly ``digits`` decimals, "–" for none or not-a-number."""
    return "–" if value is None or not math.isfinite(value) else f"{value:z.{digits}f}"


def seconds(value: float | None) -> str:
    """Wall time, "0.4 s"."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.1f} s" if value >= 0.095 else f"{1000 * value:.0f} ms"


def result_of(record: EpisodeRecord, stage: Stage) -> str:
    """The result of ``stage`` in a few plain words; "" when it has none."""
    if _REPORTS[stage][0](record) is None:
        return ""
    return str(getattr(_findings(), stage)(record)).strip()


@cache
def _findings() -> Any:
    """The macros of ``findings.jinja``, one a stage; plain text, so that nothing is escaped."""
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "counted": count, "fixed": fixed, "label_of": label_of, "listing": listing, "one_line": one_line,
    }  # fmt: skip
    return environment.get_template("findings.jinja").module


def headline(record: EpisodeRecord) -> tuple[str, Tone]:
    """The episode in two or three words, and their tone. The success check takes precedence over a verifier's."""
    stopped = record.failure is not None and record.failure.stage not in ("verify", "success_check")
    if stopped and record.parts and record.report is None:
        return f"Stopped before part {len(record.whole)}", "bad"
    if record.plan is not None and record.plan.abstention is not None:
        return "Declined, nothing moved", "unsure"
    if record.success_check is not None and record.report is not None:
        if not record.success_check.relaxed:
            return "Not achieved", "bad"
        return "Succeeded" if record.success_check.strict else "Succeeded (relaxed)", "good"
    if record.checks is not None and not record.checks.passed and record.report is None:
        return "Rejected before motion", "bad"
    if stopped and record.failure is not None:
        return f"Stopped at {record.failure.stage}", "bad"
    if record.verdict is not None and record.verdict.outcome != "unavailable":
        return f"Verifier: {OUTCOMES[record.verdict.outcome]}", TONES[record.verdict.outcome]
    if record.report is not None:
        return ("Carried out", "unsure") if record.report.completed else ("Stopped on the way", "bad")
    return "Unfinished", "unsure"


def summary_line(record: EpisodeRecord) -> str:
    """The episode on one line: outcome, success check, verifier, waypoints, what went wrong, and wall time."""
    return " | ".join([headline(record)[0], *details(record)])


def details(record: EpisodeRecord) -> list[str]:
    """Details behind the headline, in short pieces."""
    parts: list[str] = [count(len(record.whole), "part")] if record.parts else []
    if record.success_check is not None:
        parts.append(f"success check: {result_of(record, 'success_check')}")
    if record.verdict is not None:
        parts.append(f"verifier: {result_of(record, 'verify')}")
    if record.report is not None:
        parts.append(result_of(record, "execute"))
    if record.failure is not None:
        parts.append(f"{record.failure.kind}: {one_line(record.failure.message)}")
    elif record.plan is not None and record.plan.abstention is not None:
        parts.append(f"{record.plan.abstention.kind}: {one_line(record.plan.abstention.message)}")
    if record.timings:
        parts.append(seconds(record.seconds))
    return parts


def state(record: EpisodeRecord, stage: Stage) -> State:
    """How ``stage`` ended."""
    if record.failure is not None and record.failure.stage == stage:
        return "warn" if stage == "plan" and record.plan is not None and record.plan.abstention else "failed"
    of, well = _REPORTS[stage]
    made = of(record)
    if made is None or made == "":
        return "done" if stage in record.timings and stage in ("setup", "reconstruct") else "skipped"
    return "done" if well(made) else "failed" if stage in ("check", "execute") else "warn"


def finding(record: EpisodeRecord, stage: Stage) -> str:
    """The result of ``stage`` in a few plain words; "" when it was not reached."""
    failure = record.failure
    if failure is not None and failure.stage == stage:
        return one_line(failure.message or failure.kind)
    return result_of(record, stage)


_REPORTS: Mapping[Stage, tuple[Callable[[EpisodeRecord], Any], Callable[[Any], bool]]] = {
    "setup": (lambda r: r.goal, bool),
    "observe": (lambda r: r.observation, lambda made: True),
    "perceive": (lambda r: r.scene, lambda made: True),
    "reconstruct": (lambda r: r.refined, lambda made: True),
    "recall": (lambda r: r.recalled, lambda made: not made.degraded),
    "plan": (lambda r: r.plan, lambda made: made.trajectory is not None),
    "check": (lambda r: r.checks, lambda made: made.passed),
    "execute": (lambda r: r.report, lambda made: made.completed),
    "verify": (lambda r: r.verdict, lambda made: made.outcome == "verified_success"),
    "learn": (lambda r: r.learned, lambda made: not made.degraded),
    "success_check": (lambda r: r.success_check, lambda made: made.relaxed),
}
"""The output of each stage, from the record, and whether that output is well."""
STAGES = tuple(_REPORTS)


def share(value: float | None, whole: float) -> float:
    """A number as percent of another, for a bar; 0 if either is undefined."""
    return 100 * value / whole if value and whole and math.isfinite(value) and math.isfinite(whole) else 0.0


def steps(record: EpisodeRecord) -> list[Step]:
    """All stages, in the order they run."""
    times = record.timings
    return [Step(each, state(record, each), times.get(each), finding(record, each)) for each in STAGES]


def label_of(obj: SceneObject) -> str:
    """The object's name."""
    return obj.label or obj.id


def called(object_id: str, scene: Scene | None) -> str:
    """The label of the scene object with this id; the id itself ("table") if there is none."""
    objects = scene.objects if scene is not None else ()
    return next((label_of(o) for o in objects if o.id == object_id), object_id)


def call_words(record: EpisodeRecord) -> list[str]:
    """The plan's calls with labels in place of ids: "place(red cube, drawer, in)"."""
    scene, calls = record.scene, record.plan.calls if record.plan else ()
    named = [replace(c, theme=called(c.theme, scene), goal=called(c.goal, scene)) for c in calls]
    return list(map(str, named))


def ranked_candidates(plan: Plan) -> list[tuple[Candidate, bool]]:
    """(candidate, chosen) from best to worst; the best one not rejected was chosen."""

    def rank(candidate: Candidate) -> tuple[bool, float]:
        return bool(candidate.rejected), -candidate.score if math.isfinite(candidate.score) else 0.0

    order = sorted(plan.candidates, key=rank)
    chosen = order[0] if order and not order[0].rejected and plan.trajectory is not None else None
    return [(candidate, candidate is chosen) for candidate in order]
