"""The planner's advice: what memory recalled, and how earlier attempts of the episode failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from gvla2.episode.failure_diagnosis import diagnose, theme_of
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import PlanningError
from gvla2.memory.contracts import MemoryContext
from gvla2.planning.contracts import Advice, Done
from gvla2.planning.effects import Bound, effect_from_json, reconciled
from gvla2.planning.programs import Program
from gvla2.planning.skill import Signal, Skill
from gvla2.skills.table import STANDARD


def advice_for(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> Advice:
    """Memory's text, effects (reconciled) and programs, then those of failed attempts, which bind in the same way."""
    context = record.recalled or MemoryContext()
    recalled = [(item.effect, item.id) for item in context.items if item.effect]
    known = [effect_from_json(effect, source) for effect, source in recalled]
    effects = [*reconciled(one for one in known if not isinstance(one, Program))]
    programs = [one for one in known if isinstance(one, Program)]
    lines = [context.text] if context.text else []
    done: list[Done] = []
    for number, attempt in enumerate(record.attempts, 1):
        source, signals = f"attempt {number}", diagnose(attempt, skills)
        effects += [replace(signal.effect, source=source) for signal in signals if signal.effect is not None]
        done += _done(attempt, signals, skills)
        reasons = [signal.words for signal in signals]
        if not reasons and attempt.verdict is not None:
            reasons = [reason.rstrip(".") for reason in attempt.verdict.reasons]
        why = "; ".join(reasons) or "the goal was not reached"
        skill = f" ({attempt.plan.skill})" if attempt.plan is not None and attempt.plan.skill else ""
        lines.append(f"Earlier in this episode, {source}{skill} failed: {why}.")
    return Advice("\n".join(lines), tuple(effects), tuple(programs), tuple(done))


def _done(attempt: EpisodeRecord, signals: Sequence[Signal], skills: Mapping[str, Skill]) -> list[Done]:
    """The value that an attempt reached for a persistent parameter, where it was not enough."""
    plan, theme = attempt.plan, theme_of(attempt)
    if plan is None or theme is None or plan.skill not in skills:
        return []
    x, y, z = (float(v) for v in theme.centre)
    short = {s.effect.parameter for s in signals if s.kind == "undershoot" and isinstance(s.effect, Bound)}
    lasting = [name for name in skills[plan.skill].lasting if name in short]
    return [Done(plan.skill, name, plan.parameters[name], (x, y, z)) for name in lasting]


def with_sound_effects(context: MemoryContext) -> tuple[MemoryContext, tuple[str, ...]]:
    """The context with ill-defined effects removed from their items, and one note each."""
    items, notes = [], []
    for item in context.items:
        try:
            if item.effect:
                effect_from_json(item.effect)
        except PlanningError as error:
            notes.append(f"The effect of the remembered '{item.id}' was ignored: {error}")
            item = replace(item, effect=None)  # its words may still help
        items.append(item)
    return replace(context, items=tuple(items)), tuple(notes)
