"""Verifying again: which episodes, and what a second verdict means for what they taught. Decisions on plain data."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace

from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import Evidence, Lesson, LifecycleState, Verdict
from gvla2.memory.curation.admission import admit
from gvla2.memory.curation.evidence import pooled_quality
from gvla2.memory.records import Record
from gvla2.memory.storage.store import StoredEpisode

MAX_VERDICTS = 16
"""Verdicts kept with an episode; the first one and the latest."""


@dataclass
class Replayed:
    """What a replay did: ids by decision, how many episodes were judged, and how often nobody could judge."""

    promoted: list[str] = field(default_factory=list)
    demoted: list[str] = field(default_factory=list)
    confirmed: list[str] = field(default_factory=list)
    episodes: int = 0
    unavailable: int = 0
    notes: list[str] = field(default_factory=list)
    degraded: str = ""


@dataclass(frozen=True)
class Revision:
    """A record after a second verdict: what to call the change (PROMOTE, DEMOTE or CONFIRM), and why."""

    action: str
    record: Record
    why: str


def doubtful(records: Iterable[Record], contested: Collection[str], options: BankOptions) -> list[Record]:
    """What is worth verifying again: provisional, contested or low-confidence records, the least sure first."""
    found = [
        record
        for record in records
        if record.state == "provisional"
        or (
            record.state == "active"
            and (record.id in contested or record.confidence < options.replay_confidence)
        )
    ]
    return sorted(found, key=lambda record: (record.confidence, record.updated, record.id))


def evidence_of(episode: StoredEpisode) -> Evidence:
    """What a verifier gets to see of a stored episode."""
    return Evidence(episode.task.query, episode.transcript, episode.facts)


def with_verdict(episode: StoredEpisode, verdict: Verdict) -> StoredEpisode:
    """The episode with one more verdict."""
    verdicts = (*episode.verdicts, verdict)
    kept = verdicts if len(verdicts) <= MAX_VERDICTS else (verdicts[0], *verdicts[-MAX_VERDICTS + 1 :])
    return replace(episode, verdicts=kept)


def revise(
    record: Record, episode: StoredEpisode, verdict: Verdict, now: float, options: BankOptions
) -> Revision | None:
    """What a new verdict on one of its episodes makes of a record; None where it changes nothing.

    A provisional record is promoted when the verdict would have admitted it. A verified one whose own verdict is
    contradicted is demoted, unless other episodes still outweigh the doubt. Otherwise the verdicts are pooled.
    """
    if verdict.outcome == "unavailable" or record.state not in ("provisional", "active"):
        return None
    lesson = Lesson(record.type, record.content, record.effect_json())
    decision = admit(lesson, verdict, trust=record.trust, failures=options.failures)
    if record.state == "provisional":
        return _reconsidered(record, verdict, decision.state == "active", now)
    contradicted = verdict.outcome != "uncertain" and verdict.outcome != record.outcome
    quality, confidence = pooled_quality(record.quality, record.count, verdict.quality)
    pooled = replace(record, quality=quality, confidence=confidence, updated=now)
    if not contradicted:
        return Revision("CONFIRM", pooled, f"verified again: {verdict.outcome}")
    if record.count > 1 and confidence >= options.replay_confidence:
        return Revision("CONFIRM", pooled, f"one of {record.count} episodes was judged otherwise this time")
    state: LifecycleState = "archive" if decision.state is None else "provisional"
    why = f"its episode was judged {verdict.outcome} this time, {record.outcome} before"
    return Revision("DEMOTE", replace(pooled, state=state, note=why), why)


def _reconsidered(record: Record, verdict: Verdict, admitted: bool, now: float) -> Revision | None:
    if admitted:
        why = f"verified again: {verdict.outcome}"
        promoted = replace(
            record,
            state="active",
            outcome=verdict.outcome,
            quality=verdict.quality,
            confidence=verdict.confidence,
            note="",
            updated=now,
        )
        return Revision("PROMOTE", promoted, why)
    if verdict.outcome == "verified_fail" and record.type != "failure_avoidance":
        why = "its episode failed: a recipe from it is none"
        return Revision("DEMOTE", replace(record, state="archive", outcome="verified_fail", note=why), why)
    return None


def episodes_behind(records: Sequence[Record], limit: int | None = None) -> list[str]:
    """The sources of these records, in their order, each once, the latest of each record first."""
    sources: dict[str, None] = {}
    for record in records:
        for source in reversed(record.sources()):
            sources.setdefault(source)
    return list(sources)[:limit]
