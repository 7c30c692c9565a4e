"""The planner: from words to skill calls. It never sees a task's name; what a call means, the core tells."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.carry_out import carry_out
from gvla2.skills.meaning import suited
from gvla2.skills.table import STANDARD
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.exceptions import excepted
from gvla2_plugins.skill.grammar import Intent, parse
from gvla2_plugins.skill.grounding import Grounded, ground, ground_button
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.sorting import sorting
from gvla2_plugins.skill.worked import ground_worked

WORKED = ("open", "close", "pull", "twist")
"""Verbs that ask for something to be worked; the core tells how."""


@dataclass(frozen=True)
class Reading:
    """What a sentence asks for, by the ids of a scene, and what was assumed in reading it."""

    calls: tuple[SkillCall, ...]
    notes: tuple[str, ...] = ()


class SkillPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by a grammar and grounding. Deterministic."""

    def __init__(self, config: SkillConfig) -> None:
        self.config = config
        self.options = SkillOptions(
            config.lift_height, config.push_distance, config.speed, config.contact_speed,
            config.tries, config.explore, config.explore_seed,
        )  # fmt: skip

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention, whatever the instruction says."""
        found = read(request.instruction, request.scene, self.config.spelling)
        if isinstance(found, Abstention):
            return Plan(None, abstention=found, options=self.options)
        made = carry_out(found.calls, request, self.options)
        return replace(made, notes=(*found.notes, *made.notes))


def read(sentence: str, scene: Scene, spelling: float = 0.85) -> Reading | Abstention:
    """The skill calls of a sentence; an abstention where it cannot be read with certainty."""
    pairs = sorting(sentence, scene, spelling)
    if isinstance(pairs, Abstention):
        return pairs
    if pairs is not None:
        return Reading(tuple(SkillCall("place", t.id, c.id, relation="in") for t, c in pairs))
    intent = parse(sentence, [o.label for o in scene.objects], spelling)
    if refusal := _not_understood(intent, sentence):
        return refusal
    out = excepted(intent, scene)
    if isinstance(out, Abstention):
        return out
    theme = _theme(intent, scene, out)
    if isinstance(theme, Abstention) and (aimed := _aimed(intent)) is not None:
        # "Get the block on the square", where no block is on a square: it is to go there.
        intent, theme = aimed, _theme(aimed, scene, out)
    if isinstance(theme, Abstention):
        return theme
    goal = _goal(intent, theme.object, scene, out)
    if isinstance(goal, Abstention):
        return goal
    if goal is not None and intent.relation == "in" and _solid(goal.object):
        return Abstention("other", f"The {goal.object.label} is not seen to be open: nothing goes into it.")
    notes = (*intent.notes, *theme.notes, *(goal.notes if goal is not None else ()))
    return Reading((_call(intent, theme.object, goal),), notes)


def _theme(intent: Intent, scene: Scene, out: frozenset[str]) -> Grounded | Abstention:
    """What it is done to, none of ``out``. Without a name, the one thing that can be moved, if there is only one."""
    phrase = intent.theme or Phrase("it", pronoun=True)
    seen = replace(scene, objects=tuple(o for o in scene.objects if o.id not in out))
    if intent.skill == "press":
        return ground_button(intent.theme, seen)
    return ground_worked(phrase, seen) if intent.skill in WORKED else ground(phrase, seen, movable=True)


def _goal(
    intent: Intent, theme: SceneObject, scene: Scene, out: frozenset[str]
) -> Grounded | Abstention | None:
    """The goal, looked for only where what is meant has one: "pull the drawer out of the cabinet" has none."""
    if intent.goal is None or intent.skill == "press":
        return None
    skill = suited(intent.skill, theme, scene, aimed=True)
    if STANDARD[skill].role("goal") is None:
        return None
    return ground(intent.goal, scene, exclude=frozenset({theme.id}) | out)


def _solid(thing: SceneObject) -> bool:
    shut = thing.shape in ("box", "cylinder", "sphere") and not thing.opening and not thing.parent
    return shut and thing.label.split()[-1:] in (
        ["cube"],
        ["box"],
        ["cylinder"],
        ["ball"],
        ["brick"],
        ["can"],
    )


def _call(intent: Intent, theme: SceneObject, goal: Grounded | None) -> SkillCall:
    relation = intent.relation if goal is not None else ""
    return SkillCall(
        intent.skill,
        theme.id,
        goal.object.id if goal is not None else "",
        relation=relation,  # type: ignore[arg-type]
        amount=intent.amount,
        direction=intent.direction if goal is None else None,
    )


def _aimed(intent: Intent) -> Intent | None:
    """A taking of what is said to be on something, read as putting it there; None for any other."""
    landmark = intent.theme.landmark if intent.theme is not None else None
    if (
        intent.skill != "pick"
        or intent.theme is None
        or landmark is None
        or landmark[0] not in ("on", "in", "to")
    ):
        return None
    theme, goal = replace(intent.theme, landmark=None), landmark[1]
    return replace(intent, skill="place", theme=theme, goal=goal, relation=landmark[0])


def _not_understood(intent: Intent, instruction: str) -> Abstention | None:
    asked = " ".join(instruction.split())[:200]
    known = ", ".join(STANDARD)
    if (intent.skill and intent.skill not in STANDARD) or (not intent.skill and intent.trouble):
        return Abstention("unknown_skill", f"'{asked}': {intent.trouble}; it can {known}.")
    if not intent.skill:
        return Abstention("unknown_skill", f"'{asked}' has no verb that this planner knows; it can {known}.")
    if intent.trouble:
        return Abstention("other", f"'{asked}': {intent.trouble}.")
    return None
