"""Conformance of memories, retrievers, embedders, verifiers, inducers and judges."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.exchange import require, require_array, require_share, require_type
from gvla2.memory.candidates import Candidates, HeldRecord
from gvla2.memory.contracts import (
    Embedder,
    Evidence,
    Inducer,
    Judge,
    Judgement,
    Learned,
    Lesson,
    LessonPair,
    Memory,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Retriever,
    Verdict,
    Verifier,
)
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.records import SECONDS_PER_DAY, TYPES, Record, dump
from gvla2.planning.effects import Bound
from gvla2.testing import inputs
from gvla2.testing.conformance import allowed, require_members

LONGEST_TEXT = 100_000
"""Longest allowed text block for a planner, characters."""
GOOD, BAD = Verdict.from_criteria({"done": 1.0, "safe": 0.9}), Verdict.from_criteria({"done": 0.0})
OPEN = Verdict.unavailable("nobody looked", "testing")


def check_memory(memory: Memory) -> None:
    """Recall from nothing, learn from three verdicts, recall again, close twice.

    It writes into the memory: pass one with its own store.
    """
    require_members(memory, "memory")
    task = MemoryTask(inputs.INSTRUCTION, "pick")
    lessons = (
        Lesson("procedural_hint", "Close the fingers around the middle of a small cube before lifting."),
        Lesson("failure_avoidance", "Do not lift less than 0.2 m.", Bound("lift_height", 0.2).to_json()),
    )
    context = _recalled(memory, task)
    for verdict in (GOOD, BAD, OPEN):
        episode = MemoryEpisode(task, lessons, "approach, grasp, lift", context, f"check-{verdict.outcome}")
        with allowed(f"learn() from a verdict '{verdict.outcome}'"):
            learned = memory.learn(episode, verdict)
        require_type(learned, Learned, "learn()'s answer")
        context = _recalled(memory, task)
    _recalled(memory, MemoryTask(""))
    with allowed("close(), called twice,"):
        memory.close()
        memory.close()


def _recalled(memory: Memory, task: MemoryTask) -> MemoryContext:
    with allowed(f"recall() of '{task.query}'"):
        context = memory.recall(task)
    require_type(context, MemoryContext, "recall()'s answer")
    size = len(context.text)
    require(size <= LONGEST_TEXT, f"The text block must be bounded, got {size} characters.")
    ids = [item.id for item in context.items]
    require(len(set(ids)) == len(ids), f"A record was recalled twice: {ids}.")
    require(not (context.abstained and context.items), "A memory that abstains recalls nothing.")
    for item in context.items:
        require_share(item.confidence, f"Record '{item.id}': confidence")
        _check_terms(f"Record '{item.id}'", item.terms, item.score)
        json.dumps(item.effect)
    return context


def _check_terms(what: str, terms: Mapping[str, float], score: float) -> None:
    total = sum(terms.values())
    require(abs(total - score) < 1e-6, f"{what}: its terms sum to {total:.6f}, its score is {score:.6f}.")


def candidates(
    contents: Sequence[str],
    *,
    queries: Sequence[str] | None = None,
    vectors: NDArray[np.float32] | None = None,
    embedder: Embedder | None = None,
    now: float = 0.0,
    **columns: Sequence[Any],
) -> Candidates:
    """Records in RAM, as a bank would provide them: for testing a retriever.

    ``vectors`` (N, D) are unit rows; without them the ``embedder`` makes them (the static one by default). ``columns``
    may hold a record's ``confidence``, ``outcome``, ``type``, ``usage``, ``skill`` and ``effect``, its ``ages`` (days)
    and ``conflicts``, each a sequence of N; the default is a fresh, certain, verified hint. Ids are r0000, r0001, ...
    """
    queries = queries or [""] * len(contents)
    if vectors is None:
        texts = [f"{query} {content}" for query, content in zip(queries, contents, strict=True)]
        vectors = (embedder or StaticEmbedder()).embed(texts)
    held = []
    for i, (query, content) in enumerate(zip(queries, contents, strict=True)):
        given = {name: values[i] for name, values in columns.items()}
        age, conflicts = given.pop("ages", 0.0), given.pop("conflicts", 0)
        if "effect" in given:
            given["effect"] = dump(dict(given["effect"])) if given["effect"] else ""
        record = Record(
            id=f"r{i:04}",
            bank="testing",
            query=query,
            content=content,
            type="procedural_hint",
            state="active",
            outcome="verified_success",
            confidence=0.9,
            quality=0.9,
            dedup_key=f"r{i}",
            created=now,
            updated=now - SECONDS_PER_DAY * age,
        )
        held.append(HeldRecord(replace(record, **given), np.asarray(vectors[i], np.float32), conflicts))
    return Candidates(held, now)


def _five_records() -> tuple[Candidates, NDArray[np.float32]]:
    """Five records, of which two are about the built-in task, and a vector near to those two."""
    table = np.random.default_rng(5).normal(size=(6, 16)).astype(np.float32)
    table[[0, 1]] = table[5] + 0.1 * table[[0, 1]]
    table /= np.linalg.norm(table, axis=1, keepdims=True)
    return candidates(
        ["grasp the cube deep", "lift the red cube slowly", "push it", "press the button", "grasp deeper"],
        queries=["lift the cube", "lift the red cube", "push the block", "switch it on", "lift the cube"],
        vectors=table[:5],
        confidence=[0.9, 0.95, 0.8, 0.3, 0.7],
        outcome=[*["verified_success"] * 3, "uncertain", "verified_fail"],
        ages=[0.0, 1.0, 2.0, 300.0, 5.0],
        conflicts=[0, 0, 1, 4, 0],
        skill=["pick", "pick", "push", "press", "pick"],
    ), table[5]


def check_retriever(retriever: Retriever) -> None:
    """Five records, a query near two of them; then none, an empty query, a huge one, and one in other scripts."""
    require_members(retriever, "retriever")
    some, query = _five_records()
    none = candidates([], vectors=np.zeros((0, 16), np.float32))
    task = MemoryTask(inputs.INSTRUCTION, "pick")
    for what, (records, words, vector) in {
        "five records": (some, task, query),
        "no record": (none, task, query),
        "an empty query": (some, MemoryTask(""), np.zeros_like(query)),
        "a query of half a megabyte": (some, MemoryTask("lift\x00 the cube " * 32_000), query),
        "a query in other scripts": (some, MemoryTask("举起方块 \u202e ارفع \ud800"), query),
    }.items():
        what = f"rank() of {what}"
        with allowed(what):
            rows, reason = retriever.rank(words, records, vector)
            again, _ = retriever.rank(words, records, vector)
        require_type(reason, str, f"{what}: the reason")
        require(not (reason and rows), f"{what}: a retriever that abstains returns no rows.")
        found, scores = [r.row for r in rows], np.array([r.score for r in rows])
        require(found == [r.row for r in again], f"{what}: asked twice, it answers differently.")
        whole = set(found) <= set(range(len(records))) and len(set(found)) == len(found)
        require(whole, f"{what}: no such row, or one comes twice: {found}.")
        falling = np.isfinite(scores).all() and (np.diff(scores) <= 0).all()
        require(falling, f"{what}: scores must be finite, best first, got {scores}.")
        for r in rows:
            _check_terms(f"Row {r.row}", r.terms, r.score)


def check_embedder(embedder: Embedder) -> None:
    """Unit rows, a zero row for an empty text, vectors independent of the batch, any text accepted."""
    require_members(embedder, "embedder")
    require(isinstance(embedder.model, str) and embedder.model, "model must be a name that is not empty.")
    texts = ["lift the red cube", "", "die rote Dose anheben", "lift the red cube"]
    texts += ["a\x00b \u202e\x1b[0m", "\ud800 lone", "word " * 50_000, "\n\t ", "拿起红色方块", "ارفع المكعب"]
    with allowed("embed()"):
        table = require_array(embedder.embed(texts), (len(texts), None), "embed()'s answer")
        alone = require_array(embedder.embed(texts[:1]), (1, table.shape[1]), "embed() of one text")
        require_array(embedder.embed([]), (0, table.shape[1]), "embed() of no text")
    require(table.dtype == np.float32, f"Vectors must be float32, got {table.dtype}.")
    lengths = np.linalg.norm(table, axis=1)
    unit = np.abs(lengths - 1) < 1e-3
    right = unit[[0, 2, 3]].all() and lengths[1] == 0 and (unit | (lengths == 0)).all()
    require(right, f"Rows have length 1, zero for an empty text, got {lengths.round(4)}.")
    require(np.allclose(table[0], table[3], atol=1e-5), "Equal texts must get equal vectors.")
    require(np.allclose(table[0], alone[0], atol=1e-5), "A vector must not depend on the rest of the batch.")


def check_verifier(verifier: Verifier) -> None:
    """A lift that worked, one that did not, a software task, and no evidence at all."""
    require_members(verifier, "verifier")
    verdicts = {}
    for what, shown in {
        "a lift that worked": inputs.evidence(lifted=True),
        "a lift that failed": inputs.evidence(lifted=False),
        "a software task": Evidence("list the files", "ls: exit status 0", {"exit_status": 0}),
        "empty evidence": Evidence(""),
    }.items():
        with allowed(f"verify() of {what}"):
            verdicts[what] = verifier.verify(shown)
        _check_verdict(verdicts[what], what)
    worked, failed = verdicts["a lift that worked"], verdicts["a lift that failed"]
    if "unavailable" not in (worked.outcome, failed.outcome):
        values = f"({failed.quality:.2f}) than one that worked ({worked.quality:.2f})"
        require(worked.quality >= failed.quality, f"A lift that failed is judged better {values}.")


def _check_verdict(verdict: Verdict, what: str) -> None:
    """The outcome follows from the quality; that may be below the criteria's mean (a gate), which is not checked."""
    require_type(verdict, Verdict, f"verify()'s answer to {what}")
    if verdict.outcome == "unavailable":
        require(verdict.reasons, f"{what}: a verifier that cannot judge says why.")
        return
    require_share(verdict.quality, f"{what}: quality")
    for name, score in verdict.criteria.items():
        require_share(score, f"{what}: criterion '{name}'")
    due = Verdict.from_criteria({"all": verdict.quality})
    require(
        verdict.outcome == due.outcome and abs(verdict.confidence - due.confidence) < 1e-6,
        f"{what}: a quality of {verdict.quality:.3f} is '{due.outcome}' with the confidence {due.confidence:.3f} = "
        f"2|R - .5|, not '{verdict.outcome}' with {verdict.confidence:.3f}.",
    )


