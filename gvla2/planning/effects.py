"""Typed effects: how a remembered lesson changes a planner's parameters theta, and the limits that checks enforce.

Values that scale with the object (how deep to grasp it) are remembered as shares of one of its sides, so that a lesson
from a cube of 5 cm applies to one of 7 cm; those of the hand and the room stay in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

from gvla2.errors import PlanningError
from gvla2.planning.scene import SceneObject

REQUIRED: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "bound": ("parameter", "op", "value"),
        "prior": ("parameter", "value", "count"),
        "forbid": ("parameter",),
        "order": ("parameter",),
    }
)
"""The required JSON fields of each kind of effect."""

SIDES = ("length", "width", "height")
"""Sides of the handled object that values may be shares of: its longer and shorter horizontal side, and its height."""

Scale = tuple[str, float]
"""One of :data:`SIDES` and its length, metres, > 0."""

BEFORE = " before "
"""Separates the two stages of an ``order``."""


@dataclass(frozen=True)
class Effect:
    """One typed lesson about a parameter of a skill.

    * ``bound``: ``parameter`` ``op`` ``value`` must hold (``op`` is ">=" or "<="): a constraint from a failure.
    * ``prior``: ``parameter`` was good at mean ``value`` with deviation ``sd`` over ``count`` successes: a hint.
    * ``forbid``: the named approach ``parameter`` (for example "approach:top") must not be used.
    * ``order``: ``parameter`` is "A before B": if a plan has both stages, the first A comes before the first B.

    ``skill`` limits it to one skill ("" is any). Values are in the parameter's own unit (see the planner) or, if
    ``scale`` names a side (:data:`SIDES`), shares of that side of the handled object. ``source`` is the id of the
    memory record it comes from. ``object`` is the look of the thing it was learnt on
    (:func:`~gvla2.planning.looks.look_of`), "" for any thing.
    """

    kind: Literal["bound", "prior", "forbid", "order"]
    parameter: str
    value: float = 0.0
    op: Literal[">=", "<="] = ">="
    sd: float = 0.0
    count: int = 0
    skill: str = ""
    source: str = ""
    scale: str = ""
    object: str = ""

    def to_json(self) -> dict[str, Any]:
        """As a JSON object; without empty ``scale`` and ``object``, compatible with older records."""
        data = asdict(self)
        for name in ("scale", "object"):
            if not data[name]:
                del data[name]
        return data

    @classmethod
    def from_json(cls, data: Mapping[str, Any], source: str = "") -> Effect:
        """From a JSON object; raises :class:`PlanningError` when it is not an effect, or lacks what its kind needs.

        A ``bound`` needs ``op`` and ``value``, a ``prior`` ``value`` and ``count``; the defaults above would invent a
        lesson. Numbers must be finite.
        """
        try:
            effect = cls(**{**data, "source": source or data.get("source", "")})
        except TypeError as error:
            raise PlanningError(f"Not a parameter effect: {dict(data)!r} ({error}).") from error
        if fault := effect._fault(data):
            raise PlanningError(f"Not a parameter effect: {dict(data)!r} {fault}.")
        return effect

    def _fault(self, data: Mapping[str, Any]) -> str:
        """What is wrong with the effect of a JSON object, worded to follow it; "" if nothing."""
        if self.kind not in REQUIRED or self.op not in (">=", "<="):
            return (
                f"has kind '{self.kind}' and op '{self.op}'; kinds are {', '.join(REQUIRED)}, op is >= or <="
            )
        if absent := [name for name in REQUIRED[self.kind] if name not in data]:
            return f"lacks {' and '.join(absent)}, which a {self.kind} needs"
        numbers = (self.value, self.sd, self.count)
        if not all(isinstance(n, int | float) and math.isfinite(n) for n in numbers):
            return "has a value that is not a number"
        if self.scale not in ("", *SIDES):
            return f"has the scale {self.scale!r}; there are {', '.join(SIDES)}"
        if self.kind == "order" and not all(self.stages):
            return f"does not say 'A{BEFORE}B'"
        return ""

    @property
    def stages(self) -> tuple[str, str]:
        """The two stages of an ``order``, the earlier first; empty if it names none."""
        earlier, _, later = self.parameter.partition(BEFORE)
        return earlier.strip(), later.strip()

    def shared(self, scales: Mapping[str, Scale]) -> Effect:
        """The effect in shares of the side that the plan's ``scales`` give for its parameter, if any."""
        side, length = scales.get(self.parameter, ("", 0.0))
        if self.scale or self.kind not in ("bound", "prior") or side not in SIDES or length <= 0.0:
            return self
        return replace(self, value=self.value / length, sd=self.sd / length, scale=side)

    def absolute(self, lengths: Mapping[str, float]) -> Effect | None:
        """The effect in the parameter's own unit, for an object of these ``lengths`` (metres, by side).

        None if it is a share of a side that they do not give.
        """
        if not self.scale:
            return self
        length = lengths.get(self.scale, 0.0)
        if not length > 0.0:
            return None
        return replace(self, value=self.value * length, sd=self.sd * length, scale="")


