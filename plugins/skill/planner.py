"""The planner: parse, ground, parametrise, propose, choose. It never sees a task's name, only words and geometry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.planning.contracts import Abstention, Plan, PlanRequest
from gvla2.planning.effects import apply_effects, sides_of
from gvla2.planning.scene import SceneObject
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.candidates import choose
from gvla2_plugins.skill.exploring import varied
from gvla2_plugins.skill.fitting import fitted, unscrewed
from gvla2_plugins.skill.grammar import Intent, parse
from gvla2_plugins.skill.grounding import Grounded, ground, ground_button
from gvla2_plugins.skill.joined import joined
from gvla2_plugins.skill.parameters import defaults, limited, scales
from gvla2_plugins.skill.phrases import Phrase
from gvla2_plugins.skill.proposals import Job, Proposal
from gvla2_plugins.skill.schemas import SCHEMAS
from gvla2_plugins.skill.schemas.pick import CLEAR
from gvla2_plugins.skill.several import one_by_one
from gvla2_plugins.skill.sorting import Pair, sorting
from gvla2_plugins.skill.suited import WORKED, ground_worked, suited
from gvla2_plugins.skill.wholes import assembled, rise

CARRIED = ("pick", "place")
"""Skills that move a thing with all its parts."""


class SkillPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by a grammar, grounding and staged schemas.

    Deterministic; parameters are those of :mod:`gvla2_plugins.skill.parameters`.
    """

    def __init__(self, config: SkillConfig) -> None:
        self.config = config

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention, whatever the instruction says."""
        pairs = sorting(request.instruction, request.scene, self.config.spelling)
        if isinstance(pairs, Abstention):
            return Plan(None, skill="place", abstention=pairs)
        if pairs is not None:
            return one_by_one(pairs, request, self._sort)
        labels = [o.label for o in request.scene.objects]
        intent = parse(request.instruction, labels, self.config.spelling)
        plan = Plan(None, skill=intent.skill if intent.skill in SCHEMAS else "", notes=intent.notes)
        if refusal := _not_understood(intent, request.instruction):
            return replace(plan, abstention=refusal)
        theme = self._theme(intent, request)
        if isinstance(theme, Abstention) and (aimed := _aimed(intent)) is not None:
            # "Get the block on the square", where no block is on a square: it is to go there.
            intent, theme = aimed, self._theme(aimed, request)
        if isinstance(theme, Abstention):
            return replace(plan, abstention=theme)
        intent = replace(
            intent, skill=suited(intent.skill, theme.object, request.scene, aimed=intent.goal is not None)
        )
        skill, thing = unscrewed(intent.skill, theme.object, request.scene)
        intent, theme = replace(intent, skill=skill), replace(theme, object=thing)
        plan = replace(plan, skill=intent.skill)
        if intent.skill not in SCHEMAS:
            message = f"It is not known how to {intent.verb} the {theme.object.label}."
            return replace(plan, skill="", abstention=Abstention("unknown_skill", message))
        goal = self._goal(intent, theme.object, request)
        if isinstance(goal, Abstention):
            return replace(plan, abstention=goal, roles={"theme": theme.object.id})
        roles = {"theme": theme.object.id}
        if intent.skill == "press":
            roles["part"] = theme.object.id
        notes = [*intent.notes, *theme.notes]
        if goal is not None:
            roles["goal"] = goal.object.id
            notes += goal.notes
            intent = replace(intent, skill=fitted(intent, theme.object, goal.object, request.scene))
        return self._propose(intent, theme.object, goal.object if goal else None, roles, notes, request)

    def _sort(self, pair: Pair, request: PlanRequest) -> Plan:
        """One thing of several into its container."""
        roles = {"theme": pair.thing.id, "goal": pair.container.id}
        intent = Intent("place", "sort", relation="in")
        share = (pair.rank, pair.count)
        return self._propose(intent, pair.thing, pair.container, roles, [], request, share)

    def _theme(self, intent: Intent, request: PlanRequest) -> Grounded | Abstention:
        if intent.skill == "press":
            return ground_button(intent.theme, request.scene)
        if intent.skill in WORKED:
            return ground_worked(intent.theme or Phrase("it", pronoun=True), request.scene)
        # Without a name, the one thing that can be moved is meant, if there is only one.
        phrase = intent.theme or Phrase("it", pronoun=True)
        return ground(phrase, request.scene, movable=True)

    def _goal(self, intent: Intent, theme: SceneObject, request: PlanRequest) -> Grounded | Abstention | None:
        if intent.goal is not None and intent.skill in ("place", "push", "draw", "twist"):
            return ground(intent.goal, request.scene, exclude=frozenset({theme.id}))
        if intent.skill in ("place", "push") and intent.direction is None:
            return Abstention(
                "no_goal",
                f"Where to {intent.verb} the {theme.label} is not said; name a goal or a direction, such as "
                f"'onto the red square' or '10 cm to the left'.",
            )
        return None

    def _propose(
        self,
        intent: Intent,
        theme: SceneObject,
        goal: SceneObject | None,
        roles: dict[str, str],
        notes: list[str],
        request: PlanRequest,
        share: tuple[int, int] = (0, 1),
    ) -> Plan:
        if intent.skill in CARRIED:
            theme, scene = joined(theme, request.scene)
            request, roles = replace(request, scene=scene), {**roles, "theme": theme.id}
            theme = assembled(theme, scene)
        theta = defaults(intent.skill, theme, request.arm.hand, self.config)
        if "lift_height" in theta:
            drawn = max(theta["lift_height"], rise(theme, request.scene) + CLEAR)
            theta["lift_height"] = drawn if intent.amount is None else intent.amount
        lengths = sides_of(theme)
        theta, changes = apply_effects(theta, request.advice.effects, intent.skill, lengths=lengths)
        if self.config.explore > 0.0:
            config, bounds = self.config, [e for e in request.advice.effects if e.kind == "bound"]
            said = frozenset({"lift_height"} if intent.amount is not None else ())
            theta, tried = varied(theta, config.explore, config.explore_seed, request, theme.id, said)
            theta, kept = apply_effects(theta, bounds, intent.skill, lengths=lengths)
            changes += [*tried, *kept]
        theta, limits = limited(theta, theme, request.scene)
        target = None
        if goal is None and intent.direction is not None:
            distance = intent.amount if intent.amount is not None else self.config.push_distance
            target = theme.centre[:2] + distance * np.asarray(intent.direction)
        job = Job(
            intent.skill, request.scene, request.arm.hand, request.arm.workspace, theta, theme, goal,
            intent.relation, target, share,
        )  # fmt: skip
        given = scales(intent.skill, theta, lengths)
        plan = Plan(None, intent.skill, roles, theta, notes=(*notes, *changes, *limits), scales=given)
        found = SCHEMAS[intent.skill](job)
        if isinstance(found, Abstention):
            return replace(plan, abstention=found)
        ranking = choose(found, request, intent.skill, theta, self.config.tries, lengths)
        plan = replace(plan, candidates=ranking.candidates)
        if ranking.chosen is None:
            kind = (
                "other" if request.rejections or _all_forbidden(found, ranking.reasons()) else "unreachable"
            )
            message = f"No way to {intent.skill} the {theme.label}: {ranking.reasons()}."
            return replace(plan, abstention=Abstention(kind, message))
        return replace(plan, trajectory=ranking.chosen.trajectory, notes=(*plan.notes, *ranking.chosen.notes))


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


def _all_forbidden(found: list[Proposal], reasons: str) -> bool:
    return bool(found) and reasons.startswith("memory forbids") and ";" not in reasons


def _not_understood(intent: Intent, instruction: str) -> Abstention | None:
    asked = " ".join(instruction.split())[:200]
    known = ", ".join(SCHEMAS)
    if (intent.skill and intent.skill not in SCHEMAS) or (not intent.skill and intent.trouble):
        return Abstention("unknown_skill", f"'{asked}': {intent.trouble}; it can {known}.")
    if not intent.skill:
        return Abstention("unknown_skill", f"'{asked}' has no verb that this planner knows; it can {known}.")
    if intent.trouble:
        return Abstention("other", f"'{asked}': {intent.trouble}.")
    return None
