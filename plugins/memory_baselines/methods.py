"""The methods: what each keeps of an episode, without a language model, and how it shows entries to a planner."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Protocol

from gvla2.errors import Gvla2Error
from gvla2.memory.contracts import (
    Embedder,
    Inducer,
    Learned,
    Lesson,
    MemoryContext,
    MemoryEpisode,
    MemoryItem,
    MemoryTask,
    Verdict,
)
from gvla2.memory.induction import MOST_ACTS, acts_of
from gvla2.memory.records import Record
from gvla2.memory.rendering import CLOSING, OPENING, effect_words, neutralised, render
from gvla2.memory.store import Store, check_bank, resolved_address
from gvla2_plugins.memory_baselines import VectorStoreConfig
from gvla2_plugins.memory_baselines.store import Draft, Found, VectorStore

_LONGEST_LINE = 400
_SENTENCE = re.compile(r"(?<=[.!?。！？])\s+|\n")
_TITLE_WORDS = 8
_PROGRAM = re.compile(r"\s*[./~]*[A-Za-z_][\w./+-]*(?=\s|$)")
_VALUES = (
    (re.compile(r"https?://\S+"), "{url}"),
    (re.compile(r"\"[^\"\n]*\"|'[^'\n]*'|“[^”\n]*”|«[^»\n]*»|「[^」\n]*」"), "{text}"),
    (re.compile(r"(?<!\w)(?:~|\.{1,2})?/?(?:[\w.@+-]+/)+[\w.@+*-]*"), "{path}"),
    (re.compile(r"\b[0-9a-f]{7,40}\b(?<!\b[a-f]{7})"), "{id}"),
    (re.compile(r"(?<![\w{])[-+]?\d+(?:[.,]\d+)*"), "{number}"),
)
"""Episode-specific parts of a step, and the slots that replace them."""


class Method(Protocol):
    """The specifics of a method: what it keeps of an episode, and how it renders entries."""

    of_content: bool
    """Whether entries are found by their content too, or only by their tasks."""

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Sequence[Draft], str]:
        """The drafts to keep, and "" or why there are none."""
        ...

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """The bounded block of text, delimited as data."""
        ...


class WholeMethod:
    """The memory of a :class:`Method`. It opens on first use and answers "degraded" if the store fails.

    An invalid address or name of a bank raises :class:`~gvla2.errors.ConfigurationError` immediately.
    """

    def __init__(
        self,
        config: VectorStoreConfig,
        method: Method,
        embedder: Embedder,
        inducer: Inducer | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self.url = resolved_address(config.url, os.environ)
        check_bank(config.bank)
        self._config, self._method, self._embedder = config, method, embedder
        self._inducer, self._clock = inducer, clock
        self._entries: VectorStore | None = None

    def recall(self, task: MemoryTask) -> MemoryContext:
        """The most similar entries; an empty context that says why when there are none or the store fails."""
        try:
            nearest = self._open().nearest(task.query, self._config.top_k)
        except Gvla2Error as error:
            return MemoryContext(degraded=str(error))
        found = [entry for entry in nearest if entry.similarity > 0]
        if not found:
            return MemoryContext(abstained=f"The bank '{self._config.bank}' has nothing similar.")
        items = tuple(_item(record, entry.similarity) for entry in found for record in entry.records)
        return MemoryContext(items, self._method.show(items, found, self._config.max_chars))

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the method learns from the episode (its lessons, or those of an inducer), all of it or nothing."""
        if self._inducer is not None:
            episode = replace(episode, lessons=self._inducer.induce(episode, verdict))
        drafts, why = self._method.drafts(episode, verdict)
        if not drafts:
            return Learned(discarded=len(episode.lessons), notes=(why,) if why else ())
        try:
            added, grown = self._open().add(drafts, episode, verdict, actor=self._config.name or "memory")
        except Gvla2Error as error:
            return Learned(degraded=str(error))
        return Learned(added=tuple(added), merged=tuple(grown))

    def close(self) -> None:
        """Release the store; safe to call twice."""
        if self._entries is not None:
            self._entries.store.close()
        self._entries = None

    def _open(self) -> VectorStore:
        if self._entries is None:
            store = Store.open(self.url, busy_seconds=self._config.busy_seconds)
            self._entries = VectorStore(
                store,
                self._config.bank,
                self._embedder,
                of_content=self._method.of_content,
                clock=self._clock,
            )
        return self._entries


