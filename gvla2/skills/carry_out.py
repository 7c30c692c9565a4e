"""From skill calls to a plan: the one entry for all planners that use skills.

Picking an object up and then placing it is one placement; several placements into containers are one trajectory if it
is short enough. Any other call is planned alone, so that the robot looks again before the next.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.checks_motion import resolve_motion
from gvla2.planning.contracts import Abstention, AbstentionKind, Done, Plan, PlanRequest
from gvla2.planning.effects import Bound, Effect, Prior, apply_effects, look_of, own_first, sides_of
from gvla2.planning.part_hierarchy import CLEAR, assembled, joined, rise
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.skill import Job, Proposal, Skill
from gvla2.planning.trajectory import MAX_WAYPOINTS, Trajectory, Waypoint
from gvla2.skills.candidates import choose
from gvla2.skills.grounding import (
    Meant,
    meant,
    no_room,
    nonsense,
    still_held,
    turned,
    unaimed,
    unknown,
    whole_meant,
    wrong_parameters,
)
from gvla2.skills.parameters import limited, scales
from gvla2.skills.table import STANDARD

DEFAULTS = SkillOptions()
SAME_PLACE = 0.02
"""An object found this close to an earlier place is the same object, metres."""


def carry_out(calls: Sequence[SkillCall], request: PlanRequest, options: SkillOptions = DEFAULTS) -> Plan:
    """A plan for the first of ``calls``, or for as many as fit in one trajectory; the others are its ``remaining``.

    Never raises for calls that cannot be carried out: the plan has a typed abstention that says what exists. The skills
    are those of ``request.skills``, by default the standard ones. The whole program is searched for unknown skills and
    objects before its first part is planned.
    """
    skills = request.skills or STANDARD
    program = tuple(calls)
    refusal = unknown(program, request.scene, skills)
    if refusal is not None:
        return Plan(None, abstention=refusal, options=options)
    if (refusal := wrong_parameters(options.parameters, skills)) is not None:
        return Plan(None, abstention=refusal, options=options)
    for call in program:
        if (refusal := nonsense(call, request.scene, skills)) is not None:
            return Plan(None, call.skill, {"theme": call.theme}, abstention=refusal, options=options)
    for call, following in pairwise(program):
        if (refusal := still_held(call, following, request.scene)) is not None:
            return Plan(None, call.skill, {"theme": call.theme}, abstention=refusal, options=options)
    part = first_part(program, request.scene)
    calls_of_part = [call for call, _ in part]
    plan = (
        _one(calls_of_part[0], request, options, skills, (0, _sharing(calls_of_part[0], program)))
        if len(part) == 1
        else all_in_one(calls_of_part, request, lambda c, now, share: _one(c, now, options, skills, share))
    )
    done = sum(count for _, count in part[: len(plan.calls)]) if plan.calls else len(program)
    return replace(plan, calls=program[:done], remaining=program[done:], options=options)


def _sharing(first: SkillCall, program: Sequence[SkillCall]) -> int:
    """How many objects the program puts to where its first call puts one: that one must leave them room."""
    if first.relation not in ("on", "in") or not first.goal or first.xy is not None:
        return 1
    there = (first.goal, first.relation, None)
    return len(
        {first.theme, *(call.theme for call in program if (call.goal, call.relation, call.xy) == there)}
    )


def _one(
    call: SkillCall,
    request: PlanRequest,
    options: SkillOptions,
    skills: Mapping[str, Skill],
    share: tuple[int, int] = (0, 1),
) -> Plan:
    """The plan for one call, the k-th of n with the same goal (``share``)."""
    theme, goal = request.scene[call.theme], request.scene[call.goal] if call.goal else None
    what = (goal and no_room(theme, goal, call.relation, request.scene)) or meant(call, request.scene)
    if isinstance(what, Abstention):
        return Plan(None, call.skill, {"theme": call.theme}, abstention=what)
    if what.skill not in skills:
        message = f"This requires the skill '{what.skill}', which does not exist here; there are {', '.join(skills)}."
        return Plan(None, abstention=Abstention("unknown_skill", message))
    skill = skills[what.skill]
    call = replace(call, theme=what.theme.id, goal=what.goal.id if what.goal is not None else "")
    call = turned(call, what.theme) if what.skill == "twist" else call
    refusal = unaimed(call, skill, request.scene)
    plan = refusal or _planned(call, what, skill, request, options, share)
    if isinstance(plan, Abstention):
        plan = Plan(None, skill.name, {"theme": what.theme.id}, abstention=plan)
    return replace(plan, calls=(call,))


def _planned(
    call: SkillCall,
    what: Meant,
    skill: Skill,
    request: PlanRequest,
    options: SkillOptions,
    share: tuple[int, int],
) -> Plan | Abstention:
    theme, scene, goal = what.theme, request.scene, what.goal
    perceived = scene
    if skill.whole:
        theme, scene = joined(whole_meant(theme, scene), scene)
        if goal is not None and (goal.id == theme.id or goal in scene.parts_of(theme.id)):
            message = f"The {goal.label} belongs to the {theme.label}, which would be moved with it."
            return Abstention("other", message)
        request, theme = replace(request, scene=scene), assembled(theme, scene)
    seen = next((o for o in perceived.objects if o.id == theme.id), None)
    effects = own_first(request.advice.effects, look_of(seen, perceived))
    request = replace(request, advice=replace(request.advice, effects=effects))
    done = _done(request.advice.done, skill, theme)
    theta, notes = _theta(call, skill, theme, request, options, frozenset(done))
    done = {
        name: before for name, before in done.items() if before * theta[name] > 0.0
    }  # in the same direction
    # To finish it, as much again as at first; to find out how much it takes, step by step.
    if options.explore <= 0.0:
        first = _done(request.advice.done[::-1], skill, theme)
        theta |= {name: theta[name] + first[name] for name in done}
    role = skill.role("goal")
    relation = call.relation or (role.relations[0] if goal is not None and role and role.relations else "")
    job = Job(
        skill.name, scene, request.arm.hand, request.arm.workspace, theta, theme, goal, relation,
        _target(call, theme, options), share, done, options.grasp,
    )  # fmt: skip
    refusal = f"No way to {skill.name} the {theme.label}"
    return answer(job, skill, skill.propose(job), request, options, refusal, notes)


def answer(
    job: Job,
    skill: Skill,
    found: Sequence[Proposal] | Abstention,
    request: PlanRequest,
    options: SkillOptions,
    refusal: str,
    notes: Sequence[str] = (),
) -> Plan:
    """The plan for a job by the best of its proposals, or an abstention; ``refusal`` begins its message if none of
    them passes the checks.
    """
    roles = {"theme": job.theme.id} | ({"goal": job.goal.id} if job.goal is not None else {})
    roles |= {"part": job.theme.id} if skill.role("part") is not None else {}
    given = scales(skill.scaled, job.theta, sides_of(job.theme))
    plan = Plan(None, skill.name, roles, job.theta, notes=tuple(notes), scales=given, options=options)
    if isinstance(found, Abstention):
        return replace(plan, abstention=found)
    ranking = choose(found, request, job, options.tries)
    plan = replace(plan, candidates=ranking.candidates)
    if ranking.chosen is None:
        reasons = ranking.reasons()
        forbidden = bool(found) and reasons.startswith("memory forbids") and ";" not in reasons
        kind: AbstentionKind = "other" if request.rejections or forbidden else "unreachable"
        return replace(plan, abstention=Abstention(kind, f"{refusal}: {reasons}."))
    return replace(plan, trajectory=ranking.chosen.trajectory, notes=(*plan.notes, *ranking.chosen.notes))


def _overrules(effect: Effect, own: Mapping[str, float]) -> bool:
    """Whether an effect would overrule what the call itself says (an amount, on or off).

    A mean of earlier successes would, and a bound of the other sense, such as that of a turn the other way.
    """
    if not isinstance(effect, Prior | Bound) or effect.parameter not in own:
        return False
    return isinstance(effect, Prior) or effect.value * own[effect.parameter] <= 0.0


def _theta(
    call: SkillCall,
    skill: Skill,
    theme: SceneObject,
    request: PlanRequest,
    options: SkillOptions,
    stepwise: frozenset[str],
) -> tuple[dict[str, float], list[str]]:
    """The numbers and notes: defaults, then the call's own, memory's effects, variation to explore (except of the
    ``stepwise`` ones) and the scene's limits.
    """
    theta = dict(skill.defaults(theme, request.arm.hand, options))
    theta |= {k: float(v) for k, v in options.parameters.items() if k in theta}
    own = {k: float(v) for k, v in call.theta.items() if k in theta}
    if skill.amount and call.amount is not None:
        own[skill.amount] = call.amount
    raised: list[str] = []
    least = rise(theme, request.scene) + CLEAR
    if theta.get("lift_height", least) < least and "lift_height" not in own:
        raised = [
            f"lift_height: {theta['lift_height']:.4g} -> {least:.4g} to clear what the object stands in"
        ]
        theta["lift_height"] = least
    theta |= own
    effects = [e for e in request.advice.effects if not _overrules(e, own)]
    lengths = sides_of(theme)
    theta, notes = apply_effects(theta, effects, skill.name, lengths=lengths)
    if options.explore > 0.0:
        said = frozenset(own) | stepwise
        theta, tried = varied(theta, options.explore, options.explore_seed, request, theme.id, said)
        bounds = [e for e in effects if isinstance(e, Bound)]
        theta, kept = apply_effects(theta, bounds, skill.name, lengths=lengths)
        notes += [*tried, *kept]
    theta, limits = limited(theta, theme, request.scene)
    return theta, [*raised, *notes, *limits]


def _done(attempts: Sequence[Done], skill: Skill, theme: SceneObject) -> dict[str, float]:
    """The lasting effects of earlier attempts on this object, by parameter; the last one counts."""
    return {
        one.parameter: one.value
        for one in attempts
        if one.skill == skill.name
        and float(np.linalg.norm(np.subtract(one.place, theme.centre))) <= SAME_PLACE
    }


def _target(call: SkillCall, theme: SceneObject, options: SkillOptions) -> FloatArray | None:
    """(2,) the intended position of the theme's centre, if the call has a place or a direction."""
    if call.xy is not None:
        return np.asarray(call.xy, dtype=np.float64)
    if call.direction is None:
        return None
    way = np.asarray(call.direction, dtype=np.float64)
    distance = options.push_distance if call.amount is None else call.amount
    return np.asarray(theme.centre[:2] + distance * way / np.linalg.norm(way))


