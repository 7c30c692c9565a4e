"""New lessons, with an episode or without: which may be stored, and what they change, in one transaction.

Each lesson is added, merged into a record that says the same, replaces one that its typed effect contradicts, is held
back as provisional, or is discarded; governance then runs on what was touched.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import Gvla2Error
from gvla2.memory.admission import (
    Weighed,
    confirmed,
    counted,
    credible,
    invalid,
    invalid_json,
    new_record,
    phrasings,
    restarted,
    standing,
    weigh,
)
from gvla2.memory.contracts import Learned, Lesson, MemoryContext, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.contradiction import conflict_of
from gvla2.memory.embedding import record_vectors
from gvla2.memory.events import StoredEpisode
from gvla2.memory.governance import govern
from gvla2.memory.induction import RulesInducer, ungrounded
from gvla2.memory.ledger import LessonLedger, OpenBank, deciding
from gvla2.memory.records import MAX_QUERY, Record, Trust, clean, dedup_key

CHUNK = 256
"""Lessons without an episode that share a transaction."""
UNLIKE = 0.1
"""Records with a smaller cosine do not contradict each other. Lessons of one wording for different tasks may have less
than .2, as half of a vector is the task's."""
MAX_CONTENT = 2000
MAX_SOURCE = 200
MAX_TRANSCRIPT = 20_000
MAX_TAUGHT = 256
"""Maximum number of record ids in a stored episode; a record names its episodes too."""


@dataclass(frozen=True)
class JudgedEpisode:
    """An episode, its verdict, whether it is ours, and why ``unsure`` texts of a model are not believed immediately."""

    episode: MemoryEpisode
    verdict: Verdict
    own: bool
    unsure: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def lesson(
        cls, lesson: Lesson, verdict: Verdict, task: MemoryTask, source: str, *, own: bool
    ) -> JudgedEpisode:
        """One lesson without an episode."""
        episode = MemoryEpisode(task, (lesson,), source=clean(source, MAX_SOURCE))
        return cls(episode, credible(verdict)[0], own)


def learn(bank: OpenBank, episode: MemoryEpisode, verdict: Verdict) -> Learned:
    """Store what an episode teaches, credit what was recalled, govern what was touched."""
    verdict, note = credible(verdict)
    notes = [note] if note else []
    episode = replace(episode, source=clean(episode.source, MAX_SOURCE))
    own_lessons = {*map(id, episode.lessons)}
    try:
        lessons = tuple((bank.inducer or RulesInducer()).induce(episode, verdict))
        episode = replace(episode, lessons=lessons)
    except Gvla2Error as error:
        notes.append(f"The inducer failed, so the episode's own lessons were taken: {error}")
    written = [lesson for lesson in episode.lessons if id(lesson) not in own_lessons]
    judged = JudgedEpisode(episode, verdict, True, _unsure(written, episode, verdict))
    fates = [Learned(notes=tuple(notes))]
    weighed = _weighed(bank, [judged], fates, bank.options.max_per_episode)
    with deciding(bank, "learn") as ledger:
        _credit(ledger, episode.recalled, verdict)
        _store_lessons(bank, ledger, weighed, fates)
    return Learned.combined(fates)


def admit(bank: OpenBank, items: Sequence[JudgedEpisode]) -> Learned:
    """Store lessons without an episode; some hundred share a transaction, so that an error keeps the ones before."""
    fates: list[Learned] = []
    for start in range(0, len(items), CHUNK):
        weighed = _weighed(bank, items[start : start + CHUNK], fates, 1)
        with deciding(bank, "admit") as ledger:
            _store_lessons(bank, ledger, weighed, fates)
    return Learned.combined(fates)


def _weighed(
    bank: OpenBank, judged: Sequence[JudgedEpisode], fates: list[Learned], limit: int
) -> list[tuple[JudgedEpisode, list[Weighed]]]:
    """Which lessons of each episode may be stored, ``limit`` of each; embedded in one go, outside the transaction."""
    weighed = [(one, _admitted(bank, one, fates, limit)) for one in judged]
    texts = [
        (phrasings("", one.episode.task.query), candidate.lesson.content)
        for one, some in weighed
        for candidate in some
    ]
    vectors = iter(record_vectors(bank.embedder, texts) if texts else ())
    return [(one, [replace(each, vector=next(vectors)) for each in some]) for one, some in weighed]


