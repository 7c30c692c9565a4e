"""The attempts of an episode as the page's table shows them."""

from __future__ import annotations

from dataclasses import dataclass

from gvla2.record.contents import EpisodeRecord
from gvla2.record.wording import OUTCOMES, executed, one_line


@dataclass(frozen=True)
class AttemptRow:
    """One attempt in words; ``tone`` colours its verdict, ``ended`` says why it went no further or failed."""

    skill: str
    executed: str
    verdict: str
    tone: str
    ended: str
    seconds: float


def attempt_rows(record: EpisodeRecord) -> list[AttemptRow]:
    """All attempts, first to last."""
    return [_row(each) for each in (*record.attempts, record)]


def _row(attempt: EpisodeRecord) -> AttemptRow:
    outcome = attempt.verdict.outcome if attempt.verdict else ""
    return AttemptRow(
        skill=attempt.plan.skill if attempt.plan else "",
        executed=executed(attempt) or "nothing",
        verdict=OUTCOMES.get(outcome, ""),
        tone={"verified_success": "good", "verified_fail": "bad"}.get(outcome, "unsure"),
        ended=f"{attempt.failure.kind}: {one_line(attempt.failure.message)}" if attempt.failure else "",
        seconds=sum(attempt.timings.values()),
    )