SPEEDS = ("speed", "contact_speed")
"""Never varied, for safety."""

LEAST, MOST = 0.5, 1.5
"""Bounds of the factors; a larger change would be a different motion."""


def varied(
    theta: Mapping[str, float],
    spread: float,
    seed: int,
    request: PlanRequest,
    theme: str,
    said: frozenset[str] = frozenset(),
) -> tuple[dict[str, float], list[str]]:
    """Theta with each number except the speeds multiplied by a log-normal factor, and one sentence for each change.

    ``spread`` is the standard deviation of the factors' logarithm, 0 for no variation. The factors are the same for the
    same seed, instruction, scene and ``theme`` (an id); each is independent of the other parameters. Numbers that are 0
    or that the instruction ``said`` (names) are kept.
    """
    changed: dict[str, float] = dict(theta)
    notes: list[str] = []
    if spread <= 0.0:
        return changed, notes
    seen = [[o.id, o.label, [round(1e3 * float(v)) for v in o.centre]] for o in request.scene.objects]
    for name in (n for n in theta if n not in SPEEDS and n not in said):
        key = json.dumps([seed, request.instruction, theme, name, seen]).encode()
        draw = np.random.default_rng(int.from_bytes(hashlib.blake2b(key, digest_size=8).digest(), "big"))
        changed[name] = theta[name] * float(np.clip(np.exp(spread * draw.standard_normal()), LEAST, MOST))
        if f"{changed[name]:.4g}" != f"{theta[name]:.4g}":
            notes.append(f"{name}: {theta[name]:.4g} -> {changed[name]:.4g} to explore")
    return changed, notes


