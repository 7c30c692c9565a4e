"""The waypoint loop: plan, move, grip, check the measurements, report; any arm through its driver."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray, invert_rigid
from gvla2.planning.arm import Attachment
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Guard, Trajectory, Waypoint
from gvla2.robot.arm_from_urdf import ArmModel
from gvla2.robot.backend import ExecutionListener
from gvla2.robot.driver import Driver, DriverState, MoveResult
from gvla2.robot.motion import MotionFailure, plan_motion
from gvla2.robot.report import AbortCode, ExecutionReport, WaypointReport
from gvla2.robot.timing import MotionLimits, time_path


@dataclass(frozen=True)
class ExecutorOptions:
    """How an arm is driven.

    ``dt`` seconds between joint samples; ``velocity_scale`` of the URDF's joint speeds; ``acceleration`` rad/s² of
    every joint; one motion may take ``max_motion_seconds``.
    """

    dt: float = 1.0 / 60.0
    velocity_scale: float = 0.7
    acceleration: float = 5.0
    max_motion_seconds: float = 60.0


CLOSING_SECONDS = 0.5
"""A motion that takes longer leaves the fingers time to close on the way."""
TRACKING_FACTOR = 3.0
"""A position error above this many times a waypoint's tolerance stops the motion."""

EMPTY_WIDTH = 0.0015
"""Fingers nearer than this hold nothing, metres."""


def execute(
    trajectory: Trajectory,
    scene: Scene,
    arm: ArmModel,
    driver: Driver,
    listener: ExecutionListener | None = None,
    options: ExecutorOptions = ExecutorOptions(),
) -> ExecutionReport:
    """Move through the waypoints; stops at the first that fails, with the reason in its report.

    Orientations are resolved from the measured tool pose. A waypoint is planned from the measured joints around
    ``scene``; objects that a waypoint ``carries`` move with the hand from where the fingers closed, and stay where they
    are released. A motion that its guard ends is complete: the arm holds, and the next one starts from there. Each
    report goes to ``listener.waypoint`` as it is made.

    A keyboard interrupt, or an exception of the driver or the listener, makes the driver hold the arm; the present
    waypoint is reported as ``interrupted`` and the exception passed on.
    """
    return _Run(trajectory, scene, arm, driver, listener or ExecutionListener(), options).through()


class _Abort(Exception):  # noqa: N818 - it ends the loop and becomes a report
    def __init__(self, code: AbortCode, message: str) -> None:
        super().__init__(message)
        self.code = code


