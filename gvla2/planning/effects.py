"""Typed effects: how a remembered lesson changes a planner's parameters theta."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Literal

from gvla2.errors import PlanningError

REQUIRED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "bound": ("parameter", "op", "value"),
        "prior": ("parameter", "value", "count"),
        "forbid": ("parameter",),
    }
)
"""What an effect of each kind must say for itself when it is read from JSON."""


@dataclass(frozen=True)
class Effect:
    """One typed lesson about a parameter of a skill.

    * ``bound``: ``parameter`` ``op`` ``value`` must hold (``op`` is ">=" or "<="): a constraint from a failure.
    * ``prior``: ``parameter`` was good at mean ``value`` with deviation ``sd`` over ``count`` successes: a hint.
    * ``forbid``: the named approach ``parameter`` (for example "approach:top") must not be used.

    ``skill`` limits it to one skill ("" is any). Values are in the parameter's own unit (see the planner).
    ``source`` is the id of the memory record it comes from.
    """

    kind: Literal["bound", "prior", "forbid"]
    parameter: str
    value: float = 0.0
    op: Literal[">=", "<="] = ">="
    sd: float = 0.0
    count: int = 0
    skill: str = ""
    source: str = ""

    def to_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str = "") -> Effect:
        """From a JSON object; raises :class:`PlanningError` when it is not an effect, or lacks what its kind needs.

        A ``bound`` needs ``op`` and ``value``, a ``prior`` ``value`` and ``count``; the defaults above would make up
        a lesson that nobody learnt. Numbers must be finite.
        """
        try:
            effect = cls(**{**data, "source": source or data.get("source", "")})
        except TypeError as error:
            raise PlanningError(f"Not a parameter effect: {dict(data)!r} ({error}).") from error
        if effect.kind not in ("bound", "prior", "forbid") or effect.op not in (">=", "<="):
            raise PlanningError(f"Not a parameter effect: {dict(data)!r}.")
        absent = [name for name in REQUIRED[effect.kind] if name not in data]
        if absent:
            raise PlanningError(
                f"Not a parameter effect: {dict(data)!r} lacks {' and '.join(absent)}, which a {effect.kind} needs."
            )
        numbers = (effect.value, effect.sd, effect.count)
        if not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers):
            raise PlanningError(f"Not a parameter effect: {dict(data)!r} has a number that is none.")
        return effect


def apply_effects(
    parameters: Mapping[str, float], effects: Iterable[Effect], skill: str, prior_strength: float = 2.0
) -> tuple[dict[str, float], list[str]]:
    """Parameters after priors (a pull of count / (count + prior_strength) to the mean), then bounds (clamps).

    Returns the new parameters and one plain sentence a change, for the run's page.
    """
    changed, notes = dict(parameters), []
    relevant = [e for e in effects if e.skill in ("", skill) and e.parameter in changed]
    for effect in (e for e in relevant if e.kind == "prior" and e.count > 0):
        before = changed[effect.parameter]
        changed[effect.parameter] += effect.count / (effect.count + prior_strength) * (effect.value - before)
        if f"{changed[effect.parameter]:.4g}" != f"{before:.4g}":
            notes.append(
                f"{effect.parameter}: {before:.4g} -> {changed[effect.parameter]:.4g} by experience {effect.source}"
            )
    for effect in (e for e in relevant if e.kind == "bound"):
        before = changed[effect.parameter]
        bounded = max(before, effect.value) if effect.op == ">=" else min(before, effect.value)
        if bounded != before:
            changed[effect.parameter] = bounded
            notes.append(
                f"{effect.parameter}: {before:.4g} -> {bounded:.4g}, bound {effect.op} {effect.value:.4g} "
                f"from {effect.source}"
            )
    return changed, notes
