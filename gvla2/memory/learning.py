"""New lessons, with an episode or without: which may be stored, and what they change, in one transaction.

Each lesson is added, merged into a record that says the same, replaces one that its typed effect contradicts, is held
back as provisional, or is discarded; budgets then decide what the bank keeps. Nothing is ever deleted here.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import Gvla2Error
from gvla2.memory.admission import (
    confirmed,
    conflict_of,
    credible,
    evidence,
    invalid,
    invalid_json,
    new_record,
    restarted,
    standing,
    weigh,
)
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Learned,
    Lesson,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Verdict,
)
from gvla2.memory.embedding import record_vectors
from gvla2.memory.index import STATES, Index
from gvla2.memory.induction import RulesInducer, ungrounded
from gvla2.memory.options import BankOptions
from gvla2.memory.records import MAX_QUERY, SECONDS_PER_DAY, Record, Trust, clean, dump, source_id
from gvla2.memory.store import Store
from gvla2.memory.tables import StoredEpisode
from gvla2.memory.transaction import Transaction

CHUNK = 256
"""Lessons without an episode that share a transaction."""
RIVALS = 16
"""Number of the nearest records that a lesson's typed effect is compared with."""
UNLIKE = 0.1
"""Records with a smaller cosine do not contradict each other. Lessons of one wording for different tasks may have less
than .2, as half of a vector is the task's."""
PROGRAMS = 3
"""Number of programs kept per skill, language and kinds of objects."""
MAX_LESSONS = 16
"""Maximum number of lessons of one episode."""
MAX_CONTENT = 2000
MAX_TRANSCRIPT = 20_000
MAX_TAUGHT = 256
"""Maximum number of record ids in a stored episode; a record names its episodes too."""
Vector = NDArray[np.float32]


@dataclass(eq=False)
class OpenBank:
    """What decisions about the bank named ``bank`` need: its store, its index in RAM, and its options.

    ``clock`` gives seconds since the epoch.
    """

    store: Store
    bank: str
    index: Index
    embedder: Embedder
    options: BankOptions
    inducer: Inducer | None
    clock: Callable[[], float]


class LessonLedger:
    """A bank within a transaction: every change goes to the store and to the index."""

    def __init__(self, transaction: Transaction, bank: OpenBank) -> None:
        self.transaction, self.index, self.options = transaction, bank.index, bank.options
        self.now: float = transaction.now
        self._embedder = bank.embedder

    def put(
        self, record: Record, action: str, why: str = "", *, vector: Vector | None = None, origin: str = ""
    ) -> Record:
        """Store a record; ``vector`` (D,) is that of its text, if known, and ``origin`` that of new evidence for it.

        Returns it as stored.
        """
        held, model = self.index.get(record.id), ""
        if record.state not in STATES:
            vector = None
            self.transaction.linked |= bool(held and held.conflicts)  # which end with it
        elif vector is None and (held is None or held.record.text != record.text):
            vector = self.vector(record)
        if vector is not None:
            model = self._embedder.model
        stored = self.transaction.put(record, action, vector=vector, model=model, why=why, origin=origin)
        self.index.put(stored, vector)
        return stored

    def vector(self, record: Record) -> Vector:
        """(D,) the vector of a record's text."""
        vector: Vector = record_vectors(self._embedder, [(record.query, record.content)])[0]
        return vector

    def archive(self, record: Record, action: str, why: str) -> None:
        """Archive a record; its note says why."""
        self.put(replace(record, state="archive", note=why), action, why)


@contextmanager
def deciding(bank: OpenBank, actor: str) -> Iterator[LessonLedger]:
    """A ledger of the current bank; the index forgets what a failed transaction put into it."""
    try:
        with bank.store.writing(bank.bank, actor=actor, now=bank.clock()) as transaction:
            if bank.index.rev != transaction.rev - 1:
                bank.index.refresh()  # no other writer from here on
            yield LessonLedger(transaction, bank)
    except BaseException:
        bank.index.clear()
        raise
    if transaction.linked or bank.store.rev(bank.bank) != transaction.rev:
        bank.index.refresh()
    else:  # the ledger has put all of it into the index
        bank.index.rev = transaction.rev


