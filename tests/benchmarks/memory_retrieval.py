"""How long recall takes: ``python tests/benchmarks/memory_retrieval.py [--sizes 1000 10000 100000]``.

End to end: the store's rev is checked, the query embedded, all rows ranked, three hints and three constraints
rendered. Beside it, on the same lessons and queries: all of it in numpy by brute force, and a JSON-lines file that
is read and scored line by line for each query, as memories of agents often do it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from gvla2.memory.contracts import MemoryItem, MemoryTask
from gvla2.memory.hashing import HashEmbedder
from gvla2.memory.index import Index
from gvla2.memory.records import Record
from gvla2.memory.rendering import render
from gvla2.memory.retrieval import HybridRetriever
from gvla2.memory.store import Put, Store
from gvla2.memory.words import text_of, tokens
from gvla2.testing.memory_corpus import lessons, tasks

NOW = 1.8e9


class Recall:
    """What a bank does for one query, by the index, the embedder and the retriever."""

    def __init__(self, index: Index, embedder: HashEmbedder) -> None:
        self.index, self._embedder, self._retriever = index, embedder, HybridRetriever()

    def __call__(self, task: MemoryTask) -> str:
        self.index.refresh()
        vector = self._embedder.embed([task.query])[0]
        candidates = self.index.candidates(now=NOW)
        ranked, reason = self._retriever.rank(task, candidates, vector)
        items = []
        for found in ranked:
            record = candidates.record(found.row)
            binding = record.type == "failure_avoidance"
            items.append(
                MemoryItem(
                    record.id, record.record_type, record.content, record.confidence, found.score, found.terms,
                    binding, record.effect_json(),
                )
            )  # fmt: skip
        return render(items) or reason


class BruteForce:
    """BM25 with a dense count of words and cosine in float32, over all rows."""

    def __init__(self, records: Sequence[Record], vectors: np.ndarray, embedder: HashEmbedder) -> None:
        self._vectors, self._embedder = vectors, embedder
        self._texts = [tokens(text_of(r.query, r.content)) for r in records]
        self._confidence = np.array([r.confidence for r in records])

    def __call__(self, task: MemoryTask) -> str:
        query = set(tokens(task.query))
        counts = np.array([[text.count(word) for word in query] for text in self._texts], float)
        holders = (counts > 0).sum(0)
        idf = np.log1p((len(counts) - holders + 0.5) / (holders + 0.5))
        words = (counts * 2.2 / (counts + 1.2) * idf).sum(1)
        cosine = self._vectors @ self._embedder.embed([task.query])[0]
        score = 0.5 * words / max(words.max(), 1e-9) + 0.5 * cosine + self._confidence
        return str(np.argsort(-score)[:6])


class JsonLines:
    """A file of records that is read, parsed and scored anew for each query."""

    def __init__(self, records: Sequence[Record], path: Path) -> None:
        self._path = path
        with path.open("w", encoding="utf-8") as file:
            for r in records:
                row = {"id": r.id, "query": r.query, "content": r.content, "confidence": r.confidence,
                       "updated": r.updated, "usage": r.usage}  # fmt: skip
                file.write(json.dumps(row) + "\n")

    def __call__(self, task: MemoryTask) -> str:
        query = set(tokens(task.query))
        scored = []
        with self._path.open(encoding="utf-8") as file:
            for line in file:
                record = json.loads(line)
                total = record["confidence"] + min(math.log1p(record["usage"]) / 8, 0.2)
                total += max(0.0, 0.25 - (NOW - record["updated"]) / 86400 / 90)
                for text, weight in ((record["query"], 0.6), (record["content"], 0.4)):
                    words = set(tokens(text))
                    total += weight * len(words & query) / max(len(words | query), 1)
                scored.append((total, record["id"]))
        return str(sorted(scored, reverse=True)[:6])


def milliseconds(work: Callable[[MemoryTask], object], asked: Sequence[MemoryTask]) -> str:
    """Median and 95th percentile of a call, after three that warm up: by the clock, and of the processor's time.

    The second is what counts on a machine that others use at the same time.
    """
    for task in asked[:3]:
        work(task)
    wall, own = [], []
    for task in asked:
        start, spent = time.perf_counter(), time.thread_time()
        work(task)
        wall.append(1e3 * (time.perf_counter() - start))
        own.append(1e3 * (time.thread_time() - spent))
    middle, high = np.percentile(wall, [50, 95]), np.percentile(own, [50, 95])
    return f"p50 {middle[0]:8.3f} ms  p95 {middle[1]:8.3f} ms  processor p50 {high[0]:8.3f} ms  p95 {high[1]:8.3f} ms"


def fill(store: Store, records: Sequence[Record], vectors: np.ndarray, model: str) -> None:
    for start in range(0, len(records), 5000):
        part = slice(start, start + 5000)
        with store.writing("default", actor="bench", now=NOW) as transaction:
            transaction.put_many(
                [Put(r, "add", v, model) for r, v in zip(records[part], vectors[part], strict=True)]
            )


def bench(size: int, folder: Path, queries: int, others: bool) -> None:
    embedder = HashEmbedder()
    records, asked = lessons(size), tasks(queries)
    vectors = embedder.embed([text_of(r.query, r.content) for r in records])
    with Store.open(f"sqlite:///{folder / f'{size}.db'}") as store:
        fill(store, records, vectors, embedder.model)
        start = time.perf_counter()
        index = Index(store, "default", embedder, snapshot=folder / f"{size}.index")
        index.refresh()
        from_store = time.perf_counter() - start
        recall = Recall(index, embedder)
        print(f"{size:>7} rows  recall end to end    {milliseconds(recall, asked)}")
        near = [index.nearest(v, 10) for v in embedder.embed([t.query for t in asked])]
        truth = [
            set(np.argsort(-(vectors @ v), kind="stable")[:10])
            for v in embedder.embed([t.query for t in asked[:50]])
        ]
        ids = [r.id for r in records]
        hits = [
            len({index.record(r).id for r in rows} & {ids[i] for i in true})
            for (rows, _), true in zip(near, truth, strict=False)
        ]
        print(f"{'':>12}  recall@10 of int8 + rescoring against float brute force {np.mean(hits) / 10:.4f}")
        index.save()
        start = time.perf_counter()
        second = Index(store, "default", HashEmbedder(), snapshot=folder / f"{size}.index")
        second.refresh()
        first = time.perf_counter() - start
        print(f"{'':>12}  start: from the store {from_store:.2f} s, from the snapshot {first:.2f} s")
        before = _resident()
        for task in asked:
            recall(task)
        print(
            f"{'':>12}  resident memory {before:.0f} MB, after {len(asked)} more queries {_resident() - before:+.1f} MB"
        )
    if others:
        few = asked[: max(3, min(20, 200_000 // size))]
        for name, method in (
            ("numpy, brute force", BruteForce(records, vectors, embedder)),
            ("JSON lines", JsonLines(records, folder / f"{size}.jsonl")),
        ):
            print(f"{'':>12}  {name:<20} {milliseconds(method, few)}")


def _resident() -> float:
    """Megabytes of this process in memory."""
    status = Path(f"/proc/{os.getpid()}/statm")
    if status.exists():
        return int(status.read_text().split()[1]) * resource.getpagesize() / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--queries", type=int, default=300)
    parser.add_argument("--alone", action="store_true", help="leave the other methods out")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for size in arguments.sizes:
            bench(size, Path(folder), arguments.queries, not arguments.alone)


if __name__ == "__main__":
    main()
