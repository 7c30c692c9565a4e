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
    Origin,
    Weighed,
    adds,
    believed,
    confirmed,
    counted,
    credible,
    invalid,
    invalid_json,
    least,
    new_record,
    phrasings,
    restarted,
    standing,
    trust_of,
    weigh,
)
from gvla2.memory.contracts import Learned, Lesson, MemoryContext, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.contradiction import conflict_of, same_lesson
from gvla2.memory.embedding import record_vectors
from gvla2.memory.events import StoredEpisode
from gvla2.memory.governance import govern
from gvla2.memory.index import STATES
from gvla2.memory.induction import RulesInducer, ungrounded
from gvla2.memory.ledger import LessonLedger, OpenBank, deciding
from gvla2.memory.records import MAX_QUERY, Record, clean, dedup_key

COUNTED = "already rests on this episode, which counts once"
CHUNK = 256
"""Lessons without an episode that share a transaction."""
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
        return cls(
            MemoryEpisode(task, (lesson,), source=clean(source, MAX_SOURCE)), credible(verdict)[0], own
        )

    @property
    def origin(self) -> Origin:
        """Its origin."""
        return Origin(self.own, self.episode.source)


@dataclass
class LessonTally:
    """Collects the fate of lessons as it is decided."""

    added: list[str] = field(default_factory=list)
    merged: list[str] = field(default_factory=list)
    provisional: list[str] = field(default_factory=list)
    discarded: int = 0
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Add a sentence, unless it is empty."""
        self.notes += [text] if text else []

    def learned(self) -> Learned:
        """The contract's answer, each id and sentence once."""
        listed = (self.added, self.merged, self.provisional, self.notes)
        added, merged, held, notes = (tuple(dict.fromkeys(entries)) for entries in listed)
        return Learned(added, merged, held, self.discarded, notes)


def learn(bank: OpenBank, episode: MemoryEpisode, verdict: Verdict) -> Learned:
    """Store what an episode teaches, credit what was recalled, govern what was touched."""
    tally = LessonTally()
    verdict, note = credible(verdict)
    tally.note(note)
    episode = replace(episode, source=clean(episode.source, MAX_SOURCE))
    own_lessons = {*map(id, episode.lessons)}
    try:
        lessons = tuple((bank.inducer or RulesInducer()).induce(episode, verdict))
        episode = replace(episode, lessons=lessons)
    except Gvla2Error as error:
        tally.note(f"The inducer failed, so the episode's own lessons were taken: {error}")
    written = [lesson for lesson in episode.lessons if id(lesson) not in own_lessons]
    judged = JudgedEpisode(episode, verdict, True, _unsure(written, episode, verdict))
    weighed = _weighed(bank, [judged], tally, bank.options.max_per_episode)
    with deciding(bank, "learn") as ledger:
        _credit(ledger, episode.recalled, verdict)
        _store_lessons(bank, ledger, weighed, tally)
    return tally.learned()


def admit(bank: OpenBank, items: Sequence[JudgedEpisode]) -> Learned:
    """Store lessons without an episode; some hundred share a transaction, so that an error keeps the ones before."""
    tally = LessonTally()
    for start in range(0, len(items), CHUNK):
        weighed = _weighed(bank, items[start : start + CHUNK], tally, 1)
        with deciding(bank, "admit") as ledger:
            _store_lessons(bank, ledger, weighed, tally)
    return tally.learned()


# Before a transaction -----------------------------------------------------------------------------------------------


def _weighed(
    bank: OpenBank, judged: Sequence[JudgedEpisode], tally: LessonTally, most: int
) -> list[tuple[JudgedEpisode, list[Weighed]]]:
    """Which lessons of each episode may be stored, ``most`` of each; embedded in one go, outside the transaction."""
    weighed = [(one, _admitted(bank, one, tally, most)) for one in judged]
    texts = [
        (phrasings("", one.episode.task.query), candidate.lesson.content)
        for one, some in weighed
        for candidate in some
    ]
    vectors = iter(record_vectors(bank.embedder, texts) if texts else ())
    return [(one, [replace(each, vector=next(vectors)) for each in some]) for one, some in weighed]


