"""Re-verification: which episodes, and what a second verdict means for their lessons."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from gvla2.memory.admission import credible, pooled_quality, standing, weigh
from gvla2.memory.asking import verdict_of
from gvla2.memory.contracts import Evidence, Lesson, Verdict, Verifier
from gvla2.memory.contradiction import conflict_of
from gvla2.memory.events import StoredEpisode
from gvla2.memory.ledger import LessonLedger, OpenBank, deciding
from gvla2.memory.options import BankOptions
from gvla2.memory.records import Record


@dataclass
class Replayed:
    """The result of a replay: ids by decision, the number of episodes, and why some could not be judged."""

    promoted: list[str] = field(default_factory=list)
    demoted: list[str] = field(default_factory=list)
    confirmed: list[str] = field(default_factory=list)
    episodes: int = 0
    notes: list[str] = field(default_factory=list)


def replay(bank: OpenBank, verifier: Verifier, *, limit: int | None = None, but: str = "") -> Replayed:
    """Verify doubtful episodes again, at most ``limit``, except that of source ``but``; the verifier works outside any
    transaction.
    """
    done = Replayed()
    for episode in _asked(bank, limit, but):
        shown = Evidence(episode.task.query, episode.transcript, episode.facts)
        verdict, _ = credible(verdict_of(verifier, shown))
        done.episodes += 1
        if verdict.outcome == "unavailable":
            done.notes += verdict.reasons
        else:
            _revise(bank, episode.source, verdict, done)
    return done


def _asked(bank: OpenBank, limit: int | None, but: str) -> list[StoredEpisode]:
    """The episodes behind doubtful records (provisional, contested or uncertain), the least certain first.

    Those judged least often come before all others, so that none is judged over and over.
    """
    with bank.store.reading(bank.bank) as view:
        records = view.records(["provisional", "active"])
        contested = view.conflicts({record.id for record in records})
        least, listed = bank.options.replay_confidence, dict[str, None]()
        for one in sorted(records, key=lambda one: (one.confidence, one.updated, one.id)):
            if one.state == "provisional" or one.id in contested or one.confidence < least:
                listed |= dict.fromkeys(reversed(one.sources()))  # the latest one first
        sources = [source for source in listed if source != but][: None if limit is None else 8 * limit]
        episodes = view.episodes(sources)
    kept = [episodes[source] for source in sources if source in episodes]
    return sorted(kept, key=lambda episode: episode.judged)[:limit]


def _revise(bank: OpenBank, source: str, verdict: Verdict, done: Replayed) -> None:
    with deciding(bank, "replay") as ledger:
        episode = ledger.transaction.episodes([source]).get(source)
        if episode is None:
            return  # forgotten meanwhile
        for record in ledger.transaction.records(ids=episode.records):
            action, changed, why = revised(record, verdict, ledger.now, bank.options)
            if not action or source not in record.sources():
                continue
            stored = ledger.put(changed, action, why)
            if action == "PROMOTE":
                _settle(ledger, stored)
            listed = {"PROMOTE": done.promoted, "DEMOTE": done.demoted, "CONFIRM": done.confirmed}
            listed[action].append(record.id)
        ledger.transaction.save_episode(replace(episode, judged=episode.judged + 1))


def _settle(ledger: LessonLedger, promoted: Record) -> None:
    """Archive what contradicts a promoted record, or that itself if it is outweighed."""
    for rival in ledger.held("active"):
        if rival.id != promoted.id and rival.type == promoted.type and (why := conflict_of(promoted, rival)):
            winner, loser = sorted((promoted, rival), key=standing)
            ledger.archive(loser, "REPLACED", f"replaced by {winner.id}")
            ledger.transaction.link(winner.id, "conflict", loser.id, why)
            if loser.id == promoted.id:
                return


def revised(record: Record, verdict: Verdict, now: float, options: BankOptions) -> tuple[str, Record, str]:
    """The effect on a record of a new verdict on one of its episodes: the change's name (PROMOTE, DEMOTE, CONFIRM, or
    "" for none), the record, and why.

    A provisional record is promoted when the verdict would have admitted it. A verified one whose own verdict is
    contradicted is demoted, unless other episodes still outweigh the doubt. Otherwise the verdicts are pooled.
    """
    lesson = Lesson(record.type, record.content, record.effect_json())
    state = weigh(lesson, verdict, replace(options, admission=True), trust=record.trust).state
    again = f"verified again: {verdict.outcome}"
    if record.state == "provisional":
        judged = replace(record, outcome=verdict.outcome, note="", updated=now)
        if state == "active":
            sure = replace(judged, quality=verdict.quality, confidence=verdict.confidence)
            return "PROMOTE", replace(sure, state="active"), again
        if verdict.outcome == "verified_fail" and record.type != "failure_avoidance":
            why = "its episode failed, so its recipe is void"
            return "DEMOTE", replace(judged, state="archive", updated=record.updated, note=why), why
    if record.state != "active":
        return "", record, ""
    quality, confidence = pooled_quality(record.quality, record.count, verdict.quality)
    pooled = replace(record, quality=quality, confidence=confidence, updated=now)
    if verdict.outcome in ("uncertain", record.outcome):
        return "CONFIRM", pooled, again
    if record.count > 1 and confidence >= options.replay_confidence:
        return "CONFIRM", pooled, f"one of {record.count} episodes was judged differently this time"
    why = f"its episode was judged {verdict.outcome} this time, {record.outcome} before"
    return "DEMOTE", replace(pooled, state="archive" if state is None else "provisional", note=why), why
