"""How a bank governs: the switches of the ablations and the thresholds, as plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from gvla2.errors import ConfigurationError


@dataclass
class BankOptions:
    """What a bank admits, shows and keeps; a component's configuration may inherit it.

    Switches, each of them an ablation of the paper when turned off: ``admission`` (off: unverified lessons are admitted
    too), ``replay`` (off: nothing is verified again), ``governance`` (off: nothing is retired, summarised, or archived
    for the budget, and contradictions stay), ``failures`` (off: nothing is learnt from failures). ``retrieval`` is
    "full", or "semantic", which ranks by similarity alone. ``show_provisional`` lets planners see unverified records,
    without binding force; ``frozen`` stops learning while recall goes on.

    Bounds: ``max_chars`` of a context; ``max_per_episode`` lessons; ``active_budget`` and ``provisional_budget``
    records.

    Consolidation: the ``rivals`` nearest are considered, and records are compared above a cosine of ``match``.
    Governance: unused failures retire after ``retire_days``; ``summary_size`` successes that are equal except for their
    numbers, or that share ``summary_match`` of their words and come from two tasks or more, become one summary. Replay
    looks at records with a confidence below ``replay_confidence``, at most ``replay_per_episode`` episodes after each
    that is learnt (0: only on demand).
    """

    admission: bool = True
    replay: bool = True
    governance: bool = True
    failures: bool = True
    retrieval: str = "full"
    show_provisional: bool = False
    frozen: bool = False
    max_chars: int = 2400
    max_per_episode: int = 16
    active_budget: int = 10_000
    provisional_budget: int = 2_000
    rivals: int = 16
    match: float = 0.35
    retire_days: float = 14.0
    summary_size: int = 3
    summary_match: float = 0.5
    replay_confidence: float = 0.4
    replay_per_episode: int = 1

    def check(self, where: str = "BankOptions") -> None:
        """Raises :class:`~gvla2.errors.ConfigurationError` for invalid values; ``where`` they were given."""
        if self.retrieval not in ("full", "semantic"):
            raise ConfigurationError(f"{where}.retrieval is '{self.retrieval}'; it must be full or semantic.")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, str | bool):
                continue
            if not math.isfinite(value) or value < 0:
                raise ConfigurationError(f"{where}.{field.name} is {value}; it must not be negative.")
            if field.name in SHARES and value > 1:
                raise ConfigurationError(f"{where}.{field.name} is {value}; it must lie in [0, 1].")


SHARES = frozenset(("match", "summary_match", "replay_confidence"))
