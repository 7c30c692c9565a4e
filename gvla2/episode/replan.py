"""Retrying within an episode: when, from where, and what happens to the previous attempt."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from gvla2.episode.record import EpisodeRecord
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Scene
from gvla2.planning.skill import Skill
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener, RobotBackend
from gvla2.skills.table import STANDARD

NO_MORE = ("not_started", "interrupted", "diverged")
"""Stops after which the robot must not move again by itself."""

RISE = 0.10
"""Metres that the opened hand rises straight up before it goes home, or up to the workspace's edge."""


def worth_another(record: EpisodeRecord, skills: Mapping[str, Skill] = STANDARD) -> bool:
    """Whether to replan: something was executed, surely failed, and the instruction still means the same.

    "10 cm to the left" refers to where an object stood: after a failed push or placement without a visible goal it
    means something else.
    """
    if record.verdict is None or record.verdict.outcome != "verified_fail" or record.plan is None:
        return False
    if record.report is None or not record.report.waypoints or record.after is None:
        return False
    stopped = record.report.abort
    return not _relative(record, skills) and (stopped is None or stopped.abort not in NO_MORE)


def _relative(record: EpisodeRecord, skills: Mapping[str, Skill]) -> bool:
    """Whether a part of the attempt is relative to where an object stood."""
    for part in record.whole:
        plan = part.plan
        if plan is None:
            continue
        skill = skills.get(plan.skill)
        if plan.calls:  # a place on the table stays where it is
            found = any(call.direction is not None for call in plan.calls)
        else:
            found = skill is not None and skill.aimed and "goal" not in plan.roles
        if found:
            return True
    return False


def next_attempt(record: EpisodeRecord) -> EpisodeRecord:
    """The record of the next attempt, which holds the ones before; instruction and memory's answer stay."""
    before = replace(record, attempts=())
    return record.afresh(attempts=(*record.attempts, before), parts=())


def came_to_nothing(record: EpisodeRecord) -> EpisodeRecord:
    """The previous attempt, which counts when this one ended before anything moved; a note says why."""
    before, failure = record.attempts[-1], record.failure
    why = f"at '{failure.stage}' ({failure.kind}): {failure.message}" if failure else "without a plan."
    note = f"Attempt {len(record.attempts) + 1} ended before anything moved, {why}"
    spent = Counter(before.timings)
    spent.update(record.timings)
    return replace(before, attempts=record.attempts[:-1], timings=dict(spent), notes=(*before.notes, note))


def back_off(robot: RobotBackend, attempt: EpisodeRecord, listener: ExecutionListener) -> str:
    """Open the hand where the attempt left it, rise and go home, so that the cameras see the table.

    Returns "" or a sentence on what prevented it; the next attempt then starts from where the arm is.
    """
    scene = attempt.after_scene or attempt.seen.scene
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
            Waypoint(_tuple(up), 1.0, "back off", motion="linear", speed=0.1, allowed_contacts=near),
            Waypoint(_tuple(home[:3, 3]), 1.0, "home", turned, tolerance=0.02),
        )
    )


def _tuple(point: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in point)
    return x, y, z
