"""Are lessons recalled when a task is put in other words, and does memory keep silent where it knows nothing?

    python tests/benchmarks/memory/paraphrases.py                  # the set that nothing was tuned on
    python tests/benchmarks/memory/paraphrases.py calibration      # the set that the retriever's thresholds come from

A paraphrase counts when its lesson is among those recalled; an irrelevant query counts when anything is. Beside the
bank's embedders stand two baselines of a few lines: BM25 over stems (rank_bm25), and the cosine of MiniLM, each silent
below the threshold that answers at most a tenth of the calibration's irrelevant queries, and each with the bank's three
places for hints.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rank_bm25 import BM25Okapi
from Stemmer import Stemmer

from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Embedder, Lesson, Verdict
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.text import STOP_WORDS
from gvla2_plugins.embedders.minilm import MiniLMEmbedder

DATA = Path(__file__).parent / "data"
SETS = ("paraphrases", "calibration")
PLACES = 3
Score = Callable[[Sequence[str], str], NDArray[np.float64]]
"""Of the texts of all lessons and a query: (N,) how well each fits."""


def read(name: str) -> tuple[list[dict[str, str]], list[str]]:
    """The lessons, each with its task and a paraphrase ``query`` of that, and the irrelevant queries."""
    lines = [json.loads(line) for line in (DATA / f"{name}.jsonl").read_text(encoding="utf-8").splitlines()]
    return [x for x in lines if "task" in x], [x["irrelevant"] for x in lines if "irrelevant" in x]


def through_bank(
    embedder: Embedder, lessons: Sequence[dict[str, str]], irrelevant: Sequence[str]
) -> tuple[int, int]:
    """(paraphrases answered with their lesson, irrelevant queries answered)."""
    verdict = Verdict.from_criteria({"completion": 0.95}, verifier="measuring")
    with (
        tempfile.TemporaryDirectory() as folder,
        KnowledgeBank(f"{folder}/memory.db", embedder=embedder) as bank,
    ):
        for number, line in enumerate(lessons):
            lesson = Lesson("procedural_hint", line["lesson"])
            bank.admit(lesson, verdict, task=line["task"], source=f"episode-{number}", trusted=True)
        found = sum(
            any(item.content == line["lesson"] for item in bank.recall(line["query"]).items)
            for line in lessons
        )
        return found, sum(bool(bank.recall(query).items) for query in irrelevant)


def by_scores(
    score: Score, lessons: Sequence[dict[str, str]], irrelevant: Sequence[str], least: float
) -> tuple[int, int]:
    """The same of a baseline that is silent below ``least``."""
    texts = [f"{line['task']} {line['lesson']}" for line in lessons]
    answered = 0
    for place, line in enumerate(lessons):
        found = score(texts, line["query"])
        answered += place in np.argsort(-found, kind="stable")[:PLACES] and found[place] >= least
    return answered, sum(bool(score(texts, query).max() >= least) for query in irrelevant)


def threshold(score: Score) -> float:
    """What answers at most a tenth of the calibration's irrelevant queries."""
    lessons, irrelevant = read("calibration")
    texts = [f"{line['task']} {line['lesson']}" for line in lessons]
    best = [score(texts, query).max() for query in irrelevant]
    return float(np.nextafter(np.quantile(best, 0.9, method="higher"), np.inf))


def stemmed_bm25() -> Score:
    """Okapi BM25 over Snowball's English stems, without stop words: it does better so (LoCoMo: .57 with them)."""
    stemmer = Stemmer("english")

    def stems(text: str) -> list[str]:
        words = [word for word in re.findall(r"\w+", text.lower()) if word not in STOP_WORDS]
        return [str(stem) for stem in stemmer.stemWords(words)]

    known: dict[tuple[str, ...], BM25Okapi] = {}

    def score(texts: Sequence[str], query: str) -> NDArray[np.float64]:
        if tuple(texts) not in known:
            known[tuple(texts)] = BM25Okapi([stems(text) for text in texts])
        return np.asarray(known[tuple(texts)].get_scores(stems(query)))

    return score


def cosine(embedder: Embedder) -> Score:
    """The cosine of an embedder's vectors."""
    known: dict[tuple[str, ...], NDArray[np.float32]] = {}

    def score(texts: Sequence[str], query: str) -> NDArray[np.float64]:
        if tuple(texts) not in known:
            known[tuple(texts)] = embedder.embed(texts)
        return (known[tuple(texts)] @ embedder.embed([query])[0]).astype(np.float64)

    return score


def main() -> None:
    """Print one line a method."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("set", nargs="?", choices=SETS, default=SETS[0])
    name = parser.parse_args().set
    lessons, irrelevant = read(name)
    static, minilm = StaticEmbedder(), MiniLMEmbedder()
    print(f"{name}: recalled of {len(lessons)} / irrelevant answered of {len(irrelevant)}")
    for method, embedder in (("bank, static", static), ("bank, minilm", minilm)):
        print(f"  {method:14}", *through_bank(embedder, lessons, irrelevant))
    for method, score in (("stemmed BM25", stemmed_bm25()), ("MiniLM cosine", cosine(minilm))):
        print(f"  {method:14}", *by_scores(score, lessons, irrelevant, threshold(score)))


if __name__ == "__main__":
    main()
