"""Forms of words: which concepts of two texts are the same, in languages without a stemmer of their own."""

from __future__ import annotations

from collections.abc import Set


def alike(first: str, second: str) -> bool:
    """Whether two concepts are the same or forms of one word."""
    if first == second:
        return True
    if first[-1] in "+-" or second[-1] in "+-" or first.startswith("nr") or second.startswith("nr"):
        return False
    shared = 0
    for a, b in zip(first, second, strict=False):
        if a != b:
            break
        shared += 1
    return shared >= 3 and shared >= max(len(first), len(second)) - (
        3 if shared >= 6 else 2 if shared >= 4 else 1
    )


def starts_of(words: Set[str]) -> frozenset[str]:
    """How the words begin. Forms of one word begin alike: where the starts of some words are not all among those of
    others, one of the words is for certain no form of any of the others.
    """
    return frozenset([word[:3] for word in words])


def split_alike(first: Set[str], second: Set[str]) -> tuple[list[str], list[str], list[str]]:
    """What both have, what only the first has, and what only the second has, sorted; forms of a word are one."""
    both, left, right = set(first & second), first - second, second - first
    if left and right:
        fitting = {
            (word, other) for word in left for other in right if word[:3] == other[:3] and alike(word, other)
        }
        both |= {word for word, _ in fitting}
        left = left - {word for word, _ in fitting}
        right = right - {other for _, other in fitting}
    return sorted(both), sorted(left), sorted(right)
