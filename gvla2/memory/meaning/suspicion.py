"""How likely two English texts contradict each other: a small logistic regression on features of the two.

p = max over the ways k in which they may (:func:`gvla2.memory.meaning.features.candidates`) of sigmoid(w . x_k + b).
The weights lie beside this file; ``tests/benchmarks/memory/train_suspicion.py`` makes them, and says of what. What
comes out is a suspicion, never a decision.
"""

from __future__ import annotations

import json
import math
from functools import cache, lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from gvla2.memory.meaning.english import is_english
from gvla2.memory.meaning.features import FEATURES, candidates


def suspicion(first: str, second: str, first_query: str = "", second_query: str = "") -> float | None:
    """The probability, in [0, 1], that two texts contradict each other; None where one is not in English.

    The queries are the instructions that the texts come from, one a line, "" for unknown: in one task a thing has one
    place, and what is right for one task may be wrong for another. The texts may be exchanged.
    """
    if (second, second_query) < (first, first_query):
        first, second, first_query, second_query = second, first, second_query, first_query
    return _suspicion(first, second, first_query, second_query)


@lru_cache(maxsize=16384)
def _suspicion(first: str, second: str, first_query: str, second_query: str) -> float | None:
    if not is_english(first) or not is_english(second):
        return None
    if first == second:
        return 0.0
    ways = candidates(first, second, first_query, second_query)
    if not len(ways):
        return 0.0
    weights, bias, _ = _head()
    return 1.0 / (1.0 + math.exp(-(float((ways @ weights).max()) + bias)))


def threshold() -> float:
    """The probability from which on two texts are suspected, picked out of fold on the training pairs."""
    return _head()[2]


@cache
def _head() -> tuple[NDArray[np.float64], float, float]:
    """Weights (F,), bias, and threshold."""
    table = json.loads((files("gvla2.memory.meaning") / "suspicion_weights.json").read_text("utf-8"))
    weights = np.array([float(table["weights"].get(name, 0.0)) for name in FEATURES])
    return weights, float(table["bias"]), float(table["threshold"])