def _item(record: Record, similarity: float) -> MemoryItem:
    return MemoryItem(
        id=record.id,
        type=record.type,
        content=record.content,
        confidence=record.confidence,
        score=similarity,
        terms={"similarity": similarity},
        binding=record.type == "failure_avoidance",
        effect=record.effect_json(),
    )


class Semantic:
    """Append only: each lesson of each episode is a separate entry, whatever the verdict."""

    of_content = True

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """Every lesson that has words."""
        drafts = [Draft((lesson,)) for lesson in episode.lessons if lesson.content.strip()]
        return drafts, "" if drafts else "The episode brought no lessons."

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """One line per lesson."""
        return render(items, max_chars)


class Exemplars:
    """The unchanged transcript of each verified success, and its successful numbers."""

    of_content = False
    title = "Trajectories of similar tasks that succeeded (optional):"

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One exemplar of a verified success."""
        if verdict.outcome != "verified_success":
            return [], "Only verified successes are kept."
        if not episode.transcript.strip():
            return [], "The episode has no transcript."
        text = f"Task: {episode.task.query}\n{episode.transcript}"
        return [Draft((Lesson("procedural_hint", text), *_values(episode)))], ""

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """The entries, the most similar task first, each with its usual values."""
        entries = with_values(items, [len(entry.records) for entry in found])
        return show_exemplars(self.title, entries, max_chars)


class Workflows(Exemplars):
    """The steps of a success with abstracted values are a workflow; the same steps again confirm it.

    Multi-line lessons, as written by an inducer with a language model, are workflows as they are. Numbers of the other
    lessons are kept with the workflow, pooled over all episodes that confirm it: the usual values of its slots.
    """

    title = "Workflows that succeeded before (optional):"

    def __init__(self, fewest_steps: int) -> None:
        self._fewest = fewest_steps

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One workflow of a verified success."""
        if verdict.outcome != "verified_success":
            return [], "Only verified successes are kept."
        written = [x for x in episode.lessons if x.type != "failure_avoidance" and "\n" in x.content.strip()]
        if written:  # a language model has written workflows already
            return [Draft((Lesson("procedural_hint", x.content, x.effect),)) for x in written], ""
        steps = [step for step, _ in groupby(map(abstracted, steps_of(episode.transcript)))]
        if len(steps) < self._fewest:
            return [], f"A workflow needs {self._fewest} steps; this episode's transcript has {len(steps)}."
        goal = f"Workflow for: {abstracted(episode.task.query)}"
        text = "\n".join([goal, *(f"{number}. {step}" for number, step in enumerate(steps, 1))])
        key = "\n".join([episode.task.skill, *steps])
        return [Draft((Lesson("procedural_hint", text), *_values(episode)), key)], ""


def _values(episode: MemoryEpisode) -> list[Lesson]:
    """The lessons with successful numbers."""
    return [lesson for lesson in episode.lessons if lesson.effect and lesson.type != "failure_avoidance"]


class Strategies:
    """An entry for each judged episode: at most three items, what to do after success, what to avoid after failure."""

    of_content = False

    def __init__(self, most_items: int) -> None:
        self._most = most_items

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """The items of a judged episode."""
        if verdict.outcome not in ("verified_success", "verified_fail"):
            return [], "Items are drawn only from judged episodes: this one's outcome is open."
        failed = verdict.outcome == "verified_fail"
        usable = [lesson for lesson in episode.lessons if lesson.content.strip()]
        if failed:
            usable = [lesson for lesson in usable if lesson.type != "procedural_hint"]
        lessons = usable[: self._most] or _from_transcript(episode, failed=failed)
        if not lessons:
            return [], "The episode has neither lessons nor a transcript."
        items = tuple(Lesson(lesson.type, item_of(lesson.content), lesson.effect) for lesson in lessons)
        return [Draft(items)], ""

    def show(self, items: Sequence[MemoryItem], found: Sequence[Found], max_chars: int) -> str:
        """Each item with its title, description and content."""
        entries = with_values(items, [1] * len(items))
        return show_exemplars("Strategies from similar tasks (optional):", entries, max_chars)


