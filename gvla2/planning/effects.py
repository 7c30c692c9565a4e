"""Typed effects: how a remembered lesson changes a planner's parameters theta, and the limits that checks enforce.

An effect is one of :class:`Bound`, :class:`Prior` and :class:`Ban`; memory stores them as JSON
(:func:`effect_from_json`). Values that scale with the object (how deep to grasp it) are
remembered as shares of one of its sides, so that a lesson from a cube of 5 cm applies to one of 7 cm; those of the
hand and the room stay in SI units. Objects that look alike are assumed to behave alike, until proven otherwise: how
far a cap must be turned cannot be seen, that it is the gray lid of a red jar can.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from typing import Any, ClassVar, Literal, Self

from gvla2.errors import PlanningError
from gvla2.planning.programs import Program
from gvla2.planning.scene import Scene, SceneObject

SIDES = ("length", "width", "height")
"""Sides of the handled object that values may be shares of: its longer and shorter horizontal side, and its height."""
Scale = tuple[str, float]
"""One of :data:`SIDES` and its length, metres, > 0."""
PRIOR_STRENGTH = 2.0
"""Successes after which a prior's mean counts as much as the default."""
ON = " on "
"""Separates the colours of a part and its whole in a look."""


@dataclass(frozen=True)
class _Lesson:
    """What all effects have in common: ``parameter`` is what the lesson is about.

    ``skill`` limits it to one skill ("" is any); ``object`` is the look of the object that it was learned on
    (:func:`look_of`), "" for any; ``source`` is the id of the memory record that it comes from.
    """

    kind: ClassVar[str]
    parameter: str
    skill: str = field(default="", kw_only=True)
    object: str = field(default="", kw_only=True)
    source: str = field(default="", kw_only=True)

    def to_json(self) -> dict[str, Any]:
        """As a JSON object; an empty ``object`` or ``scale`` is left out."""
        own = {
            name: value for name, value in asdict(self).items() if value or name not in ("object", "scale")
        }
        return {"kind": self.kind, **own}


@dataclass(frozen=True)
class _Measured(_Lesson):
    """A lesson about a number: in the parameter's own unit, or in shares of the side ``scale`` of the object."""

    value: float
    scale: str = field(default="", kw_only=True)

    def absolute(self, lengths: Mapping[str, float]) -> Self | None:
        """The effect in the parameter's own unit, for an object of these ``lengths`` (metres, by side).

        None if it is a share of a side that they do not give.
        """
        if not self.scale:
            return self
        length = lengths.get(self.scale, 0.0)
        return self.scaled(length, "") if length > 0.0 else None

    def scaled(self, factor: float, scale: str) -> Self:
        """The effect multiplied by ``factor``, in shares of ``scale``."""
        return replace(self, value=self.value * factor, scale=scale)


@dataclass(frozen=True)
class Bound(_Measured):
    """``parameter`` ``op`` ``value`` must hold: a constraint from a failure."""

    kind: ClassVar[str] = "bound"
    op: Literal[">=", "<="] = ">="

    def clamped(self, value: float) -> float:
        """The allowed value nearest to ``value``, if the bound is in the parameter's own unit."""
        return max(value, self.value) if self.op == ">=" else min(value, self.value)


@dataclass(frozen=True)
class Prior(_Measured):
    """``parameter`` was good at mean ``value`` with deviation ``sd`` over ``count`` successes: a hint."""

    kind: ClassVar[str] = "prior"
    count: int
    sd: float = 0.0

    def scaled(self, factor: float, scale: str) -> Self:
        """The prior multiplied by ``factor``, in shares of ``scale``."""
        return replace(super().scaled(factor, scale), sd=self.sd * factor)


@dataclass(frozen=True)
class Ban(_Lesson):
    """The approach ``parameter`` (for example "approach:top") must not be used."""

    kind: ClassVar[str] = "forbid"


Effect = Bound | Prior | Ban
_KINDS: Mapping[str, type[Effect]] = {one.kind: one for one in (Bound, Prior, Ban)}
_NUMBERS = ("value", "sd", "count")
_FIELDS = {"kind", *(f.name for one in _KINDS.values() for f in fields(one))}


def effect_from_json(data: Mapping[str, Any], source: str = "") -> Effect | Program:
    """An effect or a program from its JSON; raises :class:`PlanningError` for anything else.

    Nothing required may be left out: a default value would invent a lesson. Numbers must be finite.
    """
    if data.get("kind") == "program":
        return Program.from_json(data, source)
    kind = _KINDS.get(str(data.get("kind")))
    own = () if kind is None else fields(kind)
    given = {f.name: data[f.name] for f in own if f.name in data}
    missing = [f.name for f in own if f.default is MISSING and f.name not in given]
    words = [name for name, value in given.items() if name not in _NUMBERS and not isinstance(value, str)]
    numbers = [name for name in _NUMBERS if name in given and not _finite(given[name])]
    wrong = [*(set(data) - _FIELDS), *missing, *words, *numbers]
    if given.get("scale", "") not in ("", *SIDES) or (kind is Bound and data.get("op") not in (">=", "<=")):
        wrong.append("scale or op")
    if kind is None or wrong:
        kinds = ", ".join(_KINDS)
        reason = (
            f"wrong or missing: {', '.join(sorted(map(str, wrong)))}"
            if kind
            else f"kinds are {kinds}, program"
        )
        raise PlanningError(f"Not a parameter effect: {dict(data)!r:.300}; {reason}.")
    return kind(**given | ({"source": source} if source else {}))


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def as_shares(effect: Effect, scales: Mapping[str, Scale]) -> Effect:
    """The effect in shares of the side that the plan's ``scales`` give for its parameter, if any."""
    side, length = scales.get(effect.parameter, ("", 0.0))
    if isinstance(effect, Ban) or effect.scale or side not in SIDES or length <= 0.0:
        return effect
    return effect.scaled(1.0 / length, side)


