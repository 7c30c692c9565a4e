"""The planner: a sentence's readings, grounded in the scene, become skill calls."""

from __future__ import annotations

from dataclasses import fields, replace
from itertools import pairwise
from typing import cast

from gvla2.planning.calls import Relation, SkillCall, SkillOptions
from gvla2.planning.colours import colour_distance
from gvla2.planning.contracts import Abstention, AbstentionKind, Plan, PlanRequest, RefusedError
from gvla2.planning.part_hierarchy import button_of, is_ajar, knob_of
from gvla2.planning.scene import Scene, SceneObject
from gvla2.skills.carry_out import carry_out, is_container
from gvla2.skills.grounding import still_held, turned
from gvla2.skills.table import STANDARD
from gvla2_plugins.skill import SkillConfig
from gvla2_plugins.skill.grounding import Context, ground, section, several
from gvla2_plugins.skill.reading import ITS, Command, Noun, Reading, UnreadableError, readings

ABSORBED = {"pick": {"pick", "pull", "twist"}, "pull": {"pull"}, "place": {"place"}}
"""A call of the same theme that follows one of these asks for nothing more: "pick it up and lift it"."""
FINISHED_BY = {"pick": {"pull", "place"}, "pull": {"place"}}
"""A call is a part of one of these that follows it with the same theme: "pull it out and put it there"."""
TURN_OFF = "turn off"
"""What the reading calls a skill that only knobs have."""
CONTAINERS = frozenset(("bin", "tray", "basket", "container", "crate"))


class SkillPlanner:
    """Implements :class:`gvla2.planning.contracts.Planner` by a grammar and grounding. Deterministic."""

    def __init__(self, config: SkillConfig) -> None:
        self.config = config
        self.options = SkillOptions(**{f.name: getattr(config, f.name) for f in fields(SkillOptions)})

    def plan(self, request: PlanRequest) -> Plan:
        """A plan or a typed abstention, whatever the instruction says."""
        found = read(request.instruction, request.scene)
        if isinstance(found, Abstention):
            return Plan(None, abstention=found, options=self.options)
        return carry_out(found, request, self.options)


def read(sentence: str, scene: Scene) -> tuple[SkillCall, ...] | Abstention:
    """The skill calls of a sentence; an abstention where it has no reading that fits the scene, or several."""
    try:
        found = readings(sentence)
    except UnreadableError as error:
        kind: AbstentionKind = "unknown_skill" if error.verb or not sentence.strip() else "other"
        skills = f"; it can {', '.join(STANDARD)}" if kind == "unknown_skill" else ""
        return Abstention(kind, f"{error}{skills}.", unread=True)
    grounded: dict[str, tuple[SkillCall, ...]] = {}  # by their text: readings may come to the same
    refused: list[Abstention] = []
    for reading in found:
        try:
            calls = _calls(reading, scene)
            grounded["; ".join(map(str, calls))] = calls
        except RefusedError as error:
            refused.append(error.abstention)
    if len(grounded) == 1:
        return next(iter(grounded.values()))
    if grounded:
        message = f"The instruction may mean {' or '.join(list(grounded)[:3])}; say it in another way."
        return Abstention("ambiguous", message)
    order = ("ambiguous", "other", "no_goal", "nothing_matches", "unknown_skill")
    return min(refused, key=lambda a: (order.index(a.kind), len(a.message)))


def _calls(reading: Reading, scene: Scene) -> tuple[SkillCall, ...]:
    """The calls of a reading; raises :class:`RefusedError`."""
    calls: list[SkillCall] = []
    context = Context()
    for command in reading:
        made, context = _grounded(command, scene, context)
        for call in made:
            before = calls[-1] if calls else None
            if before is not None and before.theme == call.theme:
                if before.skill in ABSORBED.get(call.skill, ()) and not call.goal:
                    continue
                if call.skill in FINISHED_BY.get(before.skill, ()) and not before.goal:
                    calls.pop()
            calls.append(call)
    for call, following in pairwise(calls):
        if (refusal := still_held(call, following, scene)) is not None:
            raise RefusedError(refusal.kind, refusal.message)
    return tuple(calls)


