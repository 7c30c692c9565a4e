"""What follows a motion: the next part of its program, a second try of the same part, or another attempt at the whole.

A planner may hand over more skill calls than one plan holds (open the drawer, then put the cube in). The loop carries
out the plan, moves the hand out of the cameras' view, looks again, finds the objects of the remaining calls in the new
scene, and plans on. An object that the hand surely missed or lost is tried again by the same calls, with another grasp
or place. An attempt that surely failed may be repeated from the start, by the planner.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gvla2.episode.evidence import correspond
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import PerceptionError, PlanningError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation
from gvla2.planning.calls import SkillCall, SkillOptions
from gvla2.planning.contracts import Plan, PlanRequest
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.skill import Skill
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener, RobotBackend
from gvla2.robot.report import ExecutionReport
from gvla2.skills.carry_out import carry_out
from gvla2.skills.table import STANDARD

AT_HOME = 0.05
"""Distance from the tool to its rest position below which the arm is out of the cameras' view, metres."""
NO_MORE = ("not_started", "interrupted", "diverged")
"""Stops after which the robot must not move again by itself."""

MOVED = 0.02
"""Distance by which a camera must have moved for its picture to show other things, metres."""
TABLE_MOVED = 0.02
"""Difference of two looks at the table's height above which the later one is wrong, metres: tables do not move."""
SHORT = 0.3
"""Planned seconds of a motion below which starting and stopping count for more than its speed."""
RISE = 0.10
"""Metres that the opened hand rises straight up before it goes home, or up to the workspace's edge."""


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


def has_next_part(record: EpisodeRecord) -> bool:
    """Whether the program has more parts, and nothing suggests that the last one failed."""
    return (
        record.failure is None
        and record.plan is not None
        and bool(record.plan.remaining)
        and record.after is not None
    )


def next_part(record: EpisodeRecord) -> EpisodeRecord:
    """The record of the next part, which holds the ones before; instruction, memory's answer and notes stay."""
    return record.afresh(parts=record.whole)


def remaining_program(record: EpisodeRecord) -> Continuation:
    """The calls that the previous part, or a failed try of this one, left to do, with ids of the record's scene.

    Raises :class:`PerceptionError` if one of its objects was not seen again.
    """
    last = previous(record)
    before = last.planned
    now = present_ids(before.scene, last.after_scene, record.seen.scene)
    calls = tuple(_translated(call, now, before.scene) for call in _to_do(record))
    return Continuation(calls, before.plan.options)


def _to_do(record: EpisodeRecord) -> tuple[SkillCall, ...]:
    """The calls for which the record's part is planned, with ids of the scene before; none in a new attempt."""
    last = previous(record) if record.parts or record.second_try else None
    if last is None or last.plan is None:
        return ()
    return calls_left(last) if record.second_try else last.plan.remaining


def with_covered(scene: Scene, record: EpisodeRecord) -> Scene:
    """The scene with the objects of the remaining calls that the previous motion hid: a plate under the mug that was
    put on it is where it was.
    """
    calls = _to_do(record)
    if not calls:
        return scene
    last = previous(record)
    before, trajectory = last.planned.scene, last.planned.plan.trajectory
    carried = {w.carries for w in trajectory.waypoints} if trajectory is not None else set()
    now = present_ids(before, last.after_scene, scene)
    for name in dict.fromkeys(name for call in calls for name in (call.theme, call.goal) if name):
        obj = before[name]
        if name not in now and name not in carried and any(_stands_on(each, obj) for each in scene.objects):
            scene = replace(scene, objects=(*scene.objects, replace(obj, id=f"covered {name}")))
    return scene


def _stands_on(obj: SceneObject, lower: SceneObject) -> bool:
    """Whether an object's middle is above a lower one, at a height where the two can touch."""
    return lower.covers(obj.centre) and lower.bottom - MOVED < obj.bottom < lower.top + MOVED


def previous(record: EpisodeRecord) -> EpisodeRecord:
    """The motion before this record's: a failed try of the same part, the part before it, or the attempt before."""
    return record.attempts[-1] if record.second_try or not record.parts else record.parts[-1]


def present_ids(before: Scene, ended: Scene | None, now: Scene) -> dict[str, str]:
    """Ids in ``now`` by the ids of ``before``, in which the previous part was planned.

    They are matched directly; objects that changed too much, via the scene in which that part ``ended``.
    """
    found = {old: new.id for old, new in correspond(before, now).items()}
    if ended is not None:
        midway, since = correspond(before, ended), correspond(ended, now)
        for obj in before.objects:
            then = midway.get(obj.id)
            later = since.get(then.id) if then is not None else None
            if obj.id not in found and later is not None and later.id not in found.values():
                found[obj.id] = later.id
    return found


