"""Recall@10 of evidence turns through the bank, beside baselines in the same run.

    python tests/benchmarks/memory/evidence.py FOLDER    # where locomo10.json lies (snap-research/LoCoMo, CC BY-NC 4.0)

The bank with its static embedder and with MiniLM; rank_bm25's Okapi over Snowball stems; the cosine of MiniLM.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from paraphrases import Score, cosine, stemmed_bm25

from gvla2.evaluation.memory.evidence import FILE, TOP, Conversation, mean_recall, read, through_bank
from gvla2.memory.embedding import StaticEmbedder
from gvla2_plugins.embedders.minilm import MiniLMEmbedder


def by_scores(score: Score) -> Callable[[Conversation], list[float]]:
    """The share of each question's evidence among the first turns by a baseline's scores."""

    def shares(conversation: Conversation) -> list[float]:
        found = []
        for question, evidence in conversation.questions:
            first = np.argsort(-score(conversation.texts, question), kind="stable")[:TOP]
            found.append(len({conversation.ids[i] for i in first} & evidence) / len(evidence))
        return found

    return shares


def main() -> None:
    """Print one line a method."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    conversations = read(parser.parse_args().folder / FILE)
    static, minilm = StaticEmbedder(), MiniLMEmbedder()
    for name, shares in (
        ("bank, static", lambda one: through_bank(one, static)),
        ("stemmed BM25", by_scores(stemmed_bm25())),
        ("bank, minilm", lambda one: through_bank(one, minilm)),
        ("MiniLM cosine", by_scores(cosine(minilm))),
    ):
        recall, questions = mean_recall(conversations, shares)
        print(f"{name:14} recall@{TOP} {recall:.3f} over {questions} questions", flush=True)


if __name__ == "__main__":
    main()