MOST_OBJECTS = 3
"""Maximum number of objects in one trajectory: it has at most 20 waypoints, and each object takes six."""
WIDE = 0.06
"""A container's opening is wider than this, metres, so that objects fit side by side."""
INTO = ("", "on", "in", "to")


def first_part(program: Sequence[SkillCall], scene: Scene) -> list[tuple[SkillCall, int]]:
    """The calls that make the first plan of a program whose skills and objects all exist, each with the number of the
    program's calls that it merges.
    """
    found: list[tuple[SkillCall, int]] = []
    at = 0
    while at < len(program) and len(found) < MOST_OBJECTS:
        call, count = _merged(program[at:], scene)
        themes, goals = ({getattr(c, role) for c, _ in found} for role in ("theme", "goal"))
        if found and (not _fills(call, scene) or call.theme in themes | goals or call.goal in themes):
            break  # to be planned after another look
        found.append((call, count))
        at += count
        if not _fills(call, scene):
            break
    return found


def _merged(rest: Sequence[SkillCall], scene: Scene) -> tuple[SkillCall, int]:
    """The first call, merged with the next if that places what the first one picks, and the number of calls used."""
    first = rest[0]
    if len(rest) < 2 or rest[1].skill != "place" or first.goal or first.xy or first.direction:
        return first, 1
    what, then = meant(first, scene), rest[1]
    if isinstance(what, Abstention) or what.skill not in ("pick", "twist", "draw"):
        return first, 1
    same = {first.theme, what.theme.id}
    if what.skill == "pick":
        same |= {whole_meant(scene[i], scene).id for i in same}
        same |= {i for i in [then.theme] if whole_meant(scene[i], scene).id in same}
    if then.theme not in same:
        return first, 1
    theta = {**first.theta, **then.theta}
    if what.skill == "pick":
        theta.pop("lift_height", None)  # placing has its own lift
        return replace(then, theta=theta), 2
    return replace(then, skill=what.skill, theme=what.theme.id, theta=theta), 2


