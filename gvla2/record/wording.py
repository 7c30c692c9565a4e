"""A record in words: what each stage found, and how the episode went. The page and the terminal share them."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable
from typing import Literal, get_args

from gvla2.record.contents import EpisodeRecord, Stage

State = Literal["done", "warn", "failed", "skipped"]
"""How a stage ended: as it should; with a reservation (abstained, rejected); broken off; not reached."""

STAGES: tuple[Stage, ...] = get_args(Stage)

OUTCOMES = {
    "verified_success": "success",
    "verified_fail": "failure",
    "uncertain": "uncertain",
    "unavailable": "no verdict",
}
"""The verifier's outcomes in words."""


def one_line(text: str, limit: int = 160) -> str:
    """``text`` on one line, without control characters (a terminal would obey them), at most ``limit`` long."""
    safe = "".join(" " if unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") else c for c in text)
    safe = "".join(c for c in " ".join(safe.split()) if unicodedata.category(c) != "Cf")
    return safe if len(safe) <= limit else safe[: limit - 1].rstrip() + "…"


def count(number: int, one: str, many: str = "") -> str:
    """A number with its noun: "1 waypoint", "8 waypoints"."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def listing(words: Iterable[str], limit: int = 4) -> str:
    """The first few words and how many more there are."""
    given = list(words)
    more = f" and {len(given) - limit} more" if len(given) > limit else ""
    return ", ".join(given[:limit]) + more


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


def state(record: EpisodeRecord, stage: Stage) -> State:
    """How ``stage`` ended."""
    if record.failure is not None and record.failure.stage == stage:
        return "warn" if stage == "plan" and record.plan is not None and record.plan.abstention else "failed"
    match stage:
        case "setup":
            return "done" if "setup" in record.timings or record.observation is not None else "skipped"
        case "observe":
            return "done" if record.observation is not None else "skipped"
        case "perceive":
            return "done" if record.scene is not None else "skipped"
        case "reconstruct":
            return "done" if record.refinement or "reconstruct" in record.timings else "skipped"
        case "recall":
            if record.recalled is None:
                return "skipped"
            return "warn" if record.recalled.degraded else "done"
        case "plan":
            if record.plan is None:
                return "skipped"
            return "done" if record.plan.trajectory is not None else "warn"
        case "check":
            if record.checks is None:
                return "skipped"
            return "done" if record.checks.passed else "failed"
        case "execute":
            if record.report is None:
                return "skipped"
            return "done" if record.report.completed else "failed"
        case "verify":
            if record.verdict is None:
                return "skipped"
            return "done" if record.verdict.outcome == "verified_success" else "warn"
        case "learn":
            if record.learned is None:
                return "skipped"
            return "warn" if record.learned.degraded else "done"
        case "judge":
            if record.judgement is None:
                return "skipped"
            return "done" if record.judgement.eased else "warn"


def finding(record: EpisodeRecord, stage: Stage) -> str:
    """What ``stage`` found, in a few plain words; "" when it was not reached."""
    failure = record.failure
    if failure is not None and failure.stage == stage:
        return one_line(failure.message or failure.kind)
    match stage:
        case "setup":
            return one_line(record.goal)
        case "observe":
            views = record.observation.views if record.observation else ()
            return f"{count(len(views), 'view')}: {listing(v.name for v in views)}" if len(views) else ""
        case "perceive":
            if record.scene is None:
                return ""
            labels = listing(one_line(o.label or o.id, 40) for o in record.scene.objects)
            return count(len(record.scene.objects), "object") + (f": {labels}" if labels else "")
        case "reconstruct":
            return one_line(record.refinement)
        case "recall":
            return _recalled(record)
        case "plan":
            return _planned(record)
        case "check":
            return _checked(record)
        case "execute":
            return executed(record)
        case "verify":
            return judged(record)
        case "learn":
            return _learnt(record)
        case "judge":
            judgement = record.judgement
            return f"eased {_yes(judgement.eased)}, strict {_yes(judgement.strict)}" if judgement else ""


def executed(record: EpisodeRecord) -> str:
    """How far the motion came: "8 of 8 waypoints"."""
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


def headline(record: EpisodeRecord) -> tuple[str, Literal["good", "bad", "unsure"]]:
    """The episode in two or three words, and how that sounds. A referee's word counts before a verifier's."""
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
        word = OUTCOMES[record.verdict.outcome]
        tone: Literal["good", "bad", "unsure"] = (
            "good" if word == "success" else "bad" if word == "failure" else "unsure"
        )
        return f"Verifier: {word}", tone
    if record.report is not None:
        return ("Carried out", "unsure") if record.report.completed else ("Stopped on the way", "bad")
    return "Unfinished", "unsure"


def summary_line(record: EpisodeRecord) -> str:
    """The episode on one line: outcome, referee, verifier, waypoints, what went wrong, and wall time."""
    return " | ".join([headline(record)[0], *details(record)])


def details(record: EpisodeRecord) -> list[str]:
    """What stands behind the headline, in short pieces."""
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


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _recalled(record: EpisodeRecord) -> str:
    recalled = record.recalled
    if recalled is None:
        return ""
    if recalled.degraded:
        return f"memory unavailable: {one_line(recalled.degraded)}"
    if recalled.abstained:
        return f"nothing used: {one_line(recalled.abstained)}"
    if not recalled.items:
        return "nothing remembered"
    binding = sum(item.binding for item in recalled.items)
    return count(len(recalled.items), "record") + (f", {binding} binding" if binding else "")


def _planned(record: EpisodeRecord) -> str:
    plan = record.plan
    if plan is None:
        return ""
    if plan.abstention is not None:
        return f"abstained, {plan.abstention.kind}: {one_line(plan.abstention.message)}"
    if plan.trajectory is None:
        return "no trajectory"
    skill = f", skill {one_line(plan.skill, 40)}" if plan.skill else ""
    place = f"part {len(record.whole)}: " if record.partial else ""
    left = f", {count(len(plan.remaining), 'call')} to come" if plan.remaining else ""
    return place + count(len(plan.trajectory), "waypoint") + skill + left


def _checked(record: EpisodeRecord) -> str:
    checks = record.checks
    if checks is None:
        return ""
    repaired = f", {count(len(checks.repairs), 'repair')}" if checks.repairs else ""
    if checks.passed:
        return f"all checks passed{repaired}"
    return f"rejected{repaired}: {one_line(listing(checks.reasons, 2))}"


def _learnt(record: EpisodeRecord) -> str:
    learned = record.learned
    if learned is None:
        return ""
    if learned.degraded:
        return f"nothing stored: {one_line(learned.degraded)}"
    counts = (
        ("added", len(learned.added)),
        ("merged", len(learned.merged)),
        ("provisional", len(learned.provisional)),
        ("discarded", learned.discarded),
    )
    return ", ".join(f"{n} {word}" for word, n in counts if n) or "nothing new"
