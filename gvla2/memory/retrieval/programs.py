"""Whether a scene has what a program needs: its roles ("cup cylinder") against the things that could be handled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gvla2.memory.indexing.terms import terms


def filled(effect: Mapping[str, Any] | None, things: Sequence[str]) -> float | None:
    """How well the things can fill the program's roles, each thing one of them: 0 (no role) to 1 (every role in full).

    A role is filled by the share of its words that the thing has: a mug is no cup, but both may be cylinders. The best
    pairs are taken first. None for what is no program, or has no roles, or where nothing is known of the things.
    """
    roles = (effect or {}).get("roles")
    if (
        not effect
        or effect.get("kind") != "program"
        or not isinstance(roles, Mapping)
        or not (roles and things)
    ):
        return None
    wanted = [terms(str(role)) for role in roles.values()]
    offered = [terms(thing) for thing in things]
    pairs = sorted(
        (
            (len(need & have) / len(need) if need else 1.0, i, j)
            for i, need in enumerate(wanted)
            for j, have in enumerate(offered)
        ),
        key=lambda pair: (-pair[0], pair[1:]),
    )
    total, done, taken = 0.0, set[int](), set[int]()
    for share, i, j in pairs:
        if i not in done and j not in taken:
            total += share
            done.add(i)
            taken.add(j)
    return total / len(wanted)