@dataclass
class _Run:
    """One execution: what was measured, what is carried, what was reported."""

    trajectory: Trajectory
    given: Scene
    arm: ArmModel
    driver: Driver
    listener: ExecutionListener
    options: ExecutorOptions
    reports: list[WaypointReport] = field(default_factory=list)
    joint_path: list[tuple[float, ...]] = field(default_factory=list)
    poses: list[FloatArray] = field(default_factory=list)
    holds: bool | None = False
    opening: float = 1.0  # commanded, in [0, 1]
    # Tool pose at which the fingers last closed.
    closed_at: FloatArray = field(default_factory=lambda: np.eye(4))
    began: float | None = None  # the robot's clock when it set out for this waypoint

    def __post_init__(self) -> None:
        self.world = CarriedScene(self.given)
        self.last = DriverState(self.arm.home, 0.0)  # the last plausible measurement
        self.now = _begun(0, next(iter(self.trajectory), Waypoint((0.0, 0.0, 0.0), 0.0, "")))

    def through(self) -> ExecutionReport:
        """All waypoints, to the end or the first abort."""
        try:
            state = self._measure()
            self.opening, self.closed_at = self._fraction(state), self.arm.forward(state.joints)
            try:
                self.poses = check_trajectory(self.trajectory, self.given, self.closed_at)
            except RobotError as error:
                raise _Abort("not_started", str(error)) from error
            for index, waypoint in enumerate(self.trajectory):
                self.now, self.began = _begun(index, waypoint), None
                self._carry_out(waypoint)
                self._report()
        except _Abort as abort:
            if abort.code != "not_started":
                self.driver.hold()
            self._report(abort.code, str(abort))
        except BaseException as error:
            self._interrupted(error)
            raise
        spent = sum(r.planning_seconds + r.motion_seconds for r in self.reports)
        return ExecutionReport(tuple(self.reports), spent, tuple(self.joint_path))

    def _carry_out(self, waypoint: Waypoint) -> None:
        options, pose = self.options, self.poses[self.now.index]
        state = self._measure()
        if waypoint.carries:
            self.world.carry(waypoint.carries, self.closed_at)
        else:
            self.world.release(self.arm.forward(state.joints))

        samples = self._plan(waypoint, state, pose)
        busy = waypoint.carries or waypoint.allowed_contacts or self.holds
        if waypoint.gripper < self.opening and not busy and (len(samples) - 1) * options.dt > CLOSING_SECONDS:
            self.opening = waypoint.gripper  # an empty hand in the open closes on its way
        self.joint_path += [tuple(row) for row in samples[:: max(1, round(0.05 / options.dt))].tolist()]
        dwell = math.ceil(waypoint.dwell / options.dt)
        self._know(motion_seconds=(len(samples) - 1 + dwell) * options.dt)
        self.began = self._measure().time
        stopped = self._follow(waypoint, samples)
        state = self._measure()
        if dwell:  # the arm stays where it got to
            still = np.tile(state.joints if stopped else samples[-1], (dwell + 1, 1))
            self._moved(self.driver.follow(still, options.dt, self.opening))
            state = self._measure()
        if waypoint.carries and state.gripper_width < EMPTY_WIDTH:
            self.holds = False
            raise _Abort("slipped", f"'{waypoint.carries}' was lost on the way: the fingers are closed.")
        error = float(np.linalg.norm(self.arm.forward(state.joints)[:3, 3] - pose[:3, 3]))
        if not stopped and error > TRACKING_FACTOR * waypoint.tolerance:
            raise _Abort("tracking", f"The tool stopped {1e3 * error:.0f} mm from its target.")
        if abs(waypoint.gripper - self.opening) > 1e-3:
            self._grip(waypoint)

    def _follow(self, waypoint: Waypoint, samples: FloatArray) -> bool:
        """Move, and hold where the waypoint's guard ends the motion: then True."""
        watch = None if waypoint.guard is None else GuardWatch(waypoint.guard, self.arm)
        moved = self.driver.follow(samples, self.options.dt, self.opening, watch)
        if watch is not None:
            self._know(force=watch.force)
            if moved.stopped:
                self.driver.hold()
                self._know(status="guarded", message=watch.reason)
        self._moved(moved)
        return moved.stopped

    def _moved(self, moved: MoveResult) -> None:
        self._touched(moved.contacts)
        if moved.diverged:
            raise _Abort("diverged", "The driver measured something impossible and aborted the motion.")
        if moved.expired:
            raise _Abort("expired", moved.expired)

    def _plan(self, waypoint: Waypoint, state: DriverState, pose: FloatArray) -> FloatArray:
        """Joint samples (T, dof) to the waypoint, checked."""
        options, index, arm = self.options, self.now.index, self.arm
        began = time.perf_counter()
        path = plan_motion(
            arm,
            state.joints,
            pose,
            self.world.scene,
            motion=waypoint.motion,
            gripper=self._fraction(state),
            attached=self.world.attached,
            allowed_contacts=waypoint.allowed_contacts,
            then=self.trajectory.straight_after(index, self.poses),
            seed=index,
        )
        self._know(planning_seconds=time.perf_counter() - began, status=getattr(path, "status", "failed"))
        if isinstance(path, MotionFailure):
            raise _Abort(path.code, path.message)
        acceleration = np.full(arm.dof, options.acceleration)
        limits = MotionLimits(options.velocity_scale * arm.velocity_limits, acceleration, waypoint.speed)
        try:
            samples = time_path(path.joints, options.dt, limits, arm.tool_positions)
            check_samples(samples, options.dt, state.joints, arm.limits, arm.velocity_limits)
        except RobotError as error:
            raise _Abort("diverged", str(error)) from error
        if (len(samples) - 1) * options.dt + waypoint.dwell > options.max_motion_seconds:
            raise _Abort("timeout", f"The motion would take over {options.max_motion_seconds:.0f} s.")
        return samples

    def _grip(self, waypoint: Waypoint) -> None:
        """Open or close as the waypoint says; closing on nothing before carrying something is a slip."""
        closing = waypoint.gripper < self.opening
        result = self.driver.grip(waypoint.gripper)
        self.opening = waypoint.gripper
        self._touched(result.contacts)
        self.holds = result.held if closing else False
        state = self._measure()
        if closing:
            self.closed_at = self.arm.forward(state.joints)
            following = self.trajectory.waypoints[self.now.index + 1 : self.now.index + 2]
            if any(w.carries for w in following) and state.gripper_width < EMPTY_WIDTH:
                self.holds = False
                raise _Abort("slipped", "The fingers closed on nothing.")

    def _fraction(self, state: DriverState) -> float:
        return float(np.clip(state.gripper_width / self.arm.hand.max_width, 0.0, 1.0))

    def _measure(self) -> DriverState:
        state = self.driver.state()
        if not np.isfinite(state.joints).all() or not np.isfinite(state.gripper_width):
            raise _Abort("diverged", "The measured joints are not finite.")
        self.last = state
        return state

    def _know(self, **facts: Any) -> None:
        """Fields of the present waypoint's report."""
        self.now = replace(self.now, **facts)

    def _touched(self, links: Iterable[str]) -> None:
        self._know(contacts=tuple(dict.fromkeys((*self.now.contacts, *links))))

    def _report(self, abort: AbortCode = "", message: str = "") -> None:
        x, y, z = self.arm.forward(self.last.joints)[:3, 3].tolist()
        if self.began is not None and self.last.time is not None and self.last.time > self.began:
            self._know(motion_seconds=self.last.time - self.began)
        self._know(
            reached=(x, y, z),
            error=math.dist((x, y, z), self.now.target),
            gripper_width=self.last.gripper_width,
            held=self.holds,
            abort=abort,
            message=message or self.now.message,
        )
        self.reports.append(self.now)
        self.listener.waypoint(self.now)

    def _interrupted(self, error: BaseException) -> None:
        """First bring the arm to rest, then report how far it got."""
        self.driver.hold()
        if any(report.index == self.now.index for report in self.reports):
            return  # the listener raised at this waypoint: it already has the report
        with contextlib.suppress(_Abort):
            self._measure()
        self._report("interrupted", f"{type(error).__name__}: {error}".rstrip(": "))


