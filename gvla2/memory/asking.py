"""Asking untrusted verifiers and memories: whatever they do, there is a well-formed answer that says what was missing.

``who`` begins each sentence about them: "The verifier 'mine' of plugin 'mine'".
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from numbers import Real
from typing import TypeVar

from gvla2.errors import Gvla2Error, kept_alive
from gvla2.memory.contracts import (
    Evidence,
    Learned,
    Memory,
    MemoryContext,
    MemoryEpisode,
    MemoryTask,
    Verdict,
    Verifier,
)
from gvla2.memory.records import OUTCOMES

T = TypeVar("T")

log = logging.getLogger(__name__)


def verdict_of(verifier: Verifier, evidence: Evidence, name: str = "", who: str = "") -> Verdict:
    """The verifier's verdict; ``unavailable``, with the reason, if it raises or returns anything else.

    ``name`` is the verifier's in that verdict; without ``who`` its class is named.
    """
    who = who or f"The verifier '{name or type(verifier).__name__}'"
    asked = (lambda: verifier.verify(evidence)), _wrong_verdict
    return _asked(*asked, lambda reason: Verdict.unavailable(reason, name), who)


def context_of(memory: Memory, task: MemoryTask, who: str) -> MemoryContext:
    """What memory recalls; nothing, ``degraded`` with the reason, if it raises or returns anything else."""
    asked = (lambda: memory.recall(task)), _wrong_type(MemoryContext)
    return _asked(*asked, lambda reason: MemoryContext(degraded=reason), who)


def learned_of(memory: Memory, episode: MemoryEpisode, verdict: Verdict, who: str) -> Learned:
    """What memory learns; nothing, ``degraded`` with the reason, if it raises or returns anything else."""
    asked = (lambda: memory.learn(episode, verdict)), _wrong_type(Learned)
    return _asked(*asked, lambda reason: Learned(degraded=reason), who)


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
    """What is wrong with an answer that should be a verdict; whether its scores lie in [0, 1] is for admission."""
    if not isinstance(given, Verdict):
        return _wrong_type(Verdict)(given)
    numbers = (given.quality, given.confidence, *dict(given.criteria).values())
    if given.outcome not in OUTCOMES:
        return f"a verdict with outcome {given.outcome!r}, which is not one of {', '.join(OUTCOMES)}"
    return "" if all(isinstance(number, Real) for number in numbers) else f"{given!r:.200}, with odd scores"