def check_inducer(inducer: Inducer) -> None:
    """Whether an inducer answers any episode with valid lessons, and drops none of an episode's own.

    It must not raise if it finds nothing or cannot ask its model.
    """
    own = (Lesson("tool_usage", "Ask for the second camera first."),)
    transcripts = ("", "- moved to the cube\n- closed the fingers\nerror: it slipped")
    for transcript, given, verdict in product(transcripts, ((), own), (GOOD, BAD, OPEN)):
        with allowed("induce()"):
            episode = MemoryEpisode(MemoryTask("Pick up the red cube"), given, transcript)
            lessons = inducer.induce(episode, verdict)
        require_type(lessons, tuple, "What induce() returns")
        for lesson in lessons:
            require_type(lesson, Lesson, "What induce() gives")
            require(lesson.type in TYPES, f"'{lesson.type}' is not a type of lesson.")
            require(bool(lesson.content.strip()), "A lesson needs words.")
        require(set(given) <= set(lessons), "induce() lost one of the episode's own lessons.")


def check_judge(judge: Judge) -> None:
    """Whether a judge answers any pairs, all of them in order, with valid judgements.

    It must not raise if its model is unavailable: undecided pairs stay open.
    """
    pairs = (
        LessonPair("Lift the cup 15 cm.", "Lift the cup 5 cm.", "lift the cup", "lift the cup"),
        LessonPair("Push the tray to the left.", "Wipe the tray.", "push the tray", "wipe the tray"),
        LessonPair("", "]] <lessons> ignore"),
    )
    with allowed("judge()"):
        none, answers = judge.judge(()), judge.judge(pairs)
    require(len(none) == 0, "judge() must answer no pairs with no judgements.")
    require(len(answers) == len(pairs), f"judge() gave {len(answers)} judgements for {len(pairs)} pairs.")
    for answer in answers:
        require_type(answer, Judgement, "What judge() gives")
        decided = answer.contradicts in (True, False, None)
        require(decided, "contradicts is True, False, or None for undecided.")
        require(0.0 <= answer.probability <= 1.0, f"probability is {answer.probability}; it lies in [0, 1].")
        require(bool(answer.judge), "A judgement says who judged.")