@dataclass(frozen=True)
class JudgedEpisode:
    """An episode, its verdict, whether it is ours, and why ``unsure`` texts of a model are not believed immediately."""

    episode: MemoryEpisode
    verdict: Verdict
    own: bool
    unsure: Mapping[str, str] = field(default_factory=dict)

    @property
    def origin(self) -> str:
        """The origin of its evidence, for the chain of events."""
        return f"{'own' if self.own else 'foreign'}:{self.episode.source}"

    @classmethod
    def lesson(
        cls, lesson: Lesson, verdict: Verdict, task: MemoryTask, source: str, *, own: bool
    ) -> JudgedEpisode:
        """One lesson without an episode."""
        episode = MemoryEpisode(task, (lesson,), source=source_id(source))
        return cls(episode, credible(verdict)[0], own)


def learn(bank: OpenBank, episode: MemoryEpisode, verdict: Verdict) -> Learned:
    """Store what an episode teaches, credit what was recalled, and archive the surplus."""
    verdict, note = credible(verdict)
    notes = [note] if note else []
    episode = replace(episode, source=source_id(episode.source))
    given = {*map(id, episode.lessons)}
    try:
        episode = replace(episode, lessons=tuple((bank.inducer or RulesInducer()).induce(episode, verdict)))
    except Gvla2Error as error:
        notes.append(f"The inducer failed, so the episode's own lessons were taken: {error}")
    written = [lesson for lesson in episode.lessons if id(lesson) not in given]
    judged = JudgedEpisode(episode, verdict, True, _unsure(written, episode, verdict))
    fates = [Learned(notes=tuple(notes))]
    drafts = _drafts(bank, [judged], fates, MAX_LESSONS)
    with deciding(bank, "learn") as ledger:
        _credit(ledger, episode.recalled, verdict)
        _store_lessons(ledger, drafts, fates)
    return Learned.combined(fates)


def admit(bank: OpenBank, items: Sequence[JudgedEpisode]) -> Learned:
    """Store lessons without an episode; some hundred share a transaction, so that an error keeps the ones before."""
    fates: list[Learned] = []
    for start in range(0, len(items), CHUNK):
        drafts = _drafts(bank, items[start : start + CHUNK], fates, 1)
        with deciding(bank, "admit") as ledger:
            _store_lessons(ledger, drafts, fates)
    return Learned.combined(fates)


Drafts = list[tuple[JudgedEpisode, list[tuple[Record, Vector]]]]
"""The new records that each episode may bring, in the state that they have at best, with their vectors."""


def _drafts(bank: OpenBank, judged: Sequence[JudgedEpisode], fates: list[Learned], limit: int) -> Drafts:
    """At most ``limit`` records of each episode; embedded in one go, outside the transaction."""
    drafts = [(one, _admitted(bank, one, fates, limit)) for one in judged]
    texts = [(record.query, record.content) for _, some in drafts for record in some]
    vectors = iter(record_vectors(bank.embedder, texts) if texts else ())
    return [(one, [(record, next(vectors)) for record in some]) for one, some in drafts]