def _admitted(bank: OpenBank, one: JudgedEpisode, tally: LessonTally, most: int) -> list[Weighed]:
    episode, admitted = one.episode, dict[str, Weighed]()
    for given in episode.lessons:
        lesson = replace(given, content=clean(given.content, MAX_CONTENT))
        if wrong := invalid(lesson):
            tally.note(f"A lesson was left out: {wrong}.")
            continue
        unsure = one.unsure.get(given.content, "")
        candidate = weigh(lesson, one.verdict, bank.options, origin=one.origin, ungrounded=unsure)
        key = dedup_key(lesson.type, lesson.content, episode.task.skill, lesson.effect)
        if candidate.state is None:
            tally.note(candidate.note)
        elif key not in admitted and len(admitted) >= most:
            tally.note(f"One episode may bring {most} lessons: the rest was left out.")
        else:
            admitted.setdefault(key, replace(candidate, key=key))
    tally.discarded += len(episode.lessons) - len(admitted)
    return list(admitted.values())


def _unsure(written: Sequence[Lesson], episode: MemoryEpisode, verdict: Verdict) -> dict[str, str]:
    """Of an inducer's lessons, those not believed immediately, with the reason; those of rules always are."""
    if not written:
        return {}
    by_rule = {lesson.content for lesson in RulesInducer().induce(replace(episode, lessons=()), verdict)}
    sighted = least(item.trust for item in episode.recalled.items) != "own"
    found = {}
    for lesson in written:
        why = ungrounded(lesson, episode)
        if not why and sighted and not lesson.effect:
            why = "its author had seen text from outside"
        if why and lesson.content not in by_rule:
            found[lesson.content] = why
    return found


# Within it ----------------------------------------------------------------------------------------------------------


