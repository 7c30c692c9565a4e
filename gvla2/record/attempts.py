"""The attempts of an episode, and the parts of a program, as the page's tables show them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gvla2.record.contents import EpisodeRecord
from gvla2.record.wording import OUTCOMES, executed, one_line


@dataclass(frozen=True)
class AttemptRow:
    """One attempt or part in words; ``tone`` colours its verdict, ``ended`` says why it went no further or failed.

    ``calls`` are what the plan carried out of a program. ``parts`` is how many plans an attempt took.
    """

    skill: str
    executed: str
    verdict: str
    tone: str
    ended: str
    seconds: float
    calls: tuple[str, ...] = ()
    parts: int = 1


def attempt_rows(record: EpisodeRecord) -> list[AttemptRow]:
    """All attempts, first to last."""
    return [_row(each) for each in (*record.attempts, replace(record, attempts=()))]


def part_rows(record: EpisodeRecord) -> list[AttemptRow]:
    """All parts of the last attempt, first to last; one where there was no program of several."""
    return [_row(each) for each in record.whole]


def _row(attempt: EpisodeRecord) -> AttemptRow:
    outcome = attempt.verdict.outcome if attempt.verdict else ""
    return AttemptRow(
        skill=attempt.plan.skill if attempt.plan else "",
        executed=executed(attempt) or "nothing",
        verdict=OUTCOMES.get(outcome, ""),
        tone={"verified_success": "good", "verified_fail": "bad"}.get(outcome, "unsure"),
        ended=f"{attempt.failure.kind}: {one_line(attempt.failure.message)}" if attempt.failure else "",
        seconds=attempt.seconds,
        calls=_in_words(attempt),
        parts=len(attempt.whole),
    )


def _in_words(attempt: EpisodeRecord) -> tuple[str, ...]:
    """The plan's calls with labels in place of ids: "place(red cube, drawer, in)"."""
    if attempt.plan is None:
        return ()
    names = {o.id: o.label or o.id for o in attempt.scene.objects} if attempt.scene is not None else {}
    return tuple(
        str(replace(call, theme=names.get(call.theme, call.theme), goal=names.get(call.goal, call.goal)))
        for call in attempt.plan.calls
    )
