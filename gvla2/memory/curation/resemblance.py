"""Which of very many texts share most of their words: by min-hashing, so that few pairs are compared."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

HASHES = 4
"""Pairs of min-hashes: of two texts with two thirds of their words in common, nine in ten share a pair."""
CROWD = 16
"""How many neighbours in one bucket are compared."""
_FACTORS = (0x9E3779B1, 0x85EBCA6B, 0xC2B2AE35, 0x27D4EB2F, 0x165667B1, 0xD3A2646D, 0xFD7046C5, 0xB55A4F09)
_SHIFT = 0x7FEB352D
_LOW = np.uint64(0xFFFFFFFF)


def resembling(
    texts: Sequence[AbstractSet[str]], kinds: Sequence[Any], least: float
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """((N, 64) places of others of the same kind with a Jaccard index of ``least`` or more, (N,) how many).

    A pair is found where it shares a bucket; of a bucket the first ``CROWD`` texts count.
    """
    numbers: dict[str, int] = {}
    sizes = np.fromiter(map(len, texts), np.int64, len(texts))
    words = np.fromiter(
        (numbers.setdefault(word, len(numbers)) for text in texts for word in text),
        np.int32,
        int(sizes.sum()),
    )
    start = np.concatenate(([0], np.cumsum(sizes)))
    groups: dict[Any, int] = {}
    kind = np.fromiter((groups.setdefault(k, len(groups)) for k in kinds), np.int64, len(texts))
    codes = np.fromiter((zlib.crc32(word.encode()) for word in numbers), np.uint64, len(numbers))
    hashes = _least_hashes(codes[words], start)
    bucket = np.empty((HASHES, len(texts)), np.int64)
    held = np.empty((HASHES, len(texts)), np.int64)
    for i in range(HASHES):
        order = np.lexsort((hashes[i], kind))  # stable: each bucket in the order of the texts
        fresh = np.ones(len(order), np.bool_)
        fresh[1:] = (np.diff(kind[order]) != 0) | (hashes[i][order][1:] != hashes[i][order][:-1])
        first = np.flatnonzero(fresh)
        bucket[i, order] = first[np.cumsum(fresh) - 1]
        held[i] = order
    found = np.empty((len(texts), HASHES * CROWD), np.int32)
    counts = np.zeros(len(texts), np.int32)
    _compare(_sorted_within(words, start), start, bucket, held, float(least), found, counts)
    return found, counts


def _least_hashes(codes: NDArray[np.uint64], start: NDArray[np.int64]) -> NDArray[np.uint64]:
    """(HASHES, N) pairs of the least hashes of each text's words, 0 for a text without any."""
    some = np.flatnonzero(np.diff(start) > 0)
    least = np.zeros((2 * HASHES, len(start) - 1), np.uint64)
    for i, factor in enumerate(_FACTORS):
        if len(some):
            mixed = (codes * np.uint64(factor) + np.uint64((i + 1) * _SHIFT)) & _LOW
            least[i, some] = np.minimum.reduceat(mixed, start[some])
    return (least[::2] << np.uint64(32)) | least[1::2]


def _sorted_within(words: NDArray[np.int32], start: NDArray[np.int64]) -> NDArray[np.int32]:
    """The words of each text in rising order."""
    owner = np.repeat(np.arange(len(start) - 1), np.diff(start))
    return words[np.lexsort((words, owner))]


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _compare(words: Any, start: Any, bucket: Any, held: Any, least: float, found: Any, counts: Any) -> None:
    """Fill ``found`` and ``counts`` from the buckets: ``bucket`` (H, N) where each text's begins in ``held`` (H, N)."""
    texts = len(start) - 1
    for text in range(texts):
        for i in range(bucket.shape[0]):
            first = bucket[i, text]
            for place in range(first, min(first + CROWD, texts)):
                other = held[i, place]
                if bucket[i, other] != first:
                    break
                known = other == text
                for k in range(counts[text]):
                    known = known or found[text, k] == other
                if known:
                    continue
                a, b, shared = start[text], start[other], 0
                while a < start[text + 1] and b < start[other + 1]:
                    if words[a] == words[b]:
                        shared += 1
                        a += 1
                        b += 1
                    elif words[a] < words[b]:
                        a += 1
                    else:
                        b += 1
                union = start[text + 1] - start[text] + start[other + 1] - start[other] - shared
                if (shared / union if shared else 0.0) >= least:
                    found[text, counts[text]] = other
                    counts[text] += 1