def _store_lessons(
    bank: OpenBank,
    ledger: LessonLedger,
    weighed: Sequence[tuple[JudgedEpisode, list[Weighed]]],
    tally: LessonTally,
) -> None:
    for one, some in weighed:
        learning = Learning(ledger, one, tally)
        for candidate in some:
            learning.add(candidate)
        if one.episode.source:
            known = ledger.transaction.episodes([one.episode.source]).get(one.episode.source)
            ledger.transaction.save_episode(_kept(known, one, learning.touched, ledger.now))
    if bank.options.governance:
        govern(bank, ledger)


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

    def __init__(self, ledger: LessonLedger, judged: JudgedEpisode, tally: LessonTally) -> None:
        self._ledger, self._episode, self._verdict = ledger, judged.episode, judged.verdict
        self._origin, self._tally = judged.origin, tally
        self.touched: list[str] = []

    def add(self, candidate: Weighed) -> None:
        """Add the lesson, merge it, promote what it confirms, or leave the bank as it is."""
        ledger, origin = self._ledger, self._origin
        fresh = new_record(ledger.transaction.bank, candidate, self._episode, self._verdict, ledger.now)
        rivals = ledger.nearest(candidate.vector, ledger.options.rivals, STATES)
        known = self._known(candidate, fresh, rivals)
        earlier = ledger.origins(known.id) if known else []
        live = known is not None and known.state != "archive"
        if known and live and not origin.own and (known.trust == "own" or not adds(earlier, origin)):
            self._unchanged(known, "gains nothing: the source is already counted, or the lesson is ours")
            return
        trust = trust_of([*earlier, origin])
        if candidate.state != "active":
            self._hold_back(replace(fresh, note=candidate.note), known, None)
        elif not believed(trust):
            note = candidate.note or "no two independent sources have confirmed it"
            self._hold_back(replace(fresh, trust=trust, state="provisional", note=note), known, origin)
        elif known and counted(known, self._episode) and known.state == "archive":
            self._unchanged(known, "stays archived: it rests on this episode already")
        elif known and counted(known, self._episode) and known.state == "active":
            self._unchanged(known, COUNTED, self._tally.merged)
        elif known and known.state == "active":
            grown = confirmed(known, fresh, self._episode, self._verdict, ledger.now)
            self._store(replace(grown, trust=trust), "MERGE", "one more episode says the same", origin)
            self._tally.merged.append(known.id)
        else:
            self._activate(replace(fresh, trust=trust), known, rivals, candidate.vector)

    def _known(
        self, candidate: Weighed, fresh: Record, rivals: Sequence[tuple[Record, float]]
    ) -> Record | None:
        """The record that says the same: with the same key, or near in other inflections."""
        known = self._ledger.transaction.by_key(candidate.key)
        if known is not None and known.state != "archive":
            return known
        states = ("active",) if candidate.trust == "own" else STATES
        for rival, cosine in rivals if self._ledger.options.governance else ():
            near = rival.state in states and cosine >= self._ledger.options.match
            if near and same_lesson(rival, fresh) and not conflict_of(rival, fresh):
                return rival
        return known

    def _hold_back(self, fresh: Record, known: Record | None, origin: Origin | None) -> None:
        """Keep a lesson that is not believed as provisional; it changes nothing that is believed or archived."""
        if known is None:
            self._provisional(fresh, "PROVISIONAL", origin)
        elif known.state == "archive":
            self._unchanged(known, "was archived: an unverified repeat changes nothing")
        elif known.state == "active":
            self._unchanged(known, "is already believed: a repeat that is not believed changes nothing")
        elif counted(known, self._episode):
            self._unchanged(known, COUNTED, self._tally.provisional)
        else:
            grown = confirmed(known, fresh, self._episode, self._verdict, self._ledger.now)
            outcome = fresh.outcome if origin else known.outcome
            self._provisional(replace(grown, outcome=outcome, trust=fresh.trust), "MERGE", origin)

    def _provisional(self, record: Record, action: str, origin: Origin | None) -> None:
        self._store(record, action, record.note, origin)
        self._tally.provisional.append(record.id)
        self._tally.note(f"{record.id} is provisional: {record.note}.")

    def _unchanged(self, known: Record, why: str, listed: list[str] | None = None) -> None:
        """The record that is known stays as it is; the lesson counts as discarded, unless it is ``listed``."""
        self._tally.discarded += listed is None
        if listed is not None:
            listed.append(known.id)
        self._tally.note(f"{known.id} {why}.")
        self._ledger.transaction.decide("DISCARD" if listed is None else "REPEATED", known.id, why=why)
        self.touched.append(known.id)

    def _activate(
        self,
        fresh: Record,
        known: Record | None,
        rivals: Sequence[tuple[Record, float]],
        vector: NDArray[np.float32],
    ) -> None:
        """Make a lesson active, unless a record of its type with more evidence contradicts it."""
        ledger, record = self._ledger, fresh
        if known is not None and known.state == "provisional":
            record = restarted(known, fresh, self._episode)
        elif known is not None:
            grown = confirmed(known, fresh, self._episode, self._verdict, ledger.now)
            record = replace(grown, state="active", outcome=fresh.outcome, trust=fresh.trust, note="")
        against = []
        for rival, _ in rivals if ledger.options.governance else ():
            if rival.state == "active" and rival.id != record.id and (why := conflict_of(record, rival)):
                against.append((rival, why))
        losers = [rival for rival, _ in against if rival.type == record.type]
        strongest = min(losers, key=standing, default=None)
        # On equal weight the later one wins. A hint and a constraint both stay, linked.
        if strongest is not None and standing(record)[:2] > standing(strongest)[:2]:
            why = f"it contradicts and is outweighed by {strongest.id}"
            self._store(replace(record, state="archive", note=why), "DISCARD", why, self._origin)
            self._tally.discarded += 1
            self._tally.note(f"{record.id} was archived: {why}.")
        else:
            action, why = "ADD", "nothing in the bank says the same"
            if strongest is not None:
                action, why = "REPLACE", f"it contradicts and outweighs {strongest.id}"
            self._store(record, action, why, self._origin, None if known else vector)
            (self._tally.merged if known else self._tally.added).append(record.id)
            if known:
                self._tally.note(f"{record.id} is verified now and became active.")
            for loser in losers:
                ledger.archive(loser, "REPLACED", f"replaced by {record.id}")
                self._tally.note(f"{record.id} replaces {loser.id}: {dict(against)[loser]}.")
        for rival, why in against:
            ledger.transaction.link(record.id, "conflict", rival.id, why)

    def _store(
        self,
        record: Record,
        action: str,
        why: str,
        origin: Origin | None,
        vector: NDArray[np.float32] | None = None,
    ) -> None:
        self._ledger.put(record, action, why, vector=vector, origin=origin)
        self.touched.append(record.id)
