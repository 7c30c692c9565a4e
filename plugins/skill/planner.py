"""The planner: from words to skill calls. It never sees a task's name; what a call means, the core tells."""

from __future__ import annotations

from dataclasses import replace

from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.scene import SceneObject
from gvla2.skills.carry_out import carry_out
from gvla2.skills.meaning import suited
from gvla2.skills.table import STANDARD
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.grammar import Intent, parse
from gvla2_plugins.skill.grounding import Grounded, ground, ground_button
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.sorting import sorting
from gvla2_plugins.skill.worked import ground_worked

WORKED = ("open", "close", "pull", "twist")
"""Verbs that ask for something to be worked; the core tells how."""


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
        pairs = sorting(request.instruction, request.scene, self.config.spelling)
        if isinstance(pairs, Abstention):
            return Plan(None, skill="place", abstention=pairs)
        if pairs is not None:
            calls = [SkillCall("place", thing.id, container.id, relation="in") for thing, container in pairs]
            return carry_out(calls, request, self.options)
        labels = [o.label for o in request.scene.objects]
        intent = parse(request.instruction, labels, self.config.spelling)
        plan = Plan(None, skill=intent.skill if intent.skill in STANDARD else "", notes=intent.notes)
        if refusal := _not_understood(intent, request.instruction):
            return replace(plan, abstention=refusal)
        theme = self._theme(intent, request)
        if isinstance(theme, Abstention) and (aimed := _aimed(intent)) is not None:
            # "Get the block on the square", where no block is on a square: it is to go there.
            intent, theme = aimed, self._theme(aimed, request)
        if isinstance(theme, Abstention):
            return replace(plan, abstention=theme)
        goal = self._goal(intent, theme.object, request)
        if isinstance(goal, Abstention):
            return replace(plan, abstention=goal, roles={"theme": theme.object.id})
        call = _call(intent, theme.object, goal)
        made = carry_out([call], request, self.options)
        notes = (*intent.notes, *theme.notes, *(goal.notes if goal is not None else ()))
        return replace(made, notes=(*notes, *made.notes))

    def _theme(self, intent: Intent, request: PlanRequest) -> Grounded | Abstention:
        if intent.skill == "press":
            return ground_button(intent.theme, request.scene)
        # Without a name, the one thing that can be moved is meant, if there is only one.
        phrase = intent.theme or Phrase("it", pronoun=True)
        if intent.skill in WORKED:
            return ground_worked(phrase, request.scene)
        return ground(phrase, request.scene, movable=True)

    def _goal(self, intent: Intent, theme: SceneObject, request: PlanRequest) -> Grounded | Abstention | None:
        """The goal, looked for only where what is meant has one: "pull the drawer out of the cabinet" has none."""
        if intent.goal is None:
            return None
        skill = suited(intent.skill, theme, request.scene, aimed=True)
        if intent.skill == "press" or STANDARD[skill].role("goal") is None:
            return None
        return ground(intent.goal, request.scene, exclude=frozenset({theme.id}))


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