def _admitted(bank: OpenBank, one: JudgedEpisode, fates: list[Learned], limit: int) -> list[Weighed]:
    episode, admitted, notes = one.episode, dict[str, Weighed](), list[str]()
    for given in episode.lessons:
        lesson = replace(given, content=clean(given.content, MAX_CONTENT))
        if wrong := invalid(lesson):
            notes.append(f"A lesson was left out: {wrong}.")
            continue
        trust: Trust = "own" if one.own else "foreign"
        unsure = one.unsure.get(given.content, "")
        candidate = weigh(lesson, one.verdict, bank.options, trust=trust, ungrounded=unsure)
        key = dedup_key(lesson.type, lesson.content, episode.task.skill, lesson.effect)
        if candidate.state is None:
            notes.append(candidate.note)
        elif key not in admitted and len(admitted) >= limit:
            notes.append(f"One episode may bring {limit} lessons: the rest was left out.")
        else:
            admitted.setdefault(key, replace(candidate, key=key))
    fates.append(Learned(discarded=len(episode.lessons) - len(admitted), notes=tuple(notes)))
    return list(admitted.values())


def _unsure(written: Sequence[Lesson], episode: MemoryEpisode, verdict: Verdict) -> dict[str, str]:
    """Of an inducer's lessons, those not believed immediately, with the reason; those of rules always are."""
    if not written:
        return {}
    by_rule = {lesson.content for lesson in RulesInducer().induce(replace(episode, lessons=()), verdict)}
    return {
        lesson.content: why
        for lesson in written
        if lesson.content not in by_rule and (why := ungrounded(lesson, episode))
    }


def _store_lessons(
    bank: OpenBank,
    ledger: LessonLedger,
    weighed: Sequence[tuple[JudgedEpisode, list[Weighed]]],
    fates: list[Learned],
) -> None:
    for one, some in weighed:
        learning = Learning(ledger, one)
        fates += [learning.add(candidate) for candidate in some]
        if one.episode.source:
            known = ledger.transaction.episodes([one.episode.source]).get(one.episode.source)
            ledger.transaction.save_episode(_kept(known, one, learning.touched, ledger.now))
    if bank.options.governance:
        govern(ledger)


def _credit(ledger: LessonLedger, context: MemoryContext, verdict: Verdict) -> None:
    """Count what was recalled now that the outcome is known; only a success refreshes and rewards it."""
    if verdict.outcome not in ("verified_success", "verified_fail"):
        return
    success = verdict.outcome == "verified_success"
    for id in sorted({item.id for item in context.items}):
        record = ledger.transaction.get(id)
        if record is None:
            continue
        credited = replace(record, recalled=record.recalled + 1)
        if success:
            credited = replace(credited, usage=record.usage + 1, used=ledger.now, updated=ledger.now)
        why = f"recalled for an episode: {verdict.outcome}"
        ledger.put(credited, "CREDIT" if success else "RECALLED", why)


def _kept(
    known: StoredEpisode | None, one: JudgedEpisode, touched: Sequence[str], now: float
) -> StoredEpisode:
    """The episode as replay needs it; each source has one, with its latest records."""
    episode, task = one.episode, one.episode.task
    known = known or StoredEpisode(episode.source, now, task)
    facts = {} if invalid_json(episode.facts) else dict(episode.facts)
    return replace(
        known,
        at=now,
        task=MemoryTask(clean(task.query, MAX_QUERY), {}, clean(task.skill, 64)),
        transcript=clean(episode.transcript, MAX_TRANSCRIPT) or known.transcript,
        facts=facts or known.facts,
        judged=known.judged + 1,
        records=tuple(dict.fromkeys([*known.records, *touched]))[-MAX_TAUGHT:],
    )


