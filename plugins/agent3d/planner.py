"""The planner: prompt the model, read its waypoints, lift them into the scene, ask again with the checks' findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files

from gvla2.language import LanguageModel, Message
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.programs import remembered, waypoints_program
from gvla2.planning.scene_brief import SceneBrief, scene_brief
from gvla2.skills.model_planning import (
    InfeasiblePlanError,
    ask_for_plan,
    instruction_in,
    nothing_to_ask,
    rejected_answer,
)
from gvla2.skills.path_lifting import MOST_POINTS, lift
from gvla2_plugins.agent3d import Agent3dConfig
from gvla2_plugins.agent3d.waypoint_programs import (
    RememberedPath,
    grammar,
    path_of,
    read_steps,
    remembered_paths,
    schema,
    with_ids,
    written,
)

EXAMPLE_OBJECTS = {
    False: "tan_sponge 60x50x40\nwhite_bowl 140x140x60 open 130",
    True: "tan_sponge 60x50x40 at 100,50\nwhite_bowl 140x140x60 open 130 at 300,-100",
}
EXAMPLE_TASK = "drop the sponge into the bowl"
EXAMPLE_PATH = {
    False: '[["tan_sponge",0,0,100,1],["tan_sponge",0,0,-20,1],["tan_sponge",0,0,-20,0],'
    '["tan_sponge",0,0,120,0],["white_bowl",0,0,100,0],["white_bowl",0,0,20,1]]',
    True: "[[100,50,120,1],[100,50,20,1],[100,50,20,0],[100,50,190,0],[300,-100,180,0],[300,-100,80,1]]",
}


class Agent3d:
    """Implements :class:`gvla2.planning.contracts.Planner` by a language model's waypoints (paper: 3DAgent)."""

    def __init__(self, config: Agent3dConfig, language: LanguageModel) -> None:
        self.config = config
        self._language = language
        self._bare = config.waypoints == "bare"
        self._options = SkillOptions(speed=config.speed, contact_speed=config.contact_speed)

    def plan(self, request: PlanRequest) -> Plan:
        """A plan along the model's waypoints, or an abstention with the whole conversation.

        Raises :class:`gvla2.language.LanguageModelError` when the model cannot be asked.
        """
        if (refusal := nothing_to_ask(request)) is not None:
            return refusal
        bare, config = self._bare, self.config
        brief = scene_brief(request.scene, positions=bare, points=config.points)
        known = [] if bare else remembered_paths(request, brief, config.programs, self._options)
        most = max((len(path.steps) + 1 for path in known), default=MOST_POINTS)

        def plan_of(text: str) -> Plan:
            plan = self._lifted(text, brief, request)
            if plan.abstention is not None:
                raise InfeasiblePlanError(
                    plan.abstention, brief.named(plan.abstention.message, request.scene)
                )
            return plan

        plan, _ = ask_for_plan(
            self._language,
            [*messages(request, brief, known, bare=bare), *rejected_answer(request, brief)],
            plan_of,
            tries=config.tries,
            samples=config.samples,
            same=lambda plan: repr(plan.trajectory),
            schema=schema(list(brief.ids), bare=bare),
            grammar=grammar(list(brief.ids), bare=bare, max_points=most),
            seed=config.explore_seed,
            temperature=config.explore or None,
            max_tokens=config.max_tokens,
        )
        return plan

    def _lifted(self, text: str, brief: SceneBrief, request: PlanRequest) -> Plan:
        steps = read_steps(text, brief.ids, bare=self._bare)
        plan = lift(path_of(steps, brief.ids, request.scene, bare=self._bare), request, self._options)
        if self._bare:
            return plan
        about = {"roles": plan.roles, "skill": plan.skill, "instruction": request.instruction}
        return replace(plan, program=waypoints_program(with_ids(steps, brief.ids), request.scene, **about))


def messages(
    request: PlanRequest, brief: SceneBrief, known: Sequence[RememberedPath], *, bare: bool
) -> list[Message]:
    """The question, after answered examples: one of the format, then remembered paths with present names and sizes.

    Memory's text is enclosed in marks, as data.
    """
    about = [name for path in known for name in path.names]
    lines = sorted(brief.text.splitlines(), key=lambda line: line.partition(" ")[0] not in about)
    objects = "\n".join(lines)  # those of the remembered paths first
    turns = [(_question(EXAMPLE_OBJECTS[bare], EXAMPLE_TASK), EXAMPLE_PATH[bare])]
    turns += [(_question(objects, path.task), written(path.steps)) for path in known]
    form = files(__package__).joinpath("bare.md" if bare else "relative.md").read_text("utf-8").strip()
    asked: list[Message] = [{"role": "system", "content": form}]
    for question, answer in turns:
        asked += [{"role": "user", "content": question}, {"role": "assistant", "content": answer}]
    words = filter(None, (remembered(request.advice.text), _question(objects, instruction_in(request))))
    return [*asked, {"role": "user", "content": "\n".join(words)}]


def _question(objects: str, task: str) -> str:
    return f"Objects (name, length x width x height in mm):\n{objects}\nTask: {task}"
