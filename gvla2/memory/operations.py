"""A bank's transactions: learn, admit, govern, replay. Each is whole or nothing, and the index follows it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from gvla2.errors import Gvla2Error
from gvla2.memory.bank_options import BankOptions
from gvla2.memory.contracts import (
    TYPES,
    Embedder,
    Inducer,
    Learned,
    Lesson,
    LifecycleState,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Verdict,
    Verifier,
)
from gvla2.memory.curation import replay
from gvla2.memory.curation.admission import Streak, admit, believed, tempered
from gvla2.memory.curation.governance import alike, summable
from gvla2.memory.curation.governing import Governed, Governing
from gvla2.memory.curation.learning import SECONDS_PER_DAY, Candidate, Learning
from gvla2.memory.curation.ledger import Ledger, Outcome
from gvla2.memory.curation.replay import Replayed
from gvla2.memory.curation.streaks import Streaks
from gvla2.memory.indexing.index import SERVED, Index
from gvla2.memory.records import MAX_QUERY, clean, dedup_key, dump
from gvla2.memory.storage.store import Change, Store, StoredEpisode

MAX_CONTENT = 2000
MAX_SOURCE = 200
MAX_TRANSCRIPT = 20_000
LARGEST = 1e9
"""No number of an effect is larger, whatever its unit."""
MAX_TAUGHT = 256
"""Ids of records that a stored episode names; a record names its episodes, too."""


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
        self._streaks = Streaks()
        self._retired_at = -1e18

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what an episode teaches, credit what was recalled, govern what was touched."""
        outcome = Outcome()
        verdict = _believed(verdict, outcome)
        episode = replace(episode, source=clean(episode.source, MAX_SOURCE))
        episode = replace(episode, lessons=self._induced(episode, verdict, outcome))
        candidates = self._weigh(episode, verdict, outcome, self._options.max_per_episode)
        with self._writing("learn") as ledger:
            self._credit(ledger, episode.recalled, verdict)
            self._bring_in(ledger, [(episode, verdict, candidates)], outcome)
        return outcome.learned()

    def admit(self, items: Sequence[tuple[Lesson, Verdict, MemoryTask, str]]) -> Learned:
        """Store lessons that come without an episode, in one transaction."""
        outcome = Outcome()
        weighed = [
            (episode, verdict, self._decide(episode, verdict, outcome))
            for lesson, said, task, source in items
            for episode in [MemoryEpisode(task, (lesson,), source=clean(source, MAX_SOURCE))]
            for verdict in [_believed(said, outcome)]
        ]
        brought = self._embedded(weighed)
        with self._writing("admit") as ledger:
            self._bring_in(ledger, brought, outcome)
        return outcome.learned()

    def govern(self) -> Governed:
        """A pass over the whole bank."""
        done = Governed()
        with self._writing("govern") as ledger:
            active, summaries, provisional = map(ledger.held, ("active", "summary", "provisional"))
            Governing(ledger, self._options, done).whole(active, summaries, provisional)
            self._retired_at = ledger.now
        return done

    def replay(self, verifier: Verifier, *, limit: int | None = None, but: str = "") -> Replayed:
        """Verify doubtful episodes again; the verifier works outside any transaction."""
        done = Replayed()
        episodes = self._doubtful(limit, but)
        for episode in episodes:
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

    # Parts of a transaction ---------------------------------------------------------------------------------------

    @contextmanager
    def _writing(self, actor: str) -> Iterator[Ledger]:
        """A ledger of the bank as it is, whose decisions are written at the end; the index then follows."""
        changes: list[Change] | None = None
        try:
            with self._store.writing(self._index.bank, actor=actor, now=self._clock()) as transaction:
                if self._index.rev != transaction.rev - 1:
                    self._index.refresh()  # nobody else can write from here on
                before = self._index.rev
                ledger = Ledger(transaction, self._index, self._embedder.model)
                yield ledger
                changes = ledger.write()
        except BaseException:
            self._streaks = Streaks()  # verdicts were counted of which nothing is stored: read them again
            raise
        if changes is not None and before == transaction.rev - 1 and (changes or ledger.wrote):
            self._index.apply(changes)
            self._index.rev = transaction.rev
        else:
            self._index.refresh()

    def _bring_in(
        self,
        ledger: Ledger,
        episodes: Sequence[tuple[MemoryEpisode, Verdict, Sequence[Candidate]]],
        outcome: Outcome,
    ) -> None:
        self._streaks.follow(ledger.transaction)
        stored = self._stored(ledger, {episode.source for episode, _, _ in episodes if episode.source})
        ledger.expect(candidate.key for _, _, candidates in episodes for candidate in candidates)
        last: tuple[Verdict, str, str] | None = None
        streak = Streak({})
        for episode, verdict, candidates in episodes:
            # Lessons that are judged together share one verdict, which counts once.
            judged = verdict, episode.source, episode.task.query
            if last is None or judged[0] is not last[0] or judged[1:] != last[1:]:
                streak = self._streaks.advance(verdict)
                last = judged
            trusted, note = tempered(
                verdict,
                streak,
                longest=self._options.constant_verdicts,
                confidence=self._options.constant_confidence,
            )
            outcome.note(note)
            known = stored.get(episode.source)
            learning = Learning(
                ledger,
                episode,
                trusted,
                self._options,
                outcome,
                streak=streak,
                known=known.records if known else (),
            )
            for candidate in candidates:
                learning.apply(candidate)
            if episode.source:
                stored[episode.source] = self._kept(known, episode, verdict, learning.touched, ledger.now)
        self._govern_touched(ledger)
        self._streaks.seen(ledger.transaction.rev)
        for source in sorted({episode.source for episode, _, _ in episodes if episode.source}):
            ledger.keep(stored[source])

    def _govern_touched(self, ledger: Ledger) -> None:
        """What governance has to do after an episode: summaries of what it touched, the budgets, stale failures."""
        options = self._options
        if not options.governance:
            return
        governing = Governing(ledger, options, Governed())
        if ledger.now - self._retired_at > SECONDS_PER_DAY / 24:
            self._retired_at = ledger.now
            governing.retire(ledger.stale(options.retire_days))
        for record in [r for r in ledger.changed() if r.state == "active" and not r.effect]:
            if ledger.decided(record).state == "active":
                near = [r for r in ledger.rivals(record.id) if r.state == "active" and not r.effect]
                if len(near) + 1 < options.summary_size:
                    continue
                group = [record, *(r for r in near if r.id != record.id and alike(record, r, options))]
                if summable(group, options):
                    governing.sum_up(group)
        for states, budget in (
            (SERVED, options.active_budget),
            (("provisional",), options.provisional_budget),
        ):
            few, excess = ledger.beyond(states, budget)
            governing.cut(few, excess, budget)

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
            ledger.put(
                credited,
                "CREDIT" if success else "RECALLED",
                why=f"recalled for an episode: {verdict.outcome}",
            )

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
        cleaned = {clean(source, 200): source for source in sources}
        view = ledger.transaction.view
        found = view.episodes(self._index.bank, sorted(cleaned)) if cleaned else []
        return {cleaned[episode.source]: episode for episode in found}

    # Before a transaction -----------------------------------------------------------------------------------------

    def _induced(self, episode: MemoryEpisode, verdict: Verdict, outcome: Outcome) -> tuple[Lesson, ...]:
        try:
            return tuple(self._inducer.induce(episode, verdict))
        except Gvla2Error as error:
            outcome.note(f"The inducer failed, so the episode's own lessons were taken: {error}")
            return episode.lessons

    def _weigh(
        self, episode: MemoryEpisode, verdict: Verdict, outcome: Outcome, most: int
    ) -> list[Candidate]:
        decided = self._decide(episode, verdict, outcome, most)
        return self._embedded([(episode, verdict, decided)])[0][2]

    def _decide(
        self, episode: MemoryEpisode, verdict: Verdict, outcome: Outcome, most: int = 1
    ) -> list[tuple[Lesson, LifecycleState, str, str]]:
        """Which lessons may be stored, by key and with their state and a note."""
        admitted: dict[str, tuple[Lesson, LifecycleState, str, str]] = {}
        for lesson in episode.lessons:
            if lesson.type not in TYPES:
                outcome.note(
                    f"A lesson of the type '{lesson.type}' was left out: there are {', '.join(TYPES)}."
                )
                continue
            bounded = Lesson(lesson.type, clean(lesson.content, MAX_CONTENT), lesson.effect)
            if not _sound(bounded.effect):
                outcome.note("A lesson whose effect is no sound JSON was left out.")
                continue
            if wrong := _wrong_numbers(bounded.effect or {}):
                outcome.note(f"A lesson was left out whose effect has {wrong}.")
                continue
            decision = admit(
                bounded,
                verdict,
                query=episode.task.query,
                admission=self._options.admission,
                failures=self._options.failures,
            )
            key = dedup_key(bounded.type, bounded.content, episode.task.skill, bounded.effect)
            if decision.state is None:
                outcome.note(decision.note)
            elif key not in admitted and len(admitted) >= most:
                outcome.note(f"One episode may bring {most} lessons: the rest was left out.")
            else:
                admitted.setdefault(key, (bounded, decision.state, key, decision.note))
        outcome.discarded += len(episode.lessons) - len(admitted)
        return list(admitted.values())

    def _embedded(
        self,
        weighed: Sequence[tuple[MemoryEpisode, Verdict, Sequence[tuple[Lesson, LifecycleState, str, str]]]],
    ) -> list[tuple[MemoryEpisode, Verdict, list[Candidate]]]:
        """Embedded in one go, outside the transaction: embedding may take its time."""
        asked = [
            f"{' '.join(clean(episode.task.query, MAX_QUERY).split())} {lesson.content}"
            for episode, _, decided in weighed
            for lesson, _, _, _ in decided
        ]
        vectors = iter(self._embedder.embed(asked) if asked else ())
        return [
            (
                episode,
                verdict,
                [Candidate(lesson, state, key, next(vectors), note) for lesson, state, key, note in decided],
            )
            for episode, verdict, decided in weighed
        ]

    # Replay -------------------------------------------------------------------------------------------------------

    def _doubtful(self, limit: int | None, but: str) -> list[StoredEpisode]:
        with self._store.reading() as view:
            bank = self._index.bank
            contested = {
                id
                for link in view.links(bank)
                if link.kind == "conflict"
                for id in (link.source, link.target)
            }
            records = replay.doubtful(view.records(bank, ["provisional", "active"]), contested, self._options)
            sources = [source for source in replay.episodes_behind(records) if source != but]
            if limit is not None:
                sources = sources[: 8 * limit]
            found = {episode.source: episode for episode in view.episodes(bank, sources)}
        # What was looked at least often comes first, so that no episode is judged over and over.
        order = sorted(
            (source for source in sources if source in found),
            key=lambda source: (len(found[source].verdicts), sources.index(source)),
        )
        return [found[source] for source in order[:limit]]

    def _revise(self, source: str, verdict: Verdict, done: Replayed) -> None:
        with self._writing("replay") as ledger:
            episode = next(iter(ledger.transaction.view.episodes(self._index.bank, [source])), None)
            if episode is None:
                return  # forgotten meanwhile
            ids = set(episode.records)
            taught = [r for r in ledger.transaction.records(ids=sorted(ids)) if source in r.sources()]
            for record in taught:
                revision = replay.revise(record, episode, verdict, ledger.now, self._options)
                if revision is None:
                    continue
                scores = {"quality": verdict.quality, "confidence": verdict.confidence}
                ledger.put(revision.record, revision.action, why=revision.why, scores=scores)
                listed = {"PROMOTE": done.promoted, "DEMOTE": done.demoted, "CONFIRM": done.confirmed}
                listed[revision.action].append(record.id)
            ledger.keep(replay.with_verdict(episode, verdict))


def _believed(verdict: Verdict, outcome: Outcome) -> Verdict:
    verdict, note = believed(verdict)
    outcome.note(note)
    return verdict


def _wrong_numbers(effect: Mapping[str, Any]) -> str:
    """What cannot be about the numbers of an effect, "" for nothing."""
    for name, least in (("value", -LARGEST), ("sd", 0.0), ("count", 0.0)):
        number = effect.get(name, least)
        if not isinstance(number, int | float) or not least <= number <= LARGEST:
            return f"{name} {str(number)[:40]}"
    return ""


def _sound(data: Any) -> bool:
    try:
        dump(dict(data or {})).encode()
    except (TypeError, ValueError, RecursionError):
        return False
    return True
