"""A record in words: each stage's result, and the episode's outcome. The page and the terminal share them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gvla2.geometry.views import Observation
from gvla2.memory.contracts import Learned, MemoryContext
from gvla2.planning.contracts import Plan
from gvla2.planning.findings import CheckReport
from gvla2.planning.scene import Scene
from gvla2.record.contents import EpisodeRecord, Stage
from gvla2.record.text import count, listing, one_line
from gvla2.robot.backend import SuccessCheck

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


def number(value: float | None, digits: int = 3) -> str:
    """A number with ``digits`` decimals at most, "–" for none or not-a-number."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    if text in ("0", "-0"):
        return "0" if value == 0 else f"{value:.2g}"
    return text


def fixed(value: float | None, digits: int) -> str:
    """A number with exactly ``digits`` decimals, "–" for none or not-a-number."""
    return "–" if value is None or not math.isfinite(value) else f"{value:z.{digits}f}"


def seconds(value: float | None) -> str:
    """Wall time, "0.4 s"."""
    if value is None or not math.isfinite(value):
        return "–"
    return (
        f"{value:.0f} s" if value >= 100 else f"{value:.1f} s" if value >= 0.095 else f"{1000 * value:.0f} ms"
    )


def executed(record: EpisodeRecord) -> str:
    """How far the motion got: "8 of 8 waypoints"."""
    report = record.report
    if report is None:
        return ""
    planned = len(record.plan.trajectory) if record.plan and record.plan.trajectory else len(report.waypoints)
    done = sum(not w.abort for w in report.waypoints)
    text = f"{done} of {count(planned, 'waypoint')}"
    abort = report.abort
    if abort is not None:
        text += f", stopped at waypoint {abort.index} ({one_line(abort.stage, 24)}): {abort.abort}"
    return text


def judged(record: EpisodeRecord) -> str:
    """The verifier's outcome and quality: "verified_success 0.93"."""
    verdict = record.verdict
    if verdict is None:
        return ""
    return verdict.outcome + ("" if verdict.outcome == "unavailable" else f" {fixed(verdict.quality, 2)}")


def headline(record: EpisodeRecord) -> tuple[str, Tone]:
    """The episode in two or three words, and their tone. A referee's verdict takes precedence over a verifier's."""
    stopped = record.failure is not None and record.failure.stage not in ("verify", "judge")
    if stopped and record.parts and record.report is None:
        return f"Stopped before part {len(record.whole)}", "bad"
    if record.plan is not None and record.plan.abstention is not None:
        return "Declined, nothing moved", "unsure"
    if record.judgement is not None and record.report is not None:
        if not record.judgement.eased:
            return "Not achieved", "bad"
        return "Succeeded" if record.judgement.strict else "Succeeded (eased)", "good"
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
    """The episode on one line: outcome, referee, verifier, waypoints, what went wrong, and wall time."""
    return " | ".join([headline(record)[0], *details(record)])


def details(record: EpisodeRecord) -> list[str]:
    """Details behind the headline, in short pieces."""
    parts: list[str] = [count(len(record.whole), "part")] if record.parts else []
    if record.judgement is not None:
        parts.append(f"referee: {finding(record, 'judge')}")
    if record.verdict is not None:
        parts.append(f"verifier: {judged(record)}")
    if record.report is not None:
        parts.append(executed(record))
    if record.failure is not None:
        parts.append(f"{record.failure.kind}: {one_line(record.failure.message)}")
    elif record.plan is not None and record.plan.abstention is not None:
        parts.append(f"{record.plan.abstention.kind}: {one_line(record.plan.abstention.message)}")
    if record.timings:
        parts.append(seconds(record.seconds))
    return parts


@dataclass(frozen=True)
class _Telling:
    """How a stage is told: the record's field for it, what was made in words, and its state when that is not well."""

    field: str
    words: Callable[[EpisodeRecord, Any], str]
    well: Callable[[Any], bool] = lambda made: True
    otherwise: State = "warn"