def _fills(call: SkillCall, scene: Scene) -> bool:
    return (
        call.skill == "place" and call.relation in INTO and bool(call.goal) and is_container(scene[call.goal])
    )


def is_container(obj: SceneObject) -> bool:
    """Whether it is for putting objects into: open at the top, and lower than wide."""
    wide = float(obj.extents[:2].min())
    whole = obj.shape != "region" and not obj.parent
    return whole and obj.opening > WIDE and obj.top - obj.bottom < wide


PlanOne = Callable[[SkillCall, PlanRequest, tuple[int, int]], Plan]


def all_in_one(calls: Sequence[SkillCall], request: PlanRequest, plan_one: PlanOne) -> Plan:
    """One plan for several calls; a refusal by ``plan_one`` refuses all.

    Calls that do not fit in the longest trajectory, or that are feasible only from the arm's first pose or before the
    others, are left out, to be planned after another look: the plan's ``calls`` are those in it.
    """
    waypoints: list[Waypoint] = []
    now, last, done = request, Plan(None), 0
    notes: list[str] = []
    goals = [call.goal for call in calls]
    for k, call in enumerate(calls):
        share = (goals[:k].count(call.goal), goals.count(call.goal))
        plan = plan_one(call, now, share)
        if plan.trajectory is None:
            rested = replace(now, start=request.start, joints=request.joints)
            if done and any(plan_one(call, *one).trajectory for one in ((rested, share), (request, (0, 1)))):
                break
            return replace(plan, calls=tuple(calls))
        more = brief(plan.trajectory)
        if done and len(waypoints) + len(more) > MAX_WAYPOINTS:
            break
        last, done = plan, done + 1
        waypoints += more
        notes += [n for n in plan.notes if n not in notes]
        now = after(now.scene[plan.roles["theme"]], plan.trajectory, now)
    if done == 1:
        return last
    roles = {f"theme_{k + 1}": call.theme for k, call in enumerate(calls[:done])}
    return replace(
        last,
        trajectory=Trajectory(tuple(waypoints)),
        roles={**last.roles, **roles},
        notes=tuple(notes),
        calls=tuple(calls[:done]),
    )


def brief(trajectory: Trajectory) -> list[Waypoint]:
    """The waypoints with the hand closing or opening on arrival instead of at a separate waypoint."""
    kept: list[Waypoint] = []
    for waypoint in trajectory:
        before = kept[-1] if kept else None
        grips_only = (
            before is not None
            and before.xyz == waypoint.xyz
            and before.orientation == waypoint.orientation
            and before.carries == waypoint.carries
        )
        if before is not None and grips_only:
            kept[-1] = replace(before, gripper=waypoint.gripper, stage=waypoint.stage)
        else:
            kept.append(waypoint)
    return kept


def after(obj: SceneObject, trajectory: Trajectory, request: PlanRequest) -> PlanRequest:
    """The request after the trajectory: the object moved, the arm at the end."""
    legs = resolve_motion(trajectory, request.scene, request.arm, request.start, request.joints)
    held = [leg for leg in legs if leg.waypoint.carries == obj.id]
    if not held:
        return request
    taken = legs[held[0].index - 1].pose
    moved = held[-1].pose @ invert_rigid(taken)
    joints = next((np.asarray(leg.samples[-1]) for leg in reversed(legs) if leg.samples), request.joints)
    return replace(request, scene=_moved(obj, moved, request.scene), start=legs[-1].pose, joints=joints)


def _moved(obj: SceneObject, by: FloatArray, scene: Scene) -> Scene:
    own = scene.family(obj.id)
    for each in scene.objects:
        if each.id in own:
            scene = scene.with_object(each.moved(by))
    return scene