def _translated(call: SkillCall, now: Mapping[str, str], scene: Scene) -> SkillCall:
    lost = next((name for name in (call.theme, call.goal) if name and name not in now), None)
    if lost is not None:
        label = next((o.label for o in scene.objects if o.id == lost), "")
        what = f"'{label}' ({lost})" if label else lost
        raise PerceptionError(f"{call} comes next, but {what} was not seen again after the previous motion.")
    return replace(call, theme=now.get(call.theme, ""), goal=now.get(call.goal, ""))


def last_look_stands(robot: RobotBackend, part: EpisodeRecord) -> bool:
    """Whether a part ended with a look for which the opened hand was out of the cameras' view: the next part needs no
    look of its own.
    """
    after = part.executed.after
    rest = robot.arm.forward(robot.arm.home)[:3, 3]
    away = float(np.linalg.norm(after.world_from_tcp[:3, 3] - rest))
    return part.after_scene is not None and away <= AT_HOME and after.gripper > 0.95


def cameras_moved(before: Observation, after: Observation) -> bool:
    """Whether a camera sits on the arm: its two pictures of the scene cannot be compared before the arm is back."""
    return any(
        float(np.linalg.norm(one.camera.position - other.camera.position)) > MOVED
        for one, other in zip(before.views, after.views, strict=False)
    )


def hand_is_free(report: ExecutionReport) -> bool:
    """Whether the motion left an empty hand that may move on by itself."""
    stopped = report.abort is not None and report.abort.abort in (*NO_MORE, "expired")
    return bool(report.waypoints) and not stopped and not report.waypoints[-1].held


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


def part_instruction(record: EpisodeRecord) -> str:
    """The instruction of this part alone, in the user's or gvla2's own words: "place the red cube in".

    A verifier must not judge a part by the whole sentence, and a perceived label must not reach it as if the user
    had used it: only label words that occur in the instruction are kept.
    """
    plan, scene = record.plan, record.scene
    if plan is None or scene is None:
        return record.instruction
    given = set(record.instruction.casefold().replace(",", " ").replace(".", " ").split())
    objects = {o.id: o for o in scene.objects}
    theme, goal = plan.roles.get("theme", plan.roles.get("part", "")), plan.roles.get("goal", "")
    calls = plan.calls or (SkillCall(plan.skill or "go on", theme, goal),)
    sentences = []
    for call in calls:
        what, where = (_known(objects.get(name), given) for name in (call.theme, call.goal))
        words = (call.skill, what, call.relation.replace("_", " "), where)
        sentences.append(" ".join(word for word in words if word))
    return "; ".join(sentences)


def _known(obj: SceneObject | None, given: set[str]) -> str:
    if obj is None:
        return ""
    words = [w for w in dict.fromkeys(f"{obj.colour} {obj.label}".casefold().split()) if w in given]
    return f"the {' '.join(words)}" if words else "it"


def _listed(calls: Sequence[SkillCall]) -> str:
    return ", ".join(map(str, calls))


def calls_left(record: EpisodeRecord) -> tuple[SkillCall, ...]:
    """The calls of a part that failed, from the one that it failed at, and those after it; none if that is unclear."""
    plan, report = record.planned.plan, record.report
    if len(plan.calls) > 1:
        stopped = report.abort if report is not None else None
        if stopped is None or plan.trajectory is None:
            return ()
        still = {waypoint.carries for waypoint in plan.trajectory.waypoints[stopped.index :]}
        first = next((k for k, call in enumerate(plan.calls) if call.theme in still), len(plan.calls))
        return (*plan.calls[first:], *plan.remaining) if first < len(plan.calls) else ()
    return (*plan.calls, *plan.remaining)