class Learning:
    """Adds the lessons of one episode to a bank, within one transaction."""

    def __init__(self, ledger: LessonLedger, judged: JudgedEpisode) -> None:
        self._ledger, self._episode, self._verdict = ledger, judged.episode, judged.verdict
        self._origin = f"{'own' if judged.own else 'foreign'}:{judged.episode.source}"
        self.touched: list[str] = []

    def add(self, candidate: Weighed) -> Learned:
        """Add the lesson, merge it, promote what it confirms, or leave the bank as it is."""
        ledger = self._ledger
        fresh = new_record(ledger.transaction.bank, candidate, self._episode, self._verdict, ledger.now)
        known = ledger.transaction.by_key(candidate.key)
        if candidate.state != "active":
            if known is not None:
                return self._unchanged(
                    known, f"is {known.state}: a repeat that is not believed changes nothing"
                )
            self._store(replace(fresh, note=candidate.note), "PROVISIONAL", candidate.note)
            return Learned(provisional=(fresh.id,), notes=(f"{fresh.id} is provisional: {candidate.note}.",))
        if known and known.state != "provisional" and counted(known, self._episode):
            if known.state == "archive":
                return self._unchanged(known, "stays archived: it rests on this episode already")
            return self._unchanged(known, "already rests on this episode, which counts once", "REPEATED")
        if known and known.state == "active":
            grown = confirmed(known, fresh, self._episode, self._verdict, ledger.now)
            self._store(grown, "MERGE", "one more episode says the same")
            return Learned(merged=(known.id,))
        return self._activate(fresh, known, candidate.vector)

    def _unchanged(self, known: Record, why: str, action: str = "DISCARD") -> Learned:
        """The record that is known stays as it is."""
        self._ledger.transaction.decide(action, known.id, why=why)
        self.touched.append(known.id)
        notes = (f"{known.id} {why}.",)
        return (
            Learned(discarded=1, notes=notes)
            if action == "DISCARD"
            else Learned(merged=(known.id,), notes=notes)
        )

    def _activate(self, fresh: Record, known: Record | None, vector: NDArray[np.float32]) -> Learned:
        """Make a lesson active, unless a record of its type with more evidence contradicts it."""
        ledger, record = self._ledger, fresh
        if known is not None and known.state == "provisional":
            record = restarted(known, fresh, self._episode)
        elif known is not None:
            grown = confirmed(known, fresh, self._episode, self._verdict, ledger.now)
            record = replace(grown, state="active", outcome=fresh.outcome, trust="own", note="")
        compared = ledger.options.governance and record.effect  # texts are for a judge
        near = ledger.index.nearest(vector, ledger.options.rivals) if compared else ()
        against = [
            (rival, why)
            for rival, cosine in near
            if cosine >= UNLIKE and rival.id != record.id and (why := conflict_of(record, rival))
        ]
        losers = [rival for rival, _ in against if rival.type == record.type]
        strongest = min(losers, key=standing, default=None)
        # On equal weight the later one wins. A hint and a constraint both stay, linked.
        if strongest is not None and standing(record)[:2] > standing(strongest)[:2]:
            why = f"it contradicts and is outweighed by {strongest.id}"
            self._store(replace(record, state="archive", note=why), "DISCARD", why)
            fate = Learned(discarded=1, notes=(f"{record.id} was archived: {why}.",))
        else:
            action, why = "ADD", "nothing in the bank says the same"
            if strongest is not None:
                action, why = "REPLACE", f"it contradicts and outweighs {strongest.id}"
            self._store(record, action, why, None if known else vector)
            notes = [f"{record.id} is verified now and became active."] if known else []
            for loser in losers:
                ledger.archive(loser, "REPLACED", f"replaced by {record.id}")
                notes.append(f"{record.id} replaces {loser.id}: {dict(against)[loser]}.")
            ids = (record.id,)
            fate = Learned(() if known else ids, ids if known else (), notes=tuple(notes))
        for rival, why in against:
            ledger.transaction.link(record.id, "conflict", rival.id, why)
        return fate

    def _store(
        self, record: Record, action: str, why: str, vector: NDArray[np.float32] | None = None
    ) -> None:
        self._ledger.put(record, action, why, vector=vector, origin=self._origin)
        self.touched.append(record.id)
