"""A bank's transactions: learn, admit, govern, replay. Each is whole or nothing, and the index follows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from gvla2.errors import Gvla2Error
from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import (
    TYPES,
    Consolidator,
    Embedder,
    Inducer,
    Judge,
    Learned,
    Lesson,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Verdict,
    Verifier,
)
from gvla2.memory.curation import replay, rewriting
from gvla2.memory.curation.admission import Decision, admit, believed
from gvla2.memory.curation.governance import SECONDS_PER_DAY, Governed, Governing
from gvla2.memory.curation.induction import RulesInducer, ungrounded
from gvla2.memory.curation.judging import Judged, decide, open_suspicions
from gvla2.memory.curation.learning import Candidate, Learning
from gvla2.memory.curation.ledger import Ledger, Outcome
from gvla2.memory.curation.replay import Replayed
from gvla2.memory.curation.trust import Origin, least
from gvla2.memory.indexing.index import Index
from gvla2.memory.indexing.rows import SERVED
from gvla2.memory.records import MAX_QUERY, clean, dedup_key, dump
from gvla2.memory.storage.store import Store, StoredEpisode

MAX_CONTENT = 2000
MAX_SOURCE = 200
MAX_TRANSCRIPT = 20_000
LARGEST = 1e9
"""No number of an effect is larger, whatever its unit."""
MAX_TAUGHT = 256
"""Ids of records that a stored episode names; a record names its episodes, too."""

NOTHING: Mapping[str, str] = MappingProxyType({})
Brought = tuple[MemoryEpisode, Verdict, bool]
"""An episode, its verdict, and whether it is one of ours."""


class Operations:
    """What changes a bank. Not safe among threads; safe among processes."""

    def __init__(
        self,
        store: Store,
        index: Index,
        embedder: Embedder,
        inducer: Inducer,
        options: BankOptions,
        clock: Callable[[], float],
    ) -> None:
        self._store, self._index, self._embedder = store, index, embedder
        self._inducer, self._options, self._clock = inducer, options, clock
        self._retired_at = -1e18

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what an episode teaches, credit what was recalled, govern what was touched."""
        outcome = Outcome()
        verdict, note = believed(verdict)
        outcome.note(note)
        episode = replace(episode, source=clean(episode.source, MAX_SOURCE))
        told = {*map(id, episode.lessons)}
        try:
            episode = replace(episode, lessons=tuple(self._inducer.induce(episode, verdict)))
        except Gvla2Error as error:
            outcome.note(f"The inducer failed, so the episode's own lessons were taken: {error}")
        written = [lesson for lesson in episode.lessons if id(lesson) not in told]
        brought = (episode, verdict, True)
        unsure = _unsure(written, episode, verdict)
        candidates = self._weigh([brought], outcome, self._options.max_per_episode, unsure)
        with self.writing("learn") as ledger:
            self._credit(ledger, episode.recalled, verdict)
            self._bring_in(ledger, [brought], candidates, outcome)
        return outcome.learned()

    def admit(self, items: Sequence[tuple[Lesson, Verdict, MemoryTask, str, bool]]) -> Learned:
        """Store lessons that come without an episode, in one transaction; the last of each: whether it is trusted."""
        outcome = Outcome()
        brought = []
        for lesson, said, task, source, trusted in items:
            verdict, note = believed(said)
            outcome.note(note)
            brought.append(
                (MemoryEpisode(task, (lesson,), source=clean(source, MAX_SOURCE)), verdict, trusted)
            )
        candidates = self._weigh(brought, outcome, 1)
        with self.writing("admit") as ledger:
            self._bring_in(ledger, brought, candidates, outcome)
        return outcome.learned()

    def govern(self) -> Governed:
        """A pass over the whole bank."""
        done = Governed()
        with self.writing("govern") as ledger:
            Governing(ledger, self._options, done).whole()
            self._retired_at = ledger.now
        return done

    def replay(self, verifier: Verifier, *, limit: int | None = None, but: str = "") -> Replayed:
        """Verify doubtful episodes again; the verifier works outside any transaction."""
        done = Replayed()
        for episode in self._doubtful(limit, but):
            try:
                verdict, _ = believed(verifier.verify(replay.evidence_of(episode)))
            except Gvla2Error as error:
                verdict = Verdict.unavailable(str(error))
            done.episodes += 1
            if verdict.outcome == "unavailable":
                done.unavailable += 1
                done.notes += [reason for reason in verdict.reasons[:1] if reason not in done.notes]
                continue
            self._revise(episode.source, verdict, done)
        return done

    def judge(self, judge: Judge, *, limit: int | None = None) -> Judged:
        """Let suspicions be decided; the judge works outside any transaction."""
        done = Judged()
        with self._store.reading() as view:
            pairs = open_suspicions((x.source, x.kind, x.target) for x in view.links(self._index.bank))
            named = {id for pair in pairs for id in pair}
            records = {record.id: record for record in view.records(self._index.bank, SERVED, named)}
        rulings = decide(judge, pairs, records, done, limit=limit) if pairs else []
        if not rulings:
            return done
        with self.writing("judge") as ledger:
            for ruling in rulings:
                pair = [ledger.get(id) for id in (ruling.first, ruling.second)]
                if any(record is None or record.state not in SERVED for record in pair):
                    continue  # changed meanwhile
                ledger.link(ruling.first, ruling.kind, ruling.second, ruling.why)
                for record in pair:
                    if record is not None and record.id == ruling.loser:
                        winner = ruling.second if record.id == ruling.first else ruling.first
                        note = f"contradicted by {winner}"
                        ledger.put(replace(record, state="archive", note=note), "JUDGED", note)
                        ledger.link(winner, "replaces", record.id, ruling.why)
                        done.archived.append(record.id)
        return done

    def consolidate(self, writer: Consolidator, *, limit: int | None = None) -> rewriting.Rewritten:
        """Let lessons be merged, replaced or discarded by who can write; he works outside any transaction."""
        done = rewriting.Rewritten()
        self._index.refresh()
        with self._store.reading() as view:
            considered = view.decided(self._index.bank, rewriting.CONSIDERED)
        answers = []
        for record, near in rewriting.asked(self._index, considered, self._options, limit):
            try:
                (shown,) = rewriting.told([record])
                answers.append((record, near, writer.consolidate(shown, rewriting.told(near))))
            except Gvla2Error as error:
                done.notes += [str(error)] if str(error) not in done.notes else []
        if answers:
            with self.writing("consolidate") as ledger:
                for record, near, edit in answers:
                    rewriting.carry_out(ledger, self._options, record, near, edit, done)
        return done

    @contextmanager
    def writing(self, actor: str) -> Iterator[Ledger]:
        """A ledger of the bank as it is, whose decisions are written at the end; the index then follows."""
        with self._store.writing(self._index.bank, actor=actor, now=self._clock()) as transaction:
            if self._index.rev != transaction.rev - 1:
                self._index.refresh()  # nobody else can write from here on
            ledger = Ledger(transaction, self._index, self._embedder)
            yield ledger
            ledger.write()
        self._index.refresh()

    # Parts of a transaction ---------------------------------------------------------------------------------------

    def _bring_in(
        self,
        ledger: Ledger,
        brought: Sequence[Brought],
        candidates: Sequence[Sequence[Candidate]],
        outcome: Outcome,
    ) -> None:
        options = self._options
        governing = Governing(ledger, options)
        stored = self._stored(ledger, {episode.source for episode, _, _ in brought if episode.source})
        ledger.expect(candidate.key for some in candidates for candidate in some)
        for (episode, verdict, own), some in zip(brought, candidates, strict=True):
            known = stored.get(episode.source)
            learning = Learning(ledger, episode, verdict, options, outcome, own=own)
            for candidate in some:
                learning.apply(candidate)
            if episode.source:
                stored[episode.source] = self._kept(known, episode, verdict, learning.touched, ledger.now)
            for id in learning.touched if options.governance else ():
                record = ledger.get(id)
                if record is not None and record.state == "active":
                    governing.sum_up(record, learning.rivals.get(id))
        if options.governance:
            if ledger.now - self._retired_at > SECONDS_PER_DAY / 24:
                self._retired_at = ledger.now
                governing.retire()
            governing.touched()
        for source in sorted({episode.source for episode, _, _ in brought if episode.source}):
            ledger.keep(stored[source])

    def _credit(self, ledger: Ledger, context: MemoryContext, verdict: Verdict) -> None:
        """Count what was recalled now that the outcome is known; only a success refreshes and rewards it."""
        if verdict.outcome not in ("verified_success", "verified_fail"):
            return
        success = verdict.outcome == "verified_success"
        for id in sorted({item.id for item in context.items}):
            record = ledger.get(id)
            if record is None:
                continue
            credited = replace(record, recalled=record.recalled + 1)
            if success:
                credited = replace(credited, usage=record.usage + 1, used=ledger.now, updated=ledger.now)
            why = f"recalled for an episode: {verdict.outcome}"
            ledger.put(credited, "CREDIT" if success else "RECALLED", why)

    def _kept(
        self,
        known: StoredEpisode | None,
        episode: MemoryEpisode,
        verdict: Verdict,
        touched: Sequence[str],
        now: float,
    ) -> StoredEpisode:
        """The episode as replay needs it; one source has one, with all that it taught of late."""
        taught = list(dict.fromkeys([*(known.records if known else ()), *touched]))[-MAX_TAUGHT:]
        facts = dict(episode.facts) if _sound(episode.facts) else {}
        stored = StoredEpisode(
            source=clean(episode.source, 200),
            at=now,
            task=MemoryTask(clean(episode.task.query, MAX_QUERY), {}, clean(episode.task.skill, 64)),
            lessons=tuple(
                Lesson(lesson.type, clean(lesson.content, MAX_CONTENT))
                for lesson in episode.lessons[: self._options.max_per_episode]
            ),
            transcript=clean(episode.transcript, MAX_TRANSCRIPT) or (known.transcript if known else ""),
            facts=facts or (known.facts if known else {}),
            verdicts=known.verdicts if known else (),
            records=tuple(taught),
            provenance={clean(str(k), 64): clean(str(v), 200) for k, v in episode.provenance.items()},
        )
        return replay.with_verdict(stored, verdict)

    def _stored(self, ledger: Ledger, sources: set[str]) -> dict[str, StoredEpisode]:
        found = ledger.transaction.view.episodes(self._index.bank, sources) if sources else []
        return {episode.source: episode for episode in found}

    # Before a transaction -----------------------------------------------------------------------------------------

    def _weigh(
        self, brought: Sequence[Brought], outcome: Outcome, most: int, unsure: Mapping[str, str] = NOTHING
    ) -> list[list[Candidate]]:
        """Which lessons of each episode may be stored; embedded in one go, outside the transaction.

        ``unsure`` are texts that a model wrote, each with why it is not to be believed at once.
        """
        decided = [self._decide(*one, outcome, most, unsure) for one in brought]
        asked = [
            f"{' '.join(clean(episode.task.query, MAX_QUERY).split())} {lesson.content}"
            for (episode, _, _), admitted in zip(brought, decided, strict=True)
            for lesson, _ in admitted.values()
        ]
        vectors = iter(self._embedder.embed(asked) if asked else ())
        return [
            [
                Candidate(lesson, d.state or "provisional", d.trust, key, next(vectors), d.note, d.screened)
                for key, (lesson, d) in admitted.items()
            ]
            for admitted in decided
        ]

    def _decide(
        self,
        episode: MemoryEpisode,
        verdict: Verdict,
        own: bool,
        outcome: Outcome,
        most: int,
        unsure: Mapping[str, str],
    ) -> dict[str, tuple[Lesson, Decision]]:
        """Which lessons may be stored, by key, and what is decided on each."""
        admitted: dict[str, tuple[Lesson, Decision]] = {}
        for lesson in episode.lessons:
            if lesson.type not in TYPES:
                outcome.note(
                    f"A lesson of the type '{lesson.type}' was left out: there are {', '.join(TYPES)}."
                )
                continue
            bounded = replace(lesson, content=clean(lesson.content, MAX_CONTENT))
            if not _sound(bounded.effect):
                outcome.note("A lesson whose effect is no sound JSON was left out.")
                continue
            if wrong := _wrong_numbers(bounded.effect or {}):
                outcome.note(f"A lesson was left out whose effect has {wrong}.")
                continue
            decision = admit(
                bounded,
                verdict,
                origin=Origin(own, episode.source),
                admission=self._options.admission,
                failures=self._options.failures,
                ungrounded=unsure.get(lesson.content, ""),
            )
            key = dedup_key(bounded.type, bounded.content, episode.task.skill, bounded.effect)
            if decision.state is None:
                outcome.note(decision.note)
            elif key not in admitted and len(admitted) >= most:
                outcome.note(f"One episode may bring {most} lessons: the rest was left out.")
            else:
                admitted.setdefault(key, (bounded, decision))
        outcome.discarded += len(episode.lessons) - len(admitted)
        return admitted

    # Replay -------------------------------------------------------------------------------------------------------

    def _doubtful(self, limit: int | None, but: str) -> list[StoredEpisode]:
        with self._store.reading() as view:
            bank = self._index.bank
            records = view.records(bank, ["provisional", "active"])
            contested = view.conflicts(bank, [record.id for record in records])
            doubtful = replay.doubtful(records, contested, self._options)
            sources = [source for source in replay.episodes_behind(doubtful) if source != but]
            if limit is not None:
                sources = sources[: 8 * limit]
            found = {episode.source: episode for episode in view.episodes(bank, sources)}
        # What was looked at least often comes first, so that no episode is judged over and over.
        places = {source: place for place, source in enumerate(sources) if source in found}
        order = sorted(places, key=lambda source: (len(found[source].verdicts), places[source]))
        return [found[source] for source in order[:limit]]

    def _revise(self, source: str, verdict: Verdict, done: Replayed) -> None:
        with self.writing("replay") as ledger:
            episode = next(iter(ledger.transaction.view.episodes(self._index.bank, [source])), None)
            if episode is None:
                return  # forgotten meanwhile
            for record in ledger.transaction.records(ids=episode.records):
                if source not in record.sources():
                    continue
                revision = replay.revise(record, episode, verdict, ledger.now, self._options)
                if revision is None:
                    continue
                scores = {"quality": verdict.quality, "confidence": verdict.confidence}
                ledger.put(revision.record, revision.action, revision.why, scores)
                listed = {"PROMOTE": done.promoted, "DEMOTE": done.demoted, "CONFIRM": done.confirmed}
                listed[revision.action].append(record.id)
            ledger.keep(replay.with_verdict(episode, verdict))


