"""The methods on a vector store: what each keeps of an episode, without a language model, and how it shows entries.

An entry is one or several lessons that are kept, found and shown together (a workflow, an exemplar). They are
records of a bank in the store, so they survive restarts, are shared by processes, and `gvla2 memory` shows them.
"""

from __future__ import annotations

import hashlib
import re
import time
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.admission import confirmed, new_record
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
from gvla2.memory.late import LateMemory
from gvla2.memory.records import Record, clean, dump
from gvla2.memory.rendering import CLOSING, OPENING, effect_words, item_of, neutralised, render
from gvla2.memory.store import Store
from gvla2_plugins.memory_baselines import VectorStoreConfig

FEWEST_STEPS, MOST_ITEMS = 2, 3
"""Minimum number of steps of a workflow, and maximum number of items of a task."""
LONGEST, _LONGEST_LINE = 100_000, 400
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
Shown = tuple[str, Sequence[str]]
"""An entry as it is shown: its text, and notes on its values."""


@dataclass(frozen=True)
class Draft:
    """An entry to be kept: its ``lessons``, the leading one first.

    Drafts of the same ``key`` are one entry, whose evidence is pooled; "" makes a new entry each time.
    """

    lessons: tuple[Lesson, ...]
    key: str = ""


Entry = tuple[Record, ...]
"""The records of an entry, its leading one first."""