def _begun(index: int, waypoint: Waypoint) -> WaypointReport:
    """The report of a waypoint before anything is known about its motion."""
    x, y, z = map(float, waypoint.xyz)
    return WaypointReport(index, waypoint.stage, (x, y, z), (x, y, z), 0.0, 0.0, None)


class CarriedScene:
    """A scene in which at most one object is attached to the hand; objects whose ``parent`` it is move with it.

    ``scene`` is the hand's surroundings; ``attached`` is the carried object, or None.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.attached: Attachment | None = None
        self._taken: tuple[SceneObject, ...] = ()
        self._grasped_at = np.eye(4)

    def carry(self, object_id: str, world_from_tcp: FloatArray) -> None:
        """Attach the object to the hand at the tool pose (4, 4) at which the fingers closed."""
        if self.attached is not None and self.attached.object.id == object_id:
            return
        self.release(world_from_tcp)
        obj, self._grasped_at = self.scene[object_id], world_from_tcp
        self._taken = tuple(o for o in self.scene.objects if object_id in (o.id, o.parent))
        left = tuple(o for o in self.scene.objects if object_id not in (o.id, o.parent))
        self.scene = replace(self.scene, objects=left)
        self.attached = Attachment(obj, invert_rigid(world_from_tcp) @ obj.world_from_object)

    def release(self, world_from_tcp: FloatArray) -> None:
        """Release the carried object where the tool pose (4, 4) leaves it."""
        moved = world_from_tcp @ invert_rigid(self._grasped_at)
        left = tuple(obj.moved(moved) for obj in self._taken)
        if left:
            self.scene = replace(self.scene, objects=(*self.scene.objects, *left))
        self.attached, self._taken = None, ()


class GuardWatch:
    """Watches one motion for a :class:`Guard`; implements :data:`gvla2.robot.driver.StopRule`.

    ``force`` is the largest so far, newtons, None before a measurement. ``reason`` says what ended the motion, ""
    before that.
    """

    def __init__(self, guard: Guard, arm: ArmModel) -> None:
        self.force: float | None = None
        self.reason = ""
        self._guard, self._arm = guard, arm

    def __call__(self, commanded: FloatArray, measured: FloatArray, force: FloatArray | None) -> bool:
        """Whether to end the motion now; joints (dof,), radians, force (3,), newtons."""
        guard = self._guard
        if force is not None:
            felt = float(np.linalg.norm(force))
            self.force = max(felt, self.force or 0.0)
            if 0.0 < guard.force < felt:
                self.reason = f"Stopped on contact: {felt:.1f} N, guarded at {guard.force:g} N."
        if guard.stall > 0.0:
            aimed, reached = self._arm.tool_positions(np.stack([commanded, measured]))
            lag, most = 1e3 * float(np.linalg.norm(aimed - reached)), 1e3 * guard.stall
            if lag > most:
                self.reason = f"Stopped where the tool was held back by {lag:.1f} mm, guarded at {most:g} mm."
        return bool(self.reason)


def check_trajectory(trajectory: Trajectory, scene: Scene, start: FloatArray) -> list[FloatArray]:
    """World tool poses (4, 4) of all waypoints, from the tool's pose ``start`` (4, 4), after checking the waypoints.

    Raises :class:`RobotError`, naming the first waypoint that can't be executed, and why.
    """
    if not trajectory.waypoints:
        raise RobotError("The trajectory has no waypoints.")
    known = {obj.id for obj in scene.objects}
    for index, waypoint in enumerate(trajectory):
        faults = [message for _, message in waypoint.faults()]
        if not 0.0 <= waypoint.gripper <= 1.0:
            faults.append(f"its gripper opening {waypoint.gripper} is outside [0, 1].")
        if waypoint.carries and waypoint.carries not in known:
            faults.append(f"it carries '{waypoint.carries}', which is not in the scene.")
        if faults:
            raise RobotError(f"Waypoint {index} ('{waypoint.stage}'): {faults[0]}")
    return trajectory.poses(start)


START_GAP = 0.05
"""How far a motion may start from the measured joints, radians."""


def check_samples(
    samples: FloatArray,
    dt: float,
    measured: FloatArray,
    limits: tuple[FloatArray, FloatArray],
    velocity: FloatArray,
) -> None:
    """Raise :class:`RobotError` unless joint samples (T, dof), one every ``dt`` seconds, may be sent.

    They must be finite, inside ``limits`` (dof,), start where the ``measured`` joints (dof,) are, and never move faster
    than ``velocity`` (dof,) rad/s.
    """
    low, high = limits
    if samples.ndim != 2 or samples.shape[1] != len(measured) or not len(samples):
        raise RobotError(f"Joint samples must be (T, {len(measured)}), got {samples.shape}.")
    rules = {
        "would get a target that is not finite": ~np.isfinite(samples + measured),
        "would leave its limits": (samples < low - 1e-6) | (samples > high + 1e-6),
        f"starts over {START_GAP} rad from where it is": np.abs(samples[:1] - measured) > START_GAP,
        "would jump beyond its speed limit": np.abs(np.diff(samples, axis=0)) > 1.05 * velocity * dt,
    }
    for what, wrong in rules.items():
        if wrong.any():
            raise RobotError(f"Joint {int(wrong.any(axis=0).argmax()) + 1} {what}. Nothing was sent.")
