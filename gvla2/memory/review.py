"""Second looks at a bank: a judge decides which lessons in words contradict each other, a verifier judges again.

Both work outside any transaction, and what they decide is stored in short ones.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field, replace
from itertools import islice

from gvla2.memory.admission import conflict_of, credible, pooled_quality, standing, verdict_of, weigh
from gvla2.memory.contracts import Evidence, Judge, Lesson, LessonPair, Verdict, Verifier
from gvla2.memory.learning import LessonLedger, OpenBank, deciding
from gvla2.memory.options import BankOptions
from gvla2.memory.records import Record
from gvla2.memory.tables import StoredEpisode
from gvla2.memory.view import pairs_of

BATCH = 16
"""Pairs per request to a judge."""
NEAREST, MATCH = 4, 0.35
"""Number of records near to each that a judge compares it with, and their least cosine."""
Pair = tuple[str, str]


@dataclass
class Judged:
    """The result of judging: pairs of ids by decision, ids of the archived ones, and why pairs were left open."""

    conflicts: list[Pair] = field(default_factory=list)
    dismissed: list[Pair] = field(default_factory=list)
    archived: list[str] = field(default_factory=list)
    open: list[str] = field(default_factory=list)


def judge(
    bank: OpenBank, judge: Judge, *, about: Collection[str] | None = None, limit: int | None = None
) -> Judged:
    """Let the judge decide at most ``limit`` pairs of similar lessons in words, with a record in ``about`` if given.

    Of two of one type that contradict each other the less trusted is archived, of equally trusted ones the one with
    less evidence; a hint and a constraint both stay, linked.
    """
    done = Judged()
    bank.index.refresh()
    pairs = list(islice(_undecided(bank, about), limit))
    for start in range(0, len(pairs), BATCH):
        batch = pairs[start : start + BATCH]
        shown = [LessonPair(a.content, b.content, a.query, b.query) for a, b in batch]
        answers = list(zip(batch, judge.judge(shown), strict=True))
        done.open += [answer.reason for _, answer in answers if answer.contradicts is None]
        decided = [(pair, answer) for pair, answer in answers if answer.contradicts is not None]
        if not decided:
            continue
        with deciding(bank, "judge") as ledger:
            for pair, answer in decided:
                first, second = (ledger.transaction.get(record.id) for record in pair)
                if first is None or second is None or {first.state, second.state} != {"active"}:
                    continue  # changed meanwhile
                why = f"{answer.judge}: {answer.reason} (p = {answer.probability:.2f})"
                kind = "conflict" if answer.contradicts else "dismissed"
                ledger.transaction.link(first.id, kind, second.id, why)
                (done.conflicts if answer.contradicts else done.dismissed).append((first.id, second.id))
                if answer.contradicts and first.type == second.type:
                    winner, loser = sorted((first, second), key=standing)
                    ledger.archive(loser, "JUDGED", f"contradicted by {winner.id}")
                    done.archived.append(loser.id)
    return done


def _undecided(bank: OpenBank, about: Collection[str] | None) -> Iterable[tuple[Record, Record]]:
    """Similar lessons in words that no judge has decided on, the latest first."""
    with bank.store.reading(bank.bank) as view:
        linked = pairs_of(view.links())
    seen = linked["conflict"] | linked["dismissed"]
    records = [record for record in bank.index.records("active") if not record.effect]
    for record in sorted(records, key=lambda r: (-r.updated, r.id)):
        held = bank.index.get(record.id)
        if held is None or (about is not None and record.id not in about):
            continue
        for other, cosine in bank.index.nearest(held.vector, NEAREST + 1):
            pair = (min(record.id, other.id), max(record.id, other.id))
            if other.id == record.id or other.effect or pair in seen or cosine < MATCH:
                continue
            if record.skill and other.skill and record.skill != other.skill:
                continue
            seen.add(pair)
            yield record, other


@dataclass
class Replayed:
    """The result of a replay: ids by decision, the number of episodes, and why some could not be judged."""

    promoted: list[str] = field(default_factory=list)
    demoted: list[str] = field(default_factory=list)
    confirmed: list[str] = field(default_factory=list)
    episodes: int = 0
    notes: list[str] = field(default_factory=list)


def replay(bank: OpenBank, verifier: Verifier, *, limit: int | None = None, but: str = "") -> Replayed:
    """Verify doubtful episodes again, and promote or demote their lessons accordingly.

    At most ``limit`` episodes, except that of source ``but``. A verifier that is unavailable changes nothing.
    """
    done = Replayed()
    for episode in _doubtful(bank, limit, but):
        shown = Evidence(episode.task.query, episode.transcript, episode.facts)
        verdict, _ = credible(verdict_of(verifier, shown))
        done.episodes += 1
        if verdict.outcome == "unavailable":
            done.notes += verdict.reasons
        else:
            _revise(bank, episode.source, verdict, done)
    return done


def _doubtful(bank: OpenBank, limit: int | None, but: str) -> list[StoredEpisode]:
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
    for rival in ledger.index.records("active"):
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
    state, _ = weigh(lesson, verdict, replace(options, admission=True), trust=record.trust)
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
