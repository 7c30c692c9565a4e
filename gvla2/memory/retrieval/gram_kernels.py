"""The compiled loop of the hash embedder: the character n-grams of words to amounts at places of a vector."""

from __future__ import annotations

from typing import Any
from zlib import crc32

import numpy as np
from numba import njit

MARK = ord("^")
"""What each word begins with; no word holds it."""
_SIGN = 1 << 31

# CRC-32 byte by byte. ``crc32`` of one byte is the table's entry but for the two constants that it begins and ends by.
_TABLE = np.array([crc32(bytes([byte ^ 0xFF])) ^ 0xFFFFFF ^ 0xFFFFFFFF for byte in range(256)], np.int64)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def add_grams(text: Any, shortest: int, longest: int, row: Any) -> None:
    """Add the n-grams of ``text`` (uint8, UTF-8, each word with its marks) to ``row`` (D,).

    A gram's place and sign come from the CRC-32 of its bytes, its amount is the root of how often it occurs. Grams
    count in the order in which they first come: sums of roots hang on it, and the same text must give the same bits.
    """
    most = len(text) * (longest - shortest + 1)
    slots = 64
    while slots < 2 * most:
        slots *= 2
    # Hashing with open addressing: the place of a code among the distinct ones, counted from 1.
    place = np.zeros(slots, np.int64)
    codes, counts = np.empty(most, np.int64), np.empty(most, np.int64)
    letters = np.empty(len(text) + 1, np.int64)  # where each letter of a word begins
    distinct, end = 0, 0
    while end < len(text):
        size = 0
        while end < len(text) and (size == 0 or text[end] != MARK):
            if text[end] & 0xC0 != 0x80:
                letters[size] = end
                size += 1
            end += 1
        letters[size] = end
        for length in range(shortest, longest + 1):
            for first in range(size - length + 1):
                code = 0xFFFFFFFF
                for at in range(letters[first], letters[first + length]):
                    code = _TABLE[(code ^ text[at]) & 0xFF] ^ (code >> 8)
                code ^= 0xFFFFFFFF
                slot = code & (slots - 1)
                while place[slot] and codes[place[slot] - 1] != code:
                    slot = (slot + 1) & (slots - 1)
                if place[slot] == 0:
                    codes[distinct], counts[distinct] = code, 0
                    distinct += 1
                    place[slot] = distinct
                counts[place[slot] - 1] += 1
    for i in range(distinct):
        amount = np.sqrt(float(counts[i]))
        # The highest bit signs, the others place: colliding grams cancel as often as they add.
        row[(codes[i] & (_SIGN - 1)) % len(row)] += amount if codes[i] >= _SIGN else -amount
