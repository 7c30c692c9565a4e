"""A verifier that is sometimes wrong, to find out how much of that a memory can bear."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from gvla2 import Component, ComponentConfig, hookimpl
from gvla2.component import check_ranges

if TYPE_CHECKING:
    from gvla2.memory.contracts import Evidence, Verdict, Verifier


@dataclass
class FlakyConfig(ComponentConfig):
    """Options of the ``flaky`` verifier: of the sure verdicts of the verifier ``inner``, with its ``options``, a share
    ``rate`` says the opposite, and a share ``withheld`` says nothing. ``seed`` decides which.
    """

    inner: str = "geometric"
    options: dict[str, Any] = field(default_factory=dict)
    rate: float = 0.2
    withheld: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        check_ranges(self, "verifier", dict.fromkeys(("rate", "withheld"), (0, 1, "")))


class FlakyVerifier:
    """Turns some verdicts of another verifier into the opposite, as sure as they were, and withholds others.

    What is judged decides which, so that it says the same of the same episode again.
    """

    def __init__(self, inner: Verifier, config: FlakyConfig) -> None:
        self._inner, self._config = inner, config

    def verify(self, evidence: Evidence) -> Verdict:
        """The other verifier's verdict, or the opposite; what that one leaves open stays open."""
        verdict = self._inner.verify(evidence)
        judged = f"{self._config.seed}\n{evidence.instruction}\n{evidence.transcript}"
        draw = int.from_bytes(hashlib.blake2b(judged.encode(), digest_size=6).digest()) / 2**48
        if verdict.outcome not in ("verified_success", "verified_fail"):
            return verdict
        if draw >= 1.0 - self._config.withheld:
            return verdict.unavailable("The verdict is withheld.", verdict.verifier)
        if draw >= self._config.rate:
            return verdict
        return replace(
            verdict,
            outcome="verified_fail" if verdict.outcome == "verified_success" else "verified_success",
            quality=1.0 - verdict.quality,
            criteria={name: 1.0 - score for name, score in verdict.criteria.items()},
            reasons=(),
        )


def _build(config: FlakyConfig) -> Verifier:
    """Another verifier (``verifier.inner``), wrong or silent in a share of its verdicts: a stress for memories."""
    from gvla2.plugins.registry import load_plugins

    chosen = {"verifier": {**config.options, "name": config.inner}}
    return FlakyVerifier(load_plugins(("verifier",)).build(chosen, "verifier"), config)


@hookimpl
def gvla2_verifiers() -> list[Component[Verifier]]:
    """The one verifier of this plugin."""
    return [Component("flaky", FlakyConfig, _build)]
