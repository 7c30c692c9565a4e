"""New lessons, with an episode or without: which may be stored, and the consequences, in one transaction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import TYPES, Learned, Lesson, MemoryContext, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.curation.admission import Weighed, credible, weigh
from gvla2.memory.curation.evidence import phrasings
from gvla2.memory.curation.governance import Governed, Governing
from gvla2.memory.curation.induction import RulesInducer, ungrounded
from gvla2.memory.curation.learning import Brought, Learning, LessonTally
from gvla2.memory.curation.ledger import BankLedger, deciding
from gvla2.memory.curation.replay import with_verdict
from gvla2.memory.curation.trust import least
from gvla2.memory.indexing.candidates import SECONDS_PER_DAY
from gvla2.memory.records import MAX_QUERY, clean, dedup_key, dump
from gvla2.memory.storage.events import StoredEpisode

if TYPE_CHECKING:
    from gvla2.memory.bank import KnowledgeBank

CHUNK = 256
"""Lessons without an episode that share a transaction."""
MAX_CONTENT = 2000
MAX_SOURCE = 200
MAX_TRANSCRIPT = 20_000
LARGEST = 1e9
"""Upper limit of an effect's numbers, in any unit."""
MAX_TAUGHT = 256
"""Most record ids in a stored episode; a record names its episodes too."""


def learn(bank: KnowledgeBank, episode: MemoryEpisode, verdict: Verdict) -> Learned:
    """Store what an episode teaches, credit what was recalled, govern what was touched."""
    tally = LessonTally()
    verdict, note = credible(verdict)
    tally.note(note)
    episode = replace(episode, source=clean(episode.source, MAX_SOURCE))
    told = {*map(id, episode.lessons)}
    try:
        lessons = tuple((bank.inducer or RulesInducer()).induce(episode, verdict))
        episode = replace(episode, lessons=lessons)
    except Gvla2Error as error:
        tally.note(f"The inducer failed, so the episode's own lessons were taken: {error}")
    unsure = _unsure([lesson for lesson in episode.lessons if id(lesson) not in told], episode, verdict)
    brought = Brought(episode, verdict, True, unsure)
    weighed = _weighed(bank, [brought], tally, bank.options.max_per_episode)
    with deciding(bank, "learn") as ledger:
        _credit(ledger, episode.recalled, verdict)
        _bring_in(bank, ledger, weighed, tally)
    return tally.learned()


def admit(
    bank: KnowledgeBank, items: Sequence[tuple[Lesson, Verdict, MemoryTask, str]], own: bool
) -> Learned:
    """Store lessons without an episode, each with its verdict, task and source; ``own``: as ours."""
    tally = LessonTally()
    for start in range(0, len(items), CHUNK):
        brought: list[Brought] = []
        for lesson, said, task, source in items[start : start + CHUNK]:
            verdict, note = credible(said)
            tally.note(note)
            episode = MemoryEpisode(task, (lesson,), source=clean(source, MAX_SOURCE))
            brought.append(Brought(episode, verdict, own, {}))
        weighed = _weighed(bank, brought, tally, 1)
        with deciding(bank, "admit") as ledger:
            _bring_in(bank, ledger, weighed, tally)
    return tally.learned()


# Before a transaction -------------------------------------------------------------------------------------------------


def _weighed(
    bank: KnowledgeBank, brought: Sequence[Brought], tally: LessonTally, most: int
) -> list[tuple[Brought, list[Weighed]]]:
    """Which lessons of each episode may be stored, ``most`` of each; embedded in one go, outside the transaction."""
    weighed = [(one, _admitted(bank, one, tally, most)) for one in brought]
    asked = [
        f"{phrasings('', one.episode.task.query)} {candidate.lesson.content}"
        for one, some in weighed
        for candidate in some
    ]
    vectors = iter(bank.embedder.embed(asked) if asked else ())
    return [(one, [replace(each, vector=next(vectors)) for each in some]) for one, some in weighed]


def _admitted(bank: KnowledgeBank, one: Brought, tally: LessonTally, most: int) -> list[Weighed]:
    episode, admitted = one.episode, dict[str, Weighed]()
    for told in episode.lessons:
        lesson = replace(told, content=clean(told.content, MAX_CONTENT))
        if wrong := _wrong(lesson):
            tally.note(f"A lesson was left out: {wrong}.")
            continue
        unsure = one.unsure.get(told.content, "")
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


def _wrong(lesson: Lesson) -> str:
    """Why a lesson of any origin cannot be stored; "" if it can."""
    if lesson.type not in TYPES:
        return f"there is no type '{lesson.type}', only {', '.join(TYPES)}"
    if why := _unsound(lesson.effect):
        return f"its effect is not valid JSON ({why})"
    for name, lowest in (("value", -LARGEST), ("sd", 0.0), ("count", 0.0)):
        number = (lesson.effect or {}).get(name, lowest)
        if not isinstance(number, int | float) or not lowest <= number <= LARGEST:
            return f"its effect has {name} {str(number)[:40]}"
    return ""


def _unsound(data: Any) -> str:
    """Why data cannot be stored as JSON, "" if it can."""
    try:
        dump(dict(data or {})).encode()
    except (TypeError, ValueError, RecursionError) as error:
        return str(error)
    return ""


# Within it ------------------------------------------------------------------------------------------------------------


def _bring_in(
    bank: KnowledgeBank,
    ledger: BankLedger,
    weighed: Sequence[tuple[Brought, list[Weighed]]],
    tally: LessonTally,
) -> None:
    options, governing = bank.options, Governing(ledger, Governed())
    sources = {one.episode.source for one, _ in weighed if one.episode.source}
    stored = {one.source: one for one in ledger.transaction.episodes(sources)}
    ledger.expect(candidate.key for _, some in weighed for candidate in some)
    for one, some in weighed:
        episode = one.episode
        learning = Learning(ledger, one, tally)
        for candidate in some:
            learning.apply(candidate)
        if source := episode.source:
            known = stored.get(source) or StoredEpisode(source, ledger.now, episode.task)
            stored[source] = _kept(known, one, learning.touched, ledger.now)
        for id in learning.touched if options.governance else ():
            record = ledger.get(id)
            if record is not None and record.state == "active":
                governing.sum_up(record, learning.rivals.get(id))
    if options.governance:
        if ledger.now - bank.retired_at > SECONDS_PER_DAY / 24:
            bank.retired_at = ledger.now
            governing.retire()
        governing.touched()
    for source in sorted(sources):
        ledger.keep(stored[source])


def _credit(ledger: BankLedger, context: MemoryContext, verdict: Verdict) -> None:
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


def _kept(known: StoredEpisode, one: Brought, touched: Sequence[str], now: float) -> StoredEpisode:
    """The episode as replay needs it; each source has one, with its latest records."""
    episode, task = one.episode, one.episode.task
    facts = dict(episode.facts) if not _unsound(episode.facts) else {}
    stored = replace(
        known,
        at=now,
        task=MemoryTask(clean(task.query, MAX_QUERY), {}, clean(task.skill, 64)),
        transcript=clean(episode.transcript, MAX_TRANSCRIPT) or known.transcript,
        facts=facts or known.facts,
        records=tuple(dict.fromkeys([*known.records, *touched]))[-MAX_TAUGHT:],
    )
    return with_verdict(stored, one.verdict)
