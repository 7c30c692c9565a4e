"""Programs of several plans: continuing after a successful part, in the changed scene.

A planner may hand over more skill calls than one plan holds (open the drawer, then put the cube in). The loop carries
out the plan, moves the hand out of the cameras' view, looks again, finds the objects of the remaining calls in the new
scene, and plans on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.episode.evidence import correspond
from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.episode.replan import back_off
from gvla2.errors import PerceptionError, PlanningError
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener, RobotBackend
from gvla2.skills.carry_out import carry_out

AT_HOME = 0.05
"""Distance from the tool to its rest position below which the arm is out of the cameras' view, metres."""


@dataclass(frozen=True)
class Continuation:
    """The planner of the parts after the first: what remains of the program, by the objects' present ids."""

    calls: tuple[SkillCall, ...]
    options: SkillOptions

    def plan(self, request: PlanRequest) -> Plan:
        """The next plan. Raises :class:`PlanningError` for one that makes no progress."""
        plan = carry_out(self.calls, request, self.options)
        if plan.trajectory is not None and len(plan.remaining) >= len(self.calls):
            raise PlanningError(f"A plan for {_listed(self.calls)} carries out none of it.")
        return plan


def goes_on(record: EpisodeRecord) -> bool:
    """Whether the program has more parts, and nothing suggests that the last one failed."""
    return (
        record.failure is None
        and record.plan is not None
        and bool(record.plan.remaining)
        and record.after is not None
    )


def too_long(record: EpisodeRecord, most: int) -> EpisodeRecord:
    """The record of a program that would need more parts than allowed."""
    left = record.planned.plan.remaining
    message = (
        f"The program has more than {most} parts: {_listed(left)} would come next. max_parts=NUMBER allows more; "
        "or give the instruction in several runs."
    )
    return replace(record, failure=Failure("plan", "too_many_parts", message))


def next_part(record: EpisodeRecord) -> EpisodeRecord:
    """The record of the next part, which holds the ones before; instruction, memory's answer and notes stay."""
    return record.afresh(parts=record.whole)


def rest_of_program(record: EpisodeRecord) -> Continuation:
    """The calls that the previous part left to do, with ids of the record's scene.

    Raises :class:`PerceptionError` if one of its objects was not seen again.
    """
    before, after = record.parts[-1].planned, record.parts[-1].after_scene
    now = _present_ids(before.scene, after, record.seen.scene)
    calls = tuple(_translated(call, now, before.scene) for call in before.plan.remaining)
    return Continuation(calls, before.plan.options)


def _present_ids(before: Scene, ended: Scene | None, now: Scene) -> dict[str, str]:
    """Ids in ``now`` by the ids of ``before``, in which the previous part was planned.

    They are matched directly; objects that changed too much, via the scene in which that part ``ended``.
    """
    found = {old: new.id for old, new in correspond(before, now).later.items()}
    if ended is not None:
        midway, since = correspond(before, ended), correspond(ended, now)
        for obj in before.objects:
            then = midway.of(obj.id)
            later = since.of(then.id) if then is not None else None
            if obj.id not in found and later is not None and later.id not in found.values():
                found[obj.id] = later.id
    return found


def _translated(call: SkillCall, now: dict[str, str], scene: Scene) -> SkillCall:
    lost = next((name for name in (call.theme, call.goal) if name and name not in now), None)
    if lost is not None:
        label = next((o.label for o in scene.objects if o.id == lost), "")
        what = f"'{label}' ({lost})" if label else lost
        raise PerceptionError(f"{call} comes next, but {what} was not seen again after the previous part.")
    return replace(call, theme=now.get(call.theme, ""), goal=now.get(call.goal, ""))


def clear_the_view(robot: RobotBackend, part: EpisodeRecord, listener: ExecutionListener) -> str:
    """Move the hand out of the cameras' view before the next look, if it is in it; a held object is set down first.

    Returns "" or a sentence on what prevented it.
    """
    done = part.executed
    rest = robot.arm.forward(robot.arm.home)[:3, 3]
    away = float(np.linalg.norm(done.after.world_from_tcp[:3, 3] - rest))
    if away <= AT_HOME and done.after.gripper > 0.95:
        return ""
    down = _way_down(done.trajectory)
    if down is not None:
        stopped = robot.execute(down, part.after_scene or done.scene, listener).abort
        if stopped is not None:
            return f"The held object could not be set down before the next part: {stopped.message}"
        part = replace(part, after=robot.observe(), after_scene=None)  # it stands where it stood before
    return back_off(robot, part, listener)


def _way_down(done: Trajectory) -> Trajectory | None:
    """Back along the path on which the held object was lifted, to where it was grasped; None with an empty hand."""
    waypoints = done.waypoints
    held = waypoints[-1].carries if waypoints[-1].gripper < 0.5 else ""
    if not held:
        return None
    first = len(waypoints)
    while first > 0 and waypoints[first - 1].carries == held:
        first -= 1
    back = [replace(w, stage="set down", guard=None) for w in reversed(waypoints[first:-1])]
    return Trajectory((*back, _set_down(waypoints[first - 1], held)))


def _set_down(grasped: Waypoint, held: str) -> Waypoint:
    """An object is set down once the hand is back where it grasped it."""
    touching = grasped.allowed_contacts | {held, "table"}
    return replace(
        grasped, stage="set down", motion="linear", carries=held, allowed_contacts=touching, guard=None
    )


def with_whole_program(parts: Sequence[EpisodeRecord]) -> tuple[EpisodeRecord, ...]:
    """The parts as reported to memory: a split program is a success only if every part was.

    It is then reported with the last part; no single part vouches for it.
    """
    if len(parts) < 2 and not (parts and parts[0].partial):
        return tuple(parts)
    first, last = parts[0].plan, parts[-1].plan
    program = first.program if first is not None else None
    done = all(p.verdict is not None and p.verdict.outcome == "verified_success" for p in parts)
    finished = last is not None and last.trajectory is not None and not last.remaining
    reported = [replace(p, plan=replace(p.plan, program=None)) if p.plan is not None else p for p in parts]
    if done and finished and reported[-1].plan is not None:
        reported[-1] = replace(reported[-1], plan=replace(reported[-1].plan, program=program))
    return tuple(reported)


def words_of_part(record: EpisodeRecord) -> str:
    """The instruction of this part alone, in the user's or gvla2's own words: "place the red cube in".

    A verifier must not judge a part by the whole sentence, and a perceived label must not reach it as if the user
    had used it: only label words that occur in the instruction are kept.
    """
    plan, scene = record.plan, record.scene
    if plan is None or scene is None:
        return record.instruction
    given = set(record.instruction.casefold().replace(",", " ").replace(".", " ").split())
    objects = {o.id: o for o in scene.objects}
    calls = plan.calls or (SkillCall(plan.skill or "go on", *_roles(plan)),)
    sentences = []
    for call in calls:
        theme, goal = (_known(objects.get(name), given) for name in (call.theme, call.goal))
        words = (call.skill, theme, call.relation.replace("_", " "), goal)
        sentences.append(" ".join(word for word in words if word))
    return "; ".join(sentences)


def _roles(plan: Plan) -> tuple[str, str]:
    return plan.roles.get("theme", plan.roles.get("part", "")), plan.roles.get("goal", "")


def _known(obj: SceneObject | None, given: set[str]) -> str:
    if obj is None:
        return ""
    words = [w for w in dict.fromkeys(f"{obj.colour} {obj.label}".casefold().split()) if w in given]
    return f"the {' '.join(words)}" if words else "it"


def _listed(calls: Sequence[SkillCall]) -> str:
    return ", ".join(map(str, calls))
