"""Second looks at a bank: a judge decides which lessons in words contradict each other, a verifier judges again.

Both work outside any transaction, and what they decide is stored in short ones.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from itertools import islice

from gvla2.memory.admission import conflict_of, credible, pooled_quality, standing, verdict_of, weigh
from gvla2.memory.contracts import Evidence, Judge, Judgement, Lesson, LessonPair, Verdict, Verifier
from gvla2.memory.learning import LessonLedger, OpenBank, deciding
from gvla2.memory.options import BankOptions
from gvla2.memory.records import Record
from gvla2.memory.tables import StoredEpisode
from gvla2.memory.view import pairs_of

PAIRS = 16
"""Maximum number of pairs of lessons that a judge decides at a time."""
NEAREST, MATCH = 4, 0.35
"""Number of records near to each that a judge compares it with, and their least cosine."""


def judge(bank: OpenBank, judge: Judge, about: Collection[str]) -> None:
    """Let the judge decide pairs of similar lessons in words, one of each pair in ``about``.

    Of two of one type that contradict each other the less trusted is archived, of equally trusted ones the one with
    less evidence; a hint and a constraint both stay, linked. A pair that it leaves open is asked about again later.
    """
    bank.index.refresh()
    pairs = list(islice(_undecided(bank, about), PAIRS))
    answers = (
        judge.judge([LessonPair(a.content, b.content, a.query, b.query) for a, b in pairs]) if pairs else ()
    )
    given = zip(pairs, answers, strict=True)
    if decided := [(pair, answer) for pair, answer in given if answer.contradicts is not None]:
        with deciding(bank, "judge") as ledger:
            for (a, b), answer in decided:
                _settle_words(ledger, a.id, b.id, answer)


def _settle_words(ledger: LessonLedger, first_id: str, second_id: str, answer: Judgement) -> None:
    first, second = ledger.transaction.get(first_id), ledger.transaction.get(second_id)
    if first is None or second is None or {first.state, second.state} != {"active"}:
        return  # changed meanwhile
    why = f"{answer.judge}: {answer.reason} (p = {answer.probability:.2f})"
    ledger.transaction.link(first.id, "conflict" if answer.contradicts else "dismissed", second.id, why)
    if answer.contradicts and first.type == second.type:
        winner, loser = sorted((first, second), key=standing)
        ledger.archive(loser, "JUDGED", f"contradicted by {winner.id}")


def _undecided(bank: OpenBank, about: Collection[str]) -> Iterable[tuple[Record, Record]]:
    """Similar lessons in words that no judge has decided on, the latest first."""
    with bank.store.reading(bank.bank) as view:
        linked = pairs_of(view.links())
    seen = linked["conflict"] | linked["dismissed"]
    records = [record for record in bank.index.records("active") if not record.effect]
    for record in sorted(records, key=lambda r: (-r.updated, r.id)):
        held = bank.index.get(record.id)
        if held is None or record.id not in about:
            continue
        for other, cosine in bank.index.nearest(held.vector, NEAREST + 1):
            pair = (min(record.id, other.id), max(record.id, other.id))
            if other.id == record.id or other.effect or pair in seen or cosine < MATCH:
                continue
            if record.skill and other.skill and record.skill != other.skill:
                continue
            seen.add(pair)
            yield record, other


def replay(bank: OpenBank, verifier: Verifier, *, limit: int = 1, but: str = "") -> None:
    """Verify doubtful episodes again, and promote or demote their lessons accordingly.

    At most ``limit`` episodes, except that of source ``but``. A verifier that is unavailable changes nothing.
    """
    for episode in _doubtful(bank, limit, but):
        shown = Evidence(episode.task.query, episode.transcript, episode.facts)
        verdict, _ = credible(verdict_of(verifier, shown))
        if verdict.outcome != "unavailable":
            _revise(bank, episode.source, verdict)


def _doubtful(bank: OpenBank, limit: int, but: str) -> list[StoredEpisode]:
    """The episodes behind doubtful records (provisional, contested or uncertain), the least certain first.

    Those judged least often come before all others, so that none is judged over and over.
    """
    least, listed = bank.options.replay_confidence, dict[str, None]()
    for held in sorted(
        bank.index.held(), key=lambda held: (held.record.confidence, held.record.updated, held.record.id)
    ):
        one = held.record
        if one.state == "provisional" or held.conflicts or one.confidence < least:
            listed |= dict.fromkeys(reversed(one.sources()))  # the latest one first
    sources = [source for source in listed if source != but][: 8 * limit]
    with bank.store.reading(bank.bank) as view:
        episodes = view.episodes(sources)
    kept = [episodes[source] for source in sources if source in episodes]
    return sorted(kept, key=lambda episode: episode.judged)[:limit]


def _revise(bank: OpenBank, source: str, verdict: Verdict) -> None:
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