class WholeMethod(ABC):
    """A memory on a vector store; a subclass says what it keeps of an episode, and how it shows entries.

    Not thread-safe, but safe for any number of processes. Methods raise :class:`~gvla2.errors.MemoryStoreError` when
    the store cannot be used.
    """

    of_content: ClassVar[bool] = False
    """Whether entries are found by "query content" of their leading lessons, or only by the mean of their queries."""
    title: ClassVar[str] = ""

    def __init__(
        self,
        url: str,
        config: VectorStoreConfig,
        embedder: Embedder,
        inducer: Inducer | None = None,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._config, self._embedder, self._inducer, self._clock = config, embedder, inducer, clock
        self.store = Store.open(url, busy_seconds=config.busy_seconds)
        self._vectors: dict[str, NDArray[np.float32]] = {}  # by text: each is embedded once
        self._entries: list[Entry] = []
        self._rev = 0

    @classmethod
    def late(
        cls, config: VectorStoreConfig, embedder: Embedder, inducer: Inducer | None = None
    ) -> LateMemory:
        """The method, opened on first use."""
        return LateMemory(config, lambda url: cls(url, config, embedder, inducer))

    @abstractmethod
    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[Sequence[Draft], str]:
        """The drafts to keep, and "" or why there are none."""

    def show(self, entries: Sequence[Sequence[MemoryItem]]) -> str:
        """The bounded block of text, delimited as data: the most similar entry first, each with its usual values."""
        return show_exemplars(self.title, [_with_values(items) for items in entries], self._config.max_chars)

    def recall(self, task: MemoryTask) -> MemoryContext:
        """The most similar entries; an empty context that says why when there are none."""
        nearest = self.nearest(task.query, self._config.top_k)
        found = [
            [item_of(record, cosine, {"similarity": cosine}) for record in entry]
            for entry, cosine in nearest
            if cosine > 0
        ]
        if not found:
            return MemoryContext(abstained=f"The bank '{self._config.bank}' has nothing similar.")
        return MemoryContext(tuple(item for items in found for item in items), self.show(found))

    def learn(self, episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store what the method learns from the episode (its lessons, or those of an inducer), all of it or nothing."""
        if self._inducer is not None:
            episode = replace(episode, lessons=self._inducer.induce(episode, verdict))
        drafts, why = self.drafts(episode, verdict)
        if not drafts:
            return Learned(discarded=len(episode.lessons), notes=(why,))
        return self.add(drafts, episode, verdict)

    def close(self) -> None:
        """Release the store; safe to call twice."""
        self.store.close()

    def nearest(self, text: str, k: int) -> list[tuple[Entry, float]]:
        """The ``k`` most similar entries and the cosine of each with the text, in [-1, 1], best first; ties by name."""
        self._refresh()
        if not self._entries or k < 1:
            return []
        matrix = np.stack([self._vector(entry[0]) for entry in self._entries])  # (N, D)
        cosines = matrix @ self._embedder.embed([clean(text, LONGEST)])[0]  # (N,)
        best = np.argsort(-cosines, kind="stable")[:k]
        return [(self._entries[row], float(cosines[row])) for row in best.tolist()]

    def add(self, drafts: Sequence[Draft], episode: MemoryEpisode, verdict: Verdict) -> Learned:
        """Store the drafts in one transaction; ids are the leading records' of new entries, and of grown ones."""
        added, grown, bank = list[str](), list[str](), self._config.bank
        with self.store.writing(bank, actor=self._config.name or "memory", now=self._clock()) as tx:
            for number, draft in enumerate(drafts):
                name = _digest(draft.key or dump([tx.rev, number]))
                for place, lesson in enumerate(draft.lessons):
                    about = str((lesson.effect or {}).get("parameter", ""))
                    key = _digest(dump([name, lesson.type, lesson.content, about] if place else [name, 0]))
                    short = replace(lesson, content=clean(lesson.content, LONGEST))
                    record = new_record(bank, short, episode, verdict, tx.now, key=key)
                    known = tx.by_key(key)
                    if known is not None:
                        record = tx.put(confirmed(known, record, episode, verdict, tx.now), action="merge")
                    else:
                        home = dump({**record.provenance_json(), "entry": name, "place": place})
                        record = tx.put(replace(record, provenance=home), action="add")
                    if place == 0:
                        (grown if known else added).append(record.id)
        return Learned(added=tuple(added), merged=tuple(grown))

    def _refresh(self) -> None:
        """Follow the store: new, changed, forgotten or archived entries."""
        with self.store.reading(self._config.bank) as view:
            if view.rev == self._rev:
                return
            records, self._rev = view.records(["active"]), view.rev
        entries: dict[str, list[tuple[int, str, Record]]] = defaultdict(list)
        for record in records:
            home = record.provenance_json()
            if "entry" in home:
                entries[str(home["entry"])].append((int(home["place"]), record.id, record))
        whole = [sorted(entry, key=lambda one: one[:2]) for _, entry in sorted(entries.items())]
        # An entry exists as long as its leading record.
        self._entries = [tuple(one[2] for one in entry) for entry in whole if entry[0][0] == 0]

    def _vector(self, leading: Record) -> NDArray[np.float32]:
        text = leading.text if self.of_content else leading.query
        if text not in self._vectors:
            rows = self._embedder.embed([text] if self.of_content else text.split("\n"))
            total = rows.sum(axis=0, dtype=np.float64)
            self._vectors[text] = (total / max(float(np.linalg.norm(total)), 1e-12)).astype(np.float32)
        return self._vectors[text]


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()


class Semantic(WholeMethod):
    """Append only: each lesson of each episode is a separate entry, whatever the verdict."""

    of_content = True

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """Every lesson that has words."""
        drafts = [Draft((lesson,)) for lesson in episode.lessons if lesson.content.strip()]
        return drafts, "" if drafts else "The episode brought no lessons."

    def show(self, entries: Sequence[Sequence[MemoryItem]]) -> str:
        """One line per lesson."""
        return render([item for items in entries for item in items], self._config.max_chars)


class Constants(WholeMethod):
    """The mean of each parameter over all verified successes of a skill, for every task: what tuning alone is worth."""

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One entry for each parameter of a skill, pooled over all objects and tasks."""
        if verdict.outcome != "verified_success":
            return [], "Only verified successes are averaged."
        found = []
        for lesson in _values(episode):
            effect = {k: v for k, v in (lesson.effect or {}).items() if k != "object"}
            if effect.get("kind") == "prior":
                about = [str(effect.get(name) or "") for name in ("skill", "parameter", "scale")]
                words = f"{about[0] or 'Any skill'}: the mean {about[1].replace('_', ' ')} of all successes."
                found.append(Draft((Lesson("procedural_hint", words, effect),), dump(about)))
        return found, "" if found else "The episode's lessons have no numbers."

    def nearest(self, text: str, k: int) -> list[tuple[Entry, float]]:
        """All entries: nothing is retrieved."""
        self._refresh()
        return [(entry, 1.0) for entry in self._entries]

    def show(self, entries: Sequence[Sequence[MemoryItem]]) -> str:
        """One line per parameter."""
        return render([item for items in entries for item in items], self._config.max_chars)


class Exemplars(WholeMethod):
    """The unchanged transcript of each verified success, and its successful numbers."""

    title = "Trajectories of similar tasks that succeeded (optional):"

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One exemplar of a verified success."""
        if verdict.outcome != "verified_success":
            return [], "Only verified successes are kept."
        if not episode.transcript.strip():
            return [], "The episode has no transcript."
        text = f"Task: {episode.task.query}\n{episode.transcript}"
        return [Draft((Lesson("procedural_hint", text), *_values(episode)))], ""


class Workflows(WholeMethod):
    """The steps of a success with abstracted values are a workflow; the same steps again confirm it.

    Multi-line lessons, as written by an inducer with a language model, are workflows as they are. Numbers of the other
    lessons are kept with the workflow, pooled over all episodes that confirm it: the usual values of its slots.
    """

    title = "Workflows that succeeded before (optional):"

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """One workflow of a verified success."""
        if verdict.outcome != "verified_success":
            return [], "Only verified successes are kept."
        written = [x for x in episode.lessons if x.type != "failure_avoidance" and "\n" in x.content.strip()]
        if written:  # a language model has written workflows already
            return [Draft((Lesson("procedural_hint", x.content, x.effect),)) for x in written], ""
        steps = [step for step, _ in groupby(map(abstracted, steps_of(episode.transcript)))]
        if len(steps) < FEWEST_STEPS:
            return [], f"A workflow needs {FEWEST_STEPS} steps; this episode's transcript has {len(steps)}."
        goal = f"Workflow for: {abstracted(episode.task.query)}"
        text = "\n".join([goal, *(f"{number}. {step}" for number, step in enumerate(steps, 1))])
        key = "\n".join([episode.task.skill, *steps])
        return [Draft((Lesson("procedural_hint", text), *_values(episode)), key)], ""


def _values(episode: MemoryEpisode) -> list[Lesson]:
    """The lessons with successful numbers."""
    return [lesson for lesson in episode.lessons if lesson.effect and lesson.type != "failure_avoidance"]


class Strategies(WholeMethod):
    """An entry for each judged episode: at most three items, what to do after success, what to avoid after failure."""

    title = "Strategies from similar tasks (optional):"

    def drafts(self, episode: MemoryEpisode, verdict: Verdict) -> tuple[list[Draft], str]:
        """The items of a judged episode."""
        if verdict.outcome not in ("verified_success", "verified_fail"):
            return [], "Items are drawn only from judged episodes: this one's outcome is open."
        failed = verdict.outcome == "verified_fail"
        usable = [lesson for lesson in episode.lessons if lesson.content.strip()]
        if failed:
            usable = [lesson for lesson in usable if lesson.type != "procedural_hint"]
        lessons = usable[:MOST_ITEMS] or _from_transcript(episode, failed=failed)
        if not lessons:
            return [], "The episode has neither lessons nor a transcript."
        items = tuple(Lesson(lesson.type, titled(lesson.content), lesson.effect) for lesson in lessons)
        return [Draft(items)], ""

    def show(self, entries: Sequence[Sequence[MemoryItem]]) -> str:
        """Each item with its title, description and content."""
        return super().show([[item] for items in entries for item in items])


def titled(content: str) -> str:
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


def _with_values(items: Sequence[MemoryItem]) -> Shown:
    """The entry that these items form: the text of the first, the values of all."""
    leading, *others = items
    own = effect_words(leading.effect).strip()
    notes = [f"{item.content}{effect_words(item.effect)}" for item in others]
    return leading.content, [own, *notes] if own else notes


def show_exemplars(title: str, entries: Sequence[Shown], max_chars: int) -> str:
    """The block: under ``title`` each entry's text with its lines kept, then its notes; "" for no entries.

    Never longer than ``max_chars``: long entries are cut evenly at their ends, and if even that is not enough the last
    entries are left out. Every line is neutralised, as in :func:`gvla2.memory.rendering.render`.
    """
    frame = len(OPENING) + len(CLOSING) + len(title) + 3
    for count in range(len(entries), 0, -1):
        room = (max_chars - frame) // count - 1
        if room >= 80:
            blocks = [_block(number, *entry, room) for number, entry in enumerate(entries[:count], 1)]
            return "\n".join([OPENING, title, *blocks, CLOSING])
    return ""


def _block(number: int, text: str, notes: Sequence[str], room: int) -> str:
    """One entry in at most ``room`` characters: its notes are short and stay, its text is cut."""
    tail = "".join(f"\n- {neutralised(note, 160)}" for note in notes)
    tail = tail if len(tail) <= room // 2 else ""
    # Text beyond the limit is never shown, so the cost is bounded.
    lines = [neutralised(line, _LONGEST_LINE) for line in text[: 4 * room].splitlines()]
    body, left = "\n".join([f"({number})", *filter(None, lines)]), room - len(tail)
    return (body if len(body) <= left else body[: left - 1].rstrip() + "…") + tail