def sides_of(obj: SceneObject) -> dict[str, float]:
    """The length of each of :data:`SIDES` of a perceived object, metres."""
    width, length = sorted(float(v) for v in obj.extents[:2])
    return {"length": length, "width": width, "height": obj.top - obj.bottom}


def look_of(obj: SceneObject | None, scene: Scene) -> str:
    """An object's look in colour words: "red", or "gray on red" for a part of something red.

    "" for no object, or if its colour is unknown. Colours, not labels: the noun depends on the view.
    """
    if obj is None or not obj.colour:
        return ""
    known = {other.id: other for other in scene.objects}
    whole, seen = obj, {obj.id}
    while whole.parent in known and whole.parent not in seen:
        whole = known[whole.parent]
        seen.add(whole.id)
    return obj.colour if whole is obj or not whole.colour else f"{obj.colour}{ON}{whole.colour}"


def own_first(effects: Iterable[Effect], look: str) -> tuple[Effect, ...]:
    """The effects that apply to an object of this look.

    Lessons from objects that look like it replace lessons from others, per subject and skill; without any, the others'
    are the best guess. Effects without a look stay.
    """
    given = tuple(effects)
    own = [(one.parameter, one.skill) for one in given if look and one.object == look]

    def replaced(effect: Effect) -> bool:
        skills = [skill for name, skill in own if name == effect.parameter]
        return any("" in (effect.skill, skill) or effect.skill == skill for skill in skills)

    return tuple(one for one in given if one.object in ("", look) or not replaced(one))


def reconciled(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """The effects without bounds on one parameter (of one skill, look and scale) that exclude each other.

    No plan could obey both. What succeeded is a fact, why something failed is a guess: such bounds are moved to admit
    what succeeded; those that exclude each other even then, or without any success, are left out.
    """
    given = tuple(effects)
    moved = list(given)
    for k, bound in enumerate(given):
        if isinstance(bound, Bound) and _excluded(bound, given):
            good = [
                e.value for e in given if isinstance(e, Prior) and e.count > 0 and _about(e) == _about(bound)
            ]
            moved[k] = replace(bound, value=(min if bound.op == ">=" else max)([bound.value, *good]))
    return tuple(e for e in moved if not (isinstance(e, Bound) and _excluded(e, moved)))


def _about(effect: Bound | Prior) -> tuple[str, ...]:
    return effect.parameter, effect.skill, effect.object, effect.scale


def _excluded(bound: Bound, others: Iterable[Effect]) -> bool:
    """Whether another bound leaves no value that ``bound`` allows."""
    sign = 1.0 if bound.op == ">=" else -1.0
    rivals = (o for o in others if isinstance(o, Bound) and o.op != bound.op and _about(o) == _about(bound))
    return any(sign * bound.value > sign * rival.value for rival in rivals)


def apply_effects(
    parameters: Mapping[str, float],
    effects: Iterable[Effect],
    skill: str,
    *,
    lengths: Mapping[str, float] | None = None,
) -> tuple[dict[str, float], list[str]]:
    """Parameters after priors (a pull of count / (count + PRIOR_STRENGTH) to the mean), then bounds (clamps).

    ``lengths`` are the handled object's sides, metres: effects in shares of a side that is not given are skipped.
    Returns the new parameters and one plain sentence per change, for the run's page.
    """
    changed, notes = dict(parameters), list[str]()
    measured = [effect for effect in effects if isinstance(effect, Bound | Prior)]
    for effect in sorted(measured, key=lambda one: isinstance(one, Bound)):
        name, own = effect.parameter, effect.absolute(lengths or {})
        if effect.skill not in ("", skill) or name not in changed:
            continue
        before, source = changed[name], effect.source
        if own is None:
            notes.append(f"{name}: {source} was ignored, the object's {effect.scale} is unknown")
        elif isinstance(own, Prior):
            pull = own.count / (own.count + PRIOR_STRENGTH) if own.count > 0 else 0.0
            changed[name] += pull * (own.value - before)
            why = f"from experience {source}"
        else:
            changed[name] = own.clamped(before)
            why = f"bound {own.op} {own.value:.4g} from {source}"
        if f"{changed[name]:.4g}" != f"{before:.4g}":
            notes.append(f"{name}: {before:.4g} -> {changed[name]:.4g} {why}")
    return changed, notes