def should_try_again(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> bool:
    """Whether to try the same calls in another way: the hand surely missed its object, lost it, or did not put it where
    it belongs, and is empty now.

    That the fingers closed on nothing is sure by itself, unless the object fell where it was to be put; else the
    verifier must be sure.
    """
    plan, report = record.plan, record.report
    if record.failure is None or plan is None or plan.trajectory is None or report is None:
        return False
    if record.after_scene is None or plan.trajectory.grips()[0] is None or _relative(plan, skills):
        return False
    lost = report.abort is not None and report.abort.abort == "slipped" and not _at_its_place(record)
    sure = lost or (record.verdict is not None and record.verdict.outcome == "verified_fail")
    return sure and hand_is_free(report) and bool(calls_left(record))


def _at_its_place(record: EpisodeRecord) -> bool:
    """Whether a carried object is seen about where it was to be let go of."""
    done = record.executed
    _, opens = done.trajectory.grips()
    if opens is None or record.after_scene is None:
        return False
    wanted = done.trajectory.waypoints[opens]
    later = correspond(done.scene, record.after_scene).get(wanted.carries)
    if later is None:
        return False
    away = float(np.linalg.norm(later.centre[:2] - wanted.xyz[:2]))
    return away < 0.5 * float(later.extents[:2].max())


def least_seconds(record: EpisodeRecord) -> float:
    """Seconds that another try of a part that failed takes at least until it lets go, at that one's fastest pace."""
    done, report = record.executable, record.report
    assert report is not None
    planned = done.trajectory.seconds(record.seen.observation.world_from_tcp[:3, 3])
    paces = [
        each.motion_seconds / planned[each.index]
        for each in report.waypoints
        if not each.abort and planned[each.index] > SHORT
    ]
    _, opens = done.trajectory.grips()
    return min(paces, default=0.0) * float(planned[: None if opens is None else opens + 1].sum())


def second_try(record: EpisodeRecord) -> EpisodeRecord:
    """The record of another try at the part that failed; the parts before it stay."""
    failed = replace(record, attempts=(), parts=())
    stopped = record.report.abort if record.report is not None else None
    why = (
        stopped.message
        if stopped is not None
        else " ".join(record.verdict.reasons[:1] if record.verdict else ())
    )
    note = f"Tried again in another way, since attempt {len(record.attempts) + 1} failed: {why}"
    return record.afresh(attempts=(*record.attempts, failed), second_try=True, notes=(*record.notes, note))


def should_replan(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> bool:
    """Whether to replan: something was executed, surely failed, and the instruction still means the same.

    "10 cm to the left" refers to where an object stood: after a failed push or placement without a visible goal it
    means something else.
    """
    if record.verdict is None or record.verdict.outcome != "verified_fail" or record.plan is None:
        return False
    if record.report is None or not record.report.waypoints or record.after is None:
        return False
    if any(part.plan is not None and _relative(part.plan, skills) for part in record.whole):
        return False
    stopped = record.report.abort
    return stopped is None or stopped.abort not in NO_MORE


def _relative(plan: Plan, skills: Mapping[str, Skill]) -> bool:
    """Whether a plan is relative to where an object stood; a place on the table stays where it is."""
    if plan.calls:
        return any(call.direction is not None for call in plan.calls)
    skill = skills.get(plan.skill)
    return skill is not None and skill.aimed and "goal" not in plan.roles


def next_attempt(record: EpisodeRecord) -> EpisodeRecord:
    """The record of the next attempt, which holds the ones before; instruction and memory's answer stay."""
    before = replace(record, attempts=())
    return record.afresh(attempts=(*record.attempts, before), parts=())


def previous_attempt_stands(record: EpisodeRecord) -> EpisodeRecord:
    """The previous attempt, which counts when this one ended before anything moved; a note says why."""
    before, failure = record.attempts[-1], record.failure
    if record.second_try:
        before = replace(before, parts=record.parts)
    why = f"at '{failure.stage}' ({failure.kind}): {failure.message}" if failure else "without a plan."
    note = f"Attempt {len(record.attempts) + 1} ended before anything moved, {why}"
    spent = Counter(before.timings)
    spent.update(record.timings)
    return replace(before, attempts=record.attempts[:-1], timings=dict(spent), notes=(*before.notes, note))


def back_off(robot: RobotBackend, attempt: EpisodeRecord, listener: ExecutionListener) -> str:
    """Open the hand where the attempt left it, rise and go home, so that the cameras see the table.

    Returns "" or a sentence on what prevented it; the next attempt then starts from where the arm is.
    """
    scene, before = attempt.after_scene, attempt.seen.scene
    if scene is None or abs(scene.table_height - before.table_height) > TABLE_MOVED:
        scene = before  # a camera on the hand saw something else as the table
    way = _way_home(robot, attempt.executed.after.world_from_tcp[:3, 3], scene)
    stopped = robot.execute(way, scene, listener).abort
    if stopped is not None and stopped.stage == "back off":  # no straight way up: another may be found
        stopped = robot.execute(Trajectory(way.waypoints[-1:]), scene, listener).abort
    return f"The arm did not reach home before the next look: {stopped.message}" if stopped else ""


def _way_home(robot: RobotBackend, here: FloatArray, scene: Scene) -> Trajectory:
    """From the tool's position (3,), metres: open, straight up, home."""
    arm = robot.arm
    home = arm.forward(arm.home)
    up = np.array([here[0], here[1], min(here[2] + RISE, float(arm.workspace.high[2]))])
    near = frozenset({o.id for o in scene.objects} | {"table"})
    turned = Orientation("grasp", _tuple(home[:3, 2]), _tuple(home[:3, 1]))
    return Trajectory(
        (
            Waypoint(_tuple(here), 1.0, "let go", motion="linear", allowed_contacts=near),
            Waypoint(_tuple(up), 1.0, "back off", motion="linear", allowed_contacts=near),
            Waypoint(_tuple(home[:3, 3]), 1.0, "home", turned, tolerance=0.02),
        )
    )


def _tuple(point: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in point)
    return x, y, z