def _unsure(written: Sequence[Lesson], episode: MemoryEpisode, verdict: Verdict) -> dict[str, str]:
    """Of lessons that an inducer wrote, those that are not believed at once, with the reason; rules are."""
    if not written:
        return {}
    by_rule = {lesson.content for lesson in RulesInducer().induce(replace(episode, lessons=()), verdict)}
    sighted = least(item.trust for item in episode.recalled.items) != "own"
    found = {}
    for lesson in written:
        why = "" if lesson.content in by_rule else ungrounded(lesson, episode)
        if not why and lesson.content not in by_rule and sighted and not lesson.effect:
            why = "it was written with text from outside in sight"
        if why:
            found[lesson.content] = why
    return found


def _wrong_numbers(effect: Mapping[str, Any]) -> str:
    """What cannot be about the numbers of an effect, "" for nothing."""
    for name, lowest in (("value", -LARGEST), ("sd", 0.0), ("count", 0.0)):
        number = effect.get(name, lowest)
        if not isinstance(number, int | float) or not lowest <= number <= LARGEST:
            return f"{name} {str(number)[:40]}"
    return ""


def _sound(data: Any) -> bool:
    try:
        dump(dict(data or {})).encode()
    except (TypeError, ValueError, RecursionError):
        return False
    return True