def _admitted(bank: OpenBank, one: JudgedEpisode, fates: list[Learned], limit: int) -> list[Record]:
    episode, admitted, notes = one.episode, dict[str, Record](), list[str]()
    trust: Trust = "own" if one.own else "foreign"
    for given in episode.lessons:
        lesson = replace(given, content=clean(given.content, MAX_CONTENT))
        if wrong := invalid(lesson):
            notes.append(f"A lesson was left out: {wrong}.")
            continue
        unsure = one.unsure.get(given.content, "")
        state, note = weigh(lesson, one.verdict, bank.options, trust=trust, ungrounded=unsure)
        if state is None:
            notes.append(note)
            continue
        now = bank.clock()
        record = new_record(bank.bank, lesson, episode, one.verdict, now, state=state, note=note, trust=trust)
        if record.dedup_key not in admitted and len(admitted) >= limit:
            notes.append(f"One episode may bring {limit} lessons: the rest was left out.")
        else:
            admitted.setdefault(record.dedup_key, record)
    fates.append(Learned(discarded=len(episode.lessons) - len(admitted), notes=tuple(notes)))
    return list(admitted.values())


def _unsure(written: Iterable[Lesson], episode: MemoryEpisode, verdict: Verdict) -> dict[str, str]:
    """The lessons of an inducer not believed immediately, with the reason; those of rules always are."""
    by_rule = {lesson.content for lesson in RulesInducer().induce(replace(episode, lessons=()), verdict)}
    return {
        lesson.content: why
        for lesson in written
        if lesson.content not in by_rule and (why := ungrounded(lesson, episode))
    }


def _store_lessons(ledger: LessonLedger, drafts: Drafts, fates: list[Learned]) -> None:
    for one, some in drafts:
        fates += [_add(ledger, one, record, vector) for record, vector in some]
        if one.episode.source:
            known = ledger.transaction.episodes([one.episode.source]).get(one.episode.source)
            touched = [record.id for record, _ in some]
            ledger.transaction.save_episode(_kept(known, one, touched, ledger.now))
    archive_surplus(ledger)


def _credit(ledger: LessonLedger, context: MemoryContext, verdict: Verdict) -> None:
    """Count what was recalled now that the outcome is known; only a success refreshes and rewards it."""
    if verdict.outcome not in ("verified_success", "verified_fail"):
        return
    success = verdict.outcome == "verified_success"
    for record in ledger.transaction.records(ids={item.id for item in context.items}):
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
        task=MemoryTask(clean(task.query, MAX_QUERY), clean(task.skill, 64)),
        transcript=clean(episode.transcript, MAX_TRANSCRIPT) or known.transcript,
        facts=facts or known.facts,
        judged=known.judged + 1,
        records=tuple(dict.fromkeys([*known.records, *touched]))[-MAX_TAUGHT:],
    )


def _add(ledger: LessonLedger, one: JudgedEpisode, fresh: Record, vector: Vector) -> Learned:
    """Add the new record, merge it, promote what it confirms, or leave the bank as it is."""
    fresh = replace(fresh, created=ledger.now, updated=ledger.now)
    known = ledger.transaction.by_key(fresh.dedup_key)
    if known is None and fresh.state != "active":
        ledger.put(fresh, "PROVISIONAL", fresh.note, vector=vector, origin=one.origin)
        return Learned(provisional=(fresh.id,), notes=(f"{fresh.id} is provisional: {fresh.note}.",))
    if known is None:
        return _activate(ledger, one, fresh, vector=vector)
    counted = known.state != "provisional" and one.episode.source in known.sources()
    if fresh.state != "active" or (counted and known.state == "archive"):
        why = "stays archived: it rests on this episode already"
        if fresh.state != "active":
            why = f"is {known.state}: a repeat that is not believed changes nothing"
        ledger.transaction.decide("DISCARD", known.id, why=why)
        return Learned(discarded=1, notes=(f"{known.id} {why}.",))
    if counted:
        why = "already rests on this episode, which counts once"
        ledger.transaction.decide("REPEATED", known.id, why=why)
        return Learned(merged=(known.id,), notes=(f"{known.id} {why}.",))
    if known.state == "provisional":
        return _activate(ledger, one, restarted(known, fresh, one.episode), verified=True)
    grown = confirmed(known, fresh, one.episode, one.verdict, ledger.now)
    if known.state == "active":
        ledger.put(grown, "MERGE", "one more episode says the same", origin=one.origin)
        return Learned(merged=(known.id,))
    again = replace(grown, state="active", outcome=fresh.outcome, trust="own", note="")
    return _activate(ledger, one, again, verified=True)