def state(record: EpisodeRecord, stage: Stage) -> State:
    """How ``stage`` ended."""
    if record.failure is not None and record.failure.stage == stage:
        return "warn" if stage == "plan" and record.plan is not None and record.plan.abstention else "failed"
    telling = _TELLINGS[stage]
    made = getattr(record, telling.field)
    if made is None or made == "":
        return "done" if stage in record.timings and stage in ("setup", "reconstruct") else "skipped"
    return "done" if telling.well(made) else telling.otherwise


def finding(record: EpisodeRecord, stage: Stage) -> str:
    """The result of ``stage`` in a few plain words; "" when it was not reached."""
    failure = record.failure
    if failure is not None and failure.stage == stage:
        return one_line(failure.message or failure.kind)
    telling = _TELLINGS[stage]
    made = getattr(record, telling.field)
    return "" if made is None else telling.words(record, made)


def _observed(_: EpisodeRecord, observation: Observation) -> str:
    views = observation.views
    return f"{count(len(views), 'view')}: {listing(v.name for v in views)}" if len(views) else ""


def _perceived(_: EpisodeRecord, scene: Scene) -> str:
    labels = listing(one_line(o.label or o.id, 40) for o in scene.objects)
    return count(len(scene.objects), "object") + (f": {labels}" if labels else "")


def _recalled(_: EpisodeRecord, recalled: MemoryContext) -> str:
    if recalled.degraded:
        return f"memory unavailable: {one_line(recalled.degraded)}"
    if recalled.abstained:
        return f"nothing used: {one_line(recalled.abstained)}"
    if not recalled.items:
        return "nothing remembered"
    binding = sum(item.binding for item in recalled.items)
    return count(len(recalled.items), "record") + (f", {binding} binding" if binding else "")


def _planned(record: EpisodeRecord, plan: Plan) -> str:
    if plan.abstention is not None:
        return f"abstained, {plan.abstention.kind}: {one_line(plan.abstention.message)}"
    if plan.trajectory is None:
        return "no trajectory"
    skill = f", skill {one_line(plan.skill, 40)}" if plan.skill else ""
    place = f"part {len(record.whole)}: " if record.partial else ""
    left = f", {count(len(plan.remaining), 'call')} to come" if plan.remaining else ""
    return place + count(len(plan.trajectory), "waypoint") + skill + left


def _checked(_: EpisodeRecord, checks: CheckReport) -> str:
    repaired = f", {count(len(checks.repairs), 'repair')}" if checks.repairs else ""
    if checks.passed:
        return f"all checks passed{repaired}"
    return f"rejected{repaired}: {one_line(listing(checks.reasons, 2))}"


def _learnt(_: EpisodeRecord, learned: Learned) -> str:
    if learned.degraded:
        return f"nothing stored: {one_line(learned.degraded)}"
    counts = {name: len(getattr(learned, name)) for name in ("added", "merged", "provisional")}
    counts["discarded"] = learned.discarded
    return ", ".join(f"{n} {word}" for word, n in counts.items() if n) or "nothing new"


def _ruled(_: EpisodeRecord, judgement: SuccessCheck) -> str:
    eased, strict = ("yes" if met else "no" for met in (judgement.eased, judgement.strict))
    return f"eased {eased}, strict {strict}"


_TELLINGS: Mapping[Stage, _Telling] = {
    "setup": _Telling("goal", lambda _, goal: one_line(goal)),
    "observe": _Telling("observation", _observed),
    "perceive": _Telling("scene", _perceived),
    "reconstruct": _Telling("refinement", lambda _, refinement: one_line(refinement)),
    "recall": _Telling("recalled", _recalled, lambda made: not made.degraded),
    "plan": _Telling("plan", _planned, lambda made: made.trajectory is not None),
    "check": _Telling("checks", _checked, lambda made: made.passed, "failed"),
    "execute": _Telling("report", lambda record, _: executed(record), lambda made: made.completed, "failed"),
    "verify": _Telling(
        "verdict", lambda record, _: judged(record), lambda made: made.outcome == "verified_success"
    ),
    "learn": _Telling("learned", _learnt, lambda made: not made.degraded),
    "judge": _Telling("judgement", _ruled, lambda made: made.eased),
}
STAGES = tuple(_TELLINGS)