def sides_of(thing: SceneObject) -> dict[str, float]:
    """The length of each of :data:`SIDES` of a perceived thing, metres."""
    width, length = sorted(float(v) for v in thing.extents[:2])
    return {"length": length, "width": width, "height": thing.top - thing.bottom}


def reconciled(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects without bounds on one parameter (of one skill, look and scale) that exclude each other.

    No plan could obey both. What succeeded is a fact, why something failed is a guess: such bounds are moved to admit
    what succeeded; those that exclude each other even then, or of which nothing succeeded, are left out.
    """
    given = tuple(effects)
    moved = [_admitting(e, given) if _excluded(e, given) else e for e in given]
    return tuple(e for e in moved if not _excluded(e, moved))


def _about(effect: Effect) -> tuple[str, ...]:
    return effect.parameter, effect.skill, effect.object, effect.scale


def _admitting(bound: Effect, others: Sequence[Effect]) -> Effect:
    succeeded = [e.value for e in others if e.kind == "prior" and e.count > 0 and _about(e) == _about(bound)]
    loosest = min if bound.op == ">=" else max
    return replace(bound, value=loosest([bound.value, *succeeded]))


def _excluded(bound: Effect, others: Iterable[Effect]) -> bool:
    """Whether another bound leaves no value that ``bound`` allows."""
    sign = 1.0 if bound.op == ">=" else -1.0
    rivals = (
        o
        for o in others
        if o.kind == bound.kind == "bound" and o.op != bound.op and _about(o) == _about(bound)
    )
    return any(sign * bound.value > sign * rival.value for rival in rivals)


def apply_effects(
    parameters: Mapping[str, float],
    effects: Iterable[Effect],
    skill: str,
    prior_strength: float = 2.0,
    *,
    lengths: Mapping[str, float] | None = None,
) -> tuple[dict[str, float], list[str]]:
    """Parameters after priors (a pull of count / (count + prior_strength) to the mean), then bounds (clamps).

    ``lengths`` are the handled object's sides, metres: effects in shares of a side that is not given are skipped.
    Returns the new parameters and one plain sentence per change, for the run's page.
    """
    changed, notes = dict(parameters), []
    relevant: list[Effect] = []
    for effect in effects:
        if effect.skill not in ("", skill) or effect.parameter not in changed:
            continue
        if (own := effect.absolute(lengths or {})) is None:
            notes.append(
                f"{effect.parameter}: {effect.source} was ignored, the object's {effect.scale} is unknown"
            )
        else:
            relevant.append(own)
    for effect in (e for e in relevant if e.kind == "prior" and e.count > 0):
        before = changed[effect.parameter]
        changed[effect.parameter] += effect.count / (effect.count + prior_strength) * (effect.value - before)
        if f"{changed[effect.parameter]:.4g}" != f"{before:.4g}":
            notes.append(
                f"{effect.parameter}: {before:.4g} -> {changed[effect.parameter]:.4g} from experience {effect.source}"
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


def disordered(effect: Effect, stages: Sequence[str]) -> bool:
    """Whether a plan's ``stages``, in order, violate an ``order``: both are present, the later one first.

    It does not apply to a plan without one of them: other planners name their stages differently.
    """
    earlier, later = effect.stages
    if effect.kind != "order" or earlier not in stages or later not in stages:
        return False
    return list(stages).index(later) < list(stages).index(earlier)