def _activate(
    ledger: LessonLedger,
    one: JudgedEpisode,
    record: Record,
    *,
    vector: Vector | None = None,
    verified: bool = False,
) -> Learned:
    """Make a lesson active, unless a record of its type with more evidence contradicts it.

    ``vector`` (D,) is that of a new one; ``verified`` says that the bank knew it already, not active.
    """
    against: list[tuple[Record, str]] = []
    if ledger.options.governance and record.effect:  # texts are for a judge
        vector = ledger.vector(record) if vector is None else vector
        near = ledger.index.nearest(vector, RIVALS)
        rivals = [rival for rival, cosine in near if cosine >= UNLIKE and rival.id != record.id]
        against = [(rival, why) for rival in rivals if (why := conflict_of(record, rival))]
    losers = [rival for rival, _ in against if rival.type == record.type]
    strongest = min(losers, key=standing, default=None)
    # On equal weight the later one wins. A hint and a constraint both stay, linked.
    if strongest is not None and standing(record)[:2] > standing(strongest)[:2]:
        why = f"it contradicts and is outweighed by {strongest.id}"
        ledger.put(replace(record, state="archive", note=why), "DISCARD", why, origin=one.origin)
        fate = Learned(discarded=1, notes=(f"{record.id} was archived: {why}.",))
    else:
        action, why = "ADD", "nothing in the bank says the same"
        if strongest is not None:
            action, why = "REPLACE", f"it contradicts and outweighs {strongest.id}"
        ledger.put(record, action, why, vector=vector, origin=one.origin)
        notes = [f"{record.id} is verified now and became active."] if verified else []
        for loser in losers:
            ledger.archive(loser, "REPLACED", f"replaced by {record.id}")
            notes.append(f"{record.id} replaces {loser.id}: {dict(against)[loser]}.")
        ids = (record.id,)
        fate = Learned(() if verified else ids, ids if verified else (), notes=tuple(notes))
    for rival, why in against:
        ledger.transaction.link(record.id, "conflict", rival.id, why)
    return fate


def archive_surplus(ledger: LessonLedger) -> None:
    """Archive all but a few programs for the same purpose, and records beyond the budgets: first those that neither
    helped nor were confirmed by a second episode, and of these the ones that were longest untouched. Archive stale
    failures where the bank has ``governance``.
    """
    options, programs = ledger.options, defaultdict[str, list[Record]](list)
    for record in ledger.index.records("active"):
        old = ledger.now - max(record.updated, record.used) >= options.retire_days * SECONDS_PER_DAY
        if options.governance and old and not record.usage and record.outcome != "verified_success":
            ledger.archive(record, "RETIRE", f"a failure unused for {options.retire_days:g} days")
        elif "program" in record.effect and (effect := record.effect_json() or {}).get("kind") == "program":
            purpose = dump([record.type, *(effect.get(name) for name in ("skill", "language", "roles"))])
            programs[purpose].append(record)
    for some in programs.values():
        for record in sorted(some, key=lambda r: (-evidence(r), -r.usage, -r.updated, r.id))[PROGRAMS:]:
            ledger.archive(record, "ARCHIVE", f"{PROGRAMS} others have more evidence")
    for state, budget in (("active", options.active_budget), ("provisional", options.provisional_budget)):
        if (surplus := len(held := ledger.index.records(state)) - budget) > 0:
            # Segmented LRU. The released score keeps what is confident instead: a full bank then learns nothing new.
            held.sort(key=lambda r: (r.usage > 0 or r.count > 1, max(r.updated, r.used), r.confidence, r.id))
            for record in held[:surplus]:
                ledger.archive(record, "ARCHIVE", f"beyond the budget of {budget} records")
