"""Asking untrusted verifiers and memories: whatever they do, there is a well-formed answer that says what was missing.

``who`` begins each sentence about them: "The verifier 'mine' of plugin 'mine'".
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from numbers import Real
from typing import TypeVar

from gvla2.errors import Gvla2Error, kept_alive
from gvla2.memory.contracts import (
    OUTCOMES,
    Evidence,
    Learned,
    Memory,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Verdict,
    Verifier,
)

T = TypeVar("T")

log = logging.getLogger(__name__)


def verdict_of(verifier: Verifier, evidence: Evidence, name: str = "", who: str = "") -> Verdict:
    """The verifier's verdict; ``unavailable``, with the reason, if it raises or returns anything else.

    ``name`` is the verifier's in that verdict; without ``who`` its class is named.
    """
    who = who or f"The verifier '{name or type(verifier).__name__}'"

    def unavailable(reason: str) -> Verdict:
        return Verdict.unavailable(reason, name)

    return _asked(lambda: verifier.verify(evidence), _wrong_verdict, unavailable, who)


def context_of(memory: Memory, task: MemoryTask, who: str) -> MemoryContext:
    """What memory recalls; nothing, ``degraded`` with the reason, if it raises or returns anything else."""

    def degraded(reason: str) -> MemoryContext:
        return MemoryContext(degraded=reason)

    return _asked(lambda: memory.recall(task), _wrong_type(MemoryContext), degraded, who)


def learned_of(memory: Memory, episode: MemoryEpisode, verdict: Verdict, who: str) -> Learned:
    """What memory learns; nothing, ``degraded`` with the reason, if it raises or returns anything else."""

    def degraded(reason: str) -> Learned:
        return Learned(degraded=reason)

    return _asked(lambda: memory.learn(episode, verdict), _wrong_type(Learned), degraded, who)


def _asked(
    answer: Callable[[], T], problem: Callable[[object], str], instead: Callable[[str], T], who: str
) -> T:
    """The answer, or what there is ``instead`` of it for a reason."""
    try:
        with kept_alive():
            given = answer()
    except Gvla2Error as error:
        return instead(str(error))
    except Exception as error:
        log.info("%s crashed.", who, exc_info=True)
        return instead(f"{who} crashed: {type(error).__name__}: {error}")
    wrong = problem(given)
    return instead(f"{who} returned {wrong}.") if wrong else given


def _wrong_type(wanted: type) -> Callable[[object], str]:
    """What is wrong with an answer of any other type, worded to follow "returned"; "" if nothing."""
    return lambda given: (
        "" if isinstance(given, wanted) else f"{type(given).__name__}, not a {wanted.__name__}"
    )


def _wrong_verdict(given: object) -> str:
    """What is wrong with an answer that should be a verdict, as :func:`_wrong_type`.

    Whether its scores lie in [0, 1] is for admission to say.
    """
    if not isinstance(given, Verdict):
        return _wrong_type(Verdict)(given)
    tests = {
        "outcome": (given.outcome in OUTCOMES, f"one of {', '.join(OUTCOMES)}"),
        "quality": (isinstance(given.quality, Real), "a number"),
        "confidence": (isinstance(given.confidence, Real), "a number"),
        "criteria": (_numbers(given.criteria), "a mapping from names to numbers"),
        "reasons": (_texts(given.reasons), "a tuple of texts"),
    }
    for name, (fits, wanted) in tests.items():
        if not fits:
            return f"a verdict with {name} {getattr(given, name)!r:.100}, which is not {wanted}"
    return ""


def _numbers(values: object) -> bool:
    return isinstance(values, Mapping) and all(isinstance(value, Real) for value in values.values())


def _texts(values: object) -> bool:
    return isinstance(values, tuple | list) and all(isinstance(value, str) for value in values)