def _grounded(command: Command, scene: Scene, context: Context) -> tuple[list[SkillCall], Context]:
    """The calls of a command, one for each of its themes, and what the next clause may refer to."""
    skill = "press" if command.skill == TURN_OFF else command.skill
    if skill not in STANDARD:
        message = f"No skill can {command.skill} anything; it can {', '.join(STANDARD)}."
        raise RefusedError("unknown_skill", message)
    goal = command.goal
    out = {o.id for noun in command.spared for o in _seen(noun, scene, context)}
    if goal is not None and (goal.relation == "matching" or any(map(several, command.themes))):
        out |= {o.id for o in _containers(scene)}
    if goal is not None and any(noun.number == "all" or several(noun) for noun in command.themes):
        out |= {o.id for noun in goal.nouns for o in ground(noun, scene, context)}
    themes: list[SceneObject] = []
    for noun in command.themes:
        if noun.number == "it" and context.goal and command.skill in ("open", "close", "press"):
            found = [scene[context.goal]]  # "put it in the drawer and close it"
        else:
            found = ground(noun, scene, context, skill=skill, out=frozenset(out), origins=command.origins)
        themes += [o for o in found if o not in themes]
    for noun in command.present:
        ground(noun, scene, Context(tuple(o.id for o in themes)))
    if len(themes) > 1 and (goal is None or goal.relation == "between"):
        names = ", ".join(o.label for o in themes)
        raise RefusedError("other", f"It names several objects, {names}; ask for one at a time.")
    calls = [_call(command, theme, scene, context) for theme in themes]
    ids = tuple(o.id for o in themes)
    closed = (*context.closed, *ids) if command.skill == "close" else context.closed
    return calls, Context(ids, calls[-1].goal, closed)


def _call(command: Command, theme: SceneObject, scene: Scene, context: Context) -> SkillCall:
    """The call for one theme; raises :class:`RefusedError` where its goal is not one certain object."""
    knob = knob_of(theme, scene)
    if knob is not None and command.skill in ("press", TURN_OFF) and button_of(theme, scene) is None:
        return turned(SkillCall("twist", knob.id), knob, on=command.skill == "press")
    if command.skill == TURN_OFF:
        raise RefusedError("unknown_skill", f"No skill can turn off the {theme.label}: it has no knob.")
    call = SkillCall(command.skill, theme.id, amount=command.amount, direction=command.direction)
    goal = command.goal
    if command.direction is not None and command.direction[1] and scene.viewpoint == "facing":
        call = replace(call, direction=(0.0, -command.direction[1]))
    if goal is None:
        return call
    if goal.relation in ("in", "on") and (spot := section(goal.nouns[0], scene, context)):
        return replace(call, goal=spot[0].id, relation="in", xy=spot[1])
    if goal.relation == "matching":
        found = _containers(scene)
        if len(found) < 2:
            raise RefusedError("nothing_matches", "There are no two containers to sort into.")
        at = min(found, key=lambda c: (c.colour != theme.colour, float(colour_distance(theme.rgb, c.rgb))))
        return replace(call, goal=at.id, relation="in")
    places = [_aim(noun, theme, scene, context) for noun in goal.nouns]
    if any(len(objects) != 1 for objects in places):
        names = ", ".join(o.label for objects in places for o in objects)
        raise RefusedError("ambiguous", f"'{goal.nouns[0].text}' may mean {names}; say which.")
    if goal.relation == "between":
        x, y = 0.5 * (places[0][0].centre + places[1][0].centre)[:2]
        return replace(call, xy=(float(x), float(y)))
    at, whole = places[0][0], scene.whole_of(places[0][0])
    if goal.relation == "on" and whole is not None and (at.id in context.closed or is_ajar(at) is False):
        at = whole  # nothing can be put on a closed drawer
    return replace(call, goal=at.id, relation=cast(Relation, goal.relation))


def _aim(noun: Noun, theme: SceneObject, scene: Scene, context: Context) -> list[SceneObject]:
    """What a goal's phrase means: preferably not what is put there."""
    if noun == replace(ITS, text="") and context.goal:
        return [scene[context.goal]]
    others = [] if noun.number == "it" else _seen(noun, scene, context, frozenset({theme.id}))
    return others or ground(noun, scene, context)


def _seen(noun: Noun, scene: Scene, context: Context, out: frozenset[str] = frozenset()) -> list[SceneObject]:
    """What a phrase means, if anything: what is not there cannot be touched."""
    try:
        return ground(noun, scene, context, out=out)
    except RefusedError:
        return []


def _containers(scene: Scene) -> list[SceneObject]:
    """Objects to put others into, by their shape or name."""
    wholes = [o for o in scene.objects if not o.parent and o.shape != "region"]
    return [o for o in wholes if is_container(o) or CONTAINERS & set(o.label.split())]
