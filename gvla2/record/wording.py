"""A record in words: each stage's result, and the episode's outcome. The page and the terminal share them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from gvla2.episode.record import EpisodeRecord, Stage
from gvla2.record.text import count, one_line

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


def told(record: EpisodeRecord, stage: Stage) -> str:
    """What ``stage`` made in a few plain words; "" when it made nothing."""
    from gvla2.record.page import templates  # whose pages call this module

    if getattr(record, _TELLINGS[stage].field) is None:
        return ""
    macros: Any = templates().get_template("findings.jinja").module
    return str(getattr(macros, stage)(record)).strip()


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
        parts.append(f"success check: {finding(record, 'success_check')}")
    if record.verdict is not None:
        parts.append(f"verifier: {told(record, 'verify')}")
    if record.report is not None:
        parts.append(told(record, "execute"))
    if record.failure is not None:
        parts.append(f"{record.failure.kind}: {one_line(record.failure.message)}")
    elif record.plan is not None and record.plan.abstention is not None:
        parts.append(f"{record.plan.abstention.kind}: {one_line(record.plan.abstention.message)}")
    if record.timings:
        parts.append(seconds(record.seconds))
    return parts


@dataclass(frozen=True)
class _Telling:
    """The record's field for a stage, and the stage's state when what it made is not well."""

    field: str
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
    return told(record, stage)


_TELLINGS: Mapping[Stage, _Telling] = {
    "setup": _Telling("goal"),
    "observe": _Telling("observation"),
    "perceive": _Telling("scene"),
    "reconstruct": _Telling("refinement"),
    "recall": _Telling("recalled", lambda made: not made.degraded),
    "plan": _Telling("plan", lambda made: made.trajectory is not None),
    "check": _Telling("checks", lambda made: made.passed, "failed"),
    "execute": _Telling("report", lambda made: made.completed, "failed"),
    "verify": _Telling("verdict", lambda made: made.outcome == "verified_success"),
    "learn": _Telling("learned", lambda made: not made.degraded),
    "success_check": _Telling("success_check", lambda made: made.relaxed),
}
STAGES = tuple(_TELLINGS)
