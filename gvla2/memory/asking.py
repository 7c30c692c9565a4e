"""Calling untrusted verifiers and memories: whatever they do, there is a well-formed answer that says what was missing.

``who`` begins each sentence about them: "The verifier 'mine' of plugin 'mine'".
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from numbers import Real
from typing import TypeVar

from gvla2.errors import Gvla2Error, kept_alive
from gvla2.memory.contracts import Evidence, Verdict, Verifier
from gvla2.memory.records import OUTCOMES

T = TypeVar("T")

log = logging.getLogger(__name__)


def answer_of(call: Callable[[], T], wanted: type[T], instead: Callable[[str], T], who: str) -> T:
    """The call's answer; what there is ``instead``, for a reason, if it raises or returns anything not ``wanted``."""
    try:
        with kept_alive():
            given = call()
    except Gvla2Error as error:
        return instead(str(error))
    except Exception as error:
        log.info("%s crashed.", who, exc_info=True)
        return instead(f"{who} crashed: {type(error).__name__}: {error}")
    if not isinstance(given, wanted):
        return instead(f"{who} returned {type(given).__name__}, not a {wanted.__name__}.")
    return given


def verdict_of(verifier: Verifier, evidence: Evidence, name: str = "", who: str = "") -> Verdict:
    """The verifier's verdict; ``unavailable``, with the reason, if it raises or returns anything else.

    ``name`` is the verifier's in that verdict; without ``who`` its class is named. Whether scores lie in [0, 1] is for
    admission.
    """
    who = who or f"The verifier '{name or type(verifier).__name__}'"

    def unavailable(reason: str) -> Verdict:
        return Verdict.unavailable(reason, name)

    given = answer_of(lambda: verifier.verify(evidence), Verdict, unavailable, who)
    numbers = (given.quality, given.confidence, *dict(given.criteria).values())
    if given.outcome not in OUTCOMES or not all(isinstance(number, Real) for number in numbers):
        known = f"outcomes are {', '.join(OUTCOMES)}, and scores are numbers"
        return unavailable(f"{who} returned an invalid verdict ({given!r:.200}): {known}.")
    return given
