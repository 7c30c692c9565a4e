"""The short notation for views and axis changes: ``0-4,7`` and ``perm012_signpnn``."""

from __future__ import annotations

import re

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray


def parse_view_spec(spec: str) -> tuple[int, ...]:
    """View numbers of a spec such as ``0-4,7``: numbers and closed ranges, in the order written.

    Raises :class:`ConfigurationError` for anything else: an empty spec, a range that runs backwards, a view twice.
    """
    numbers: list[int] = []
    for part in (p.strip() for p in spec.split(",")):
        match = re.fullmatch(r"(\d+)(?:\s*-\s*(\d+))?", part)
        if match is None:
            raise ConfigurationError(
                f"Cannot read '{part}' in the views '{spec}': write numbers and ranges, such as 0-4,7."
            )
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise ConfigurationError(f"The range '{part}' in the views '{spec}' runs backwards.")
        if last - first > 100_000:
            raise ConfigurationError(f"The range '{part}' in the views '{spec}' is longer than any data set.")
        numbers += range(first, last + 1)
    twice = sorted({n for n in numbers if numbers.count(n) > 1}) if len(set(numbers)) < len(numbers) else []
    if twice:
        raise ConfigurationError(f"The views '{spec}' name {', '.join(map(str, twice))} twice.")
    return tuple(numbers)


def parse_axis_word(word: str) -> FloatArray:
    """(3, 3) signed permutation of a transform word of the released code, or of ``identity``.

    ``perm021_signpnp`` means: the new axes are the old axes 0, 2 and 1, with the signs +, - and +. A word may name a
    mirror (determinant -1). Raises :class:`ConfigurationError` for anything else.
    """
    if word == "identity":
        return np.eye(3)
    match = re.fullmatch(r"perm([012]{3})_sign([pn]{3})", word)
    if match is None or len(set(match[1])) != 3:
        raise ConfigurationError(
            f"Cannot read the axis transform '{word}': write 'identity', or a permutation of 012 and three signs, "
            "p or n, such as perm021_signpnp."
        )
    matrix = np.zeros((3, 3))
    for row, (column, sign) in enumerate(zip(match[1], match[2], strict=True)):
        matrix[row, int(column)] = 1.0 if sign == "p" else -1.0
    return matrix


def parse_rotation_word(word: str) -> FloatArray:
    """(3, 3) rotation of a transform word; a :class:`ConfigurationError` for a mirror, which is not a rotation."""
    matrix = parse_axis_word(word)
    if np.linalg.det(matrix) < 0:
        raise ConfigurationError(
            f"The axis transform '{word}' is mirrored (determinant -1); flip one more sign."
        )
    return matrix