def item_of(content: str) -> str:
    """A lesson as an item: title (what it is about), description (its first sentence) and content, a line each.

    Repetitions of the line above are left out.
    """
    flat = " ".join(content.split())
    subject, colon, _ = flat.partition(": ")
    words = subject.split()
    title = " ".join(words[:_TITLE_WORDS]) + ("" if colon and len(words) <= _TITLE_WORDS else " …")
    description = _SENTENCE.split(content.strip(), maxsplit=1)[0].strip()
    lines = [f"Title: {title}"] if len(title) < len(flat) else []
    lines += [f"Description: {description}"] if description and description != content.strip() else []
    return "\n".join([*lines, f"Content: {flat}"])


def _from_transcript(episode: MemoryEpisode, *, failed: bool) -> list[Lesson]:
    """One item if there are no lessons: the steps that worked, or how the attempt ended."""
    steps = [abstracted(step) for step in steps_of(episode.transcript)]
    if not steps:
        return []
    goal = abstracted(episode.task.query)
    if failed:
        ended = episode.transcript.strip().rpartition("\n")[2].strip()[:300]
        words = f"{goal}: this failed. It ended with: {ended}. Tried last: {'; '.join(steps[-3:])}."
        return [Lesson("failure_avoidance", words)]
    return [Lesson("procedural_hint", f"{goal}: these steps succeeded. {'; '.join(steps[:12])}.")]


def steps_of(transcript: str) -> list[str]:
    """The actions in order, at most 60; if none are marked, each line is one."""
    if acts := acts_of(transcript):
        return acts
    lines = [step for line in transcript.splitlines() if (step := " ".join(line.split()))]
    return [line for line, _ in groupby(lines)][:MOST_ACTS]


def abstracted(step: str) -> str:
    """The step without its specific values: ``open "a.txt" 3`` is ``open {text} {number}``."""
    program = _PROGRAM.match(step)  # a command's program is the step itself, not a value
    head, rest = (step[: program.end()], step[program.end() :]) if program else ("", step)
    for pattern, slot in _VALUES:
        rest = pattern.sub(slot, rest)
    return " ".join((head + rest).split())


def with_values(items: Sequence[MemoryItem], groups: Sequence[int]) -> list[tuple[str, list[str]]]:
    """The entries formed by items, ``groups`` giving how many belong to each: text of the first, values of all."""
    entries, start = [], 0
    for size in groups:
        leading, *others = items[start : start + size]
        notes = [f"{item.content}{effect_words(item.effect)}" for item in others]
        if own := effect_words(leading.effect):
            notes.insert(0, own.strip())
        entries.append((leading.content, notes))
        start += size
    return entries


def show_exemplars(title: str, entries: Sequence[tuple[str, Sequence[str]]], max_chars: int) -> str:
    """The block: under ``title`` each entry's text with its lines kept, then its notes; "" for no entries.

    Never longer than ``max_chars``: long entries are cut evenly at their ends, and if even that is not enough the last
    entries are left out. Every line is neutralised, as in :func:`gvla2.memory.rendering.render`.
    """
    shown = list(entries)
    while shown:
        frame = len(OPENING) + len(CLOSING) + len(title) + 3
        room = (max_chars - frame) // len(shown) - 1
        if room >= 80:
            blocks = [_block(number, text, notes, room) for number, (text, notes) in enumerate(shown, 1)]
            return "\n".join([OPENING, title, *blocks, CLOSING])
        shown.pop()
    return ""


def _block(number: int, text: str, notes: Sequence[str], room: int) -> str:
    """One entry in at most ``room`` characters: its notes are short and stay, its text is cut."""
    tail = "".join(f"\n- {neutralised(note, 160)}" for note in notes)
    tail = tail if len(tail) <= room // 2 else ""
    # Text beyond the limit is never shown, so the cost is bounded.
    lines = [neutralised(line, _LONGEST_LINE) for line in text[: 4 * room].splitlines()]
    body, left = "\n".join([f"({number})", *filter(None, lines)]), room - len(tail)
    return (body if len(body) <= left else body[: left - 1].rstrip() + "…") + tail
