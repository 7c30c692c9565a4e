"""The simulated world of one episode: table, arm, the task's bodies, and time."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Collection, Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import RobotError, SimulationError
from gvla2.geometry.transform import FloatArray
from gvla2.robot.task import Layout
from gvla2.robot.workcell import Workcell
from gvla2_plugins.sapien import SapienArmConfig
from gvla2_plugins.sapien.bodies import PREFIX, Caught, Screwed, build_bodies, import_sapien, pose_of

PATCH_RADIUS = 0.1
"""Of the fingers' contact patches, metres: gives a point contact the resistance to turning of a soft pad."""

GROUPS = 32
"""Bits with which the engine marks links whose contacts it ignores."""


def load_robot(scene: Any, cell: Workcell, friction: float) -> Any:
    """The cell's arm as an articulation in ``scene``, base fixed, fingers coupled and rough (``friction``)."""
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in cell.gripper.finger_links:
        loader.set_link_material(finger, friction, friction, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS)
        loader.set_link_min_patch_radius(finger, PATCH_RADIUS)
    with tempfile.TemporaryDirectory() as folder:
        bare = Path(folder) / "robot.urdf"
        bare.write_text(cell.urdf, "utf-8")
        robot = loader.load(str(bare))
    groups = ignoring_groups(cell.arm.collisions.overlapping)
    for link in robot.links:
        link.disable_gravity = True  # a real arm's controller compensates gravity too
        for shape in link.collision_shapes:
            first, second, ignored, last = shape.get_collision_groups()
            shape.set_collision_groups([first, second, ignored | groups.get(link.name, 0), last])
    return robot


def ignoring_groups(pairs: Collection[frozenset[str]]) -> dict[str, int]:
    """The bits of each link such that just the ``pairs`` share one: the engine ignores contacts between these.

    A bit serves a whole set of links that may all touch one another, since there are only 32. Raises
    :class:`RobotError` when they do not suffice.
    """
    left = {pair for pair in pairs if len(pair) == 2}
    links = sorted(set().union(*left))
    sets: list[set[str]] = []
    every = frozenset(left)
    while left:
        together = set(min(left, key=sorted))
        for link in links:
            if link not in together and all(frozenset((link, other)) in every for other in together):
                together.add(link)
        left -= {frozenset(pair) for pair in combinations(together, 2)}
        sets.append(together)
    if len(sets) > GROUPS:
        raise RobotError(
            f"{len(every)} pairs of the arm's links overlap, in more sets than the physics engine's {GROUPS}. Use a "
            "URDF with simpler collision shapes, or name the pairs that may touch in robot.srdf."
        )
    return {link: sum(1 << bit for bit, each in enumerate(sets) if link in each) for link in links}


SETTLE_STEPS, MOST_SETTLE_STEPS = 10, 480
REST_SPEED = 0.005
"""Bodies rest below this speed, m/s and (for a lever of 10 cm) 0.1 rad/s."""

IMPOSSIBLE_JOINT_SPEED, IMPOSSIBLE_SPEED = 50.0, 50.0
"""rad/s and m/s beyond which the simulation has blown up."""

FINGER_STIFFNESS, FINGER_DAMPING = 4000.0, 100.0
"""N/m and Ns/m: stiff enough for the full grip force at 1 cm from the target."""

FLOOR_DEPTH = 0.75
"""From the table's top down to the floor, metres: objects that leave the table must not fall forever."""

LET_GO = 1e-3
"""A new press of a button starts after it has come back to less than this, metres or radians."""
TOUCH = 1e-4
"""Impulse per step, newton seconds, above which nearness counts as contact."""
HOLDING_FORCE = 0.2
"""Least force of a pressing finger, newtons; a cube of 0.125 kg needs about 0.5 N from each to stay."""
RESTING_SPEED = 0.02
"""Metres per second below which a body lies still."""


class SapienWorld:
    """One episode, built anew, so that no earlier one, blown up or not, leaves traces.

    Implements :class:`gvla2.robot.task.WorldState`, the scene's true state, which is for the cameras' rays and the
    success check only.
    """

    def __init__(self, config: SapienArmConfig, cell: Workcell, layout: Layout) -> None:
        sapien = import_sapien()
        self.rate = config.physics_rate
        self.steps = 0
        self._system = sapien.physx.PhysxCpuSystem()
        self._scene = sapien.Scene([self._system])
        self._scene.timestep = 1.0 / self.rate
        table = self._scene.create_actor_builder()
        table.set_initial_pose(pose_of(cell.table.world_from_body))
        material = sapien.physx.PhysxMaterial(config.table_friction, config.table_friction, 0.0)
        half = [0.5 * side for side in cell.table.solids[0].size]
        table.add_box_collision(half_size=half, material=material)
        table.build_static(PREFIX + "table")
        top = cell.table.world_from_body[2, 3] + half[2]
        self._scene.add_ground(float(top - FLOOR_DEPTH), render=False, material=material)

        self._cell = cell
        self._robot = load_robot(self._scene, cell, config.finger_friction)
        self._robot.set_root_pose(pose_of(cell.world_from_base))
        self._links = {link.name: link for link in self._robot.links}
        joints = self._robot.active_joints
        order = {joint.name: i for i, joint in enumerate(joints)}
        self._arm = np.array([order[name] for name in cell.arm.kinematics.joint_names])
        fingers = cell.gripper.fingers
        self._fingers = np.array([order[finger.joint] for finger in fingers], dtype=np.intp)
        self._closed = np.array([finger.closed for finger in fingers])
        self._opening = np.array([finger.opened - finger.closed for finger in fingers])
        self._arm_joints = [joints[i] for i in self._arm]
        self._finger_joints = [joints[i] for i in self._fingers]
        for joint in self._arm_joints:
            joint.set_drive_property(config.arm_stiffness, config.arm_damping, config.arm_force)
        for joint in self._finger_joints:
            joint.set_drive_property(FINGER_STIFFNESS, FINGER_DAMPING, config.grip_force)
        self.finger_target = 0.0
        self.place_arm(cell.arm.home, cell.arm.hand.max_width)

        self._bodies = build_bodies(self._scene, layout)
        self._threads = {
            t.name: Screwed(self._scene, t, layout, self._bodies.entities) for t in layout.threads
        }
        by_name = {joint.name: joint for joint in layout.joints}
        self._catches = [Caught(c, by_name[c.joint], self._bodies.joints) for c in layout.catches]
        self._strokes = {glow.joint: False for glow in layout.glows if np.isfinite(glow.until)}
        self._to_hold = {glow.joint: glow for glow in layout.glows if glow.hold > 0.0}
        self._since = dict.fromkeys(self._to_hold, 0.0)
        components = (c for entity in self._bodies.entities.values() for c in entity.components)
        self._movers = [c for c in components if hasattr(c, "linear_velocity") and hasattr(c, "mass")]
        self.peaks: dict[str, float] = {}
        self._settle()

    def _settle(self) -> None:
        """Step until the bodies rest, at least ten times; raises :class:`SimulationError` when that goes wrong."""
        for count in range(MOST_SETTLE_STEPS):
            self._system.step()
            if count + 1 >= SETTLE_STEPS and self._speed() < REST_SPEED:
                break
        if not self.sane():
            raise SimulationError(
                "The simulation blew up while the scene settled: bodies of this layout overlap. "
                "Give their sampling more room."
            )
        self.peaks = {name: self.joint(name) for name in (*self._bodies.joints, *self._threads)}

    def _speed(self) -> float:
        """Largest speed of a task's body, m/s, turning taken at a lever of 5 cm."""
        return max((_speed_of(c) for c in self._movers), default=0.0)

    def step(self) -> None:
        """One step of physics."""
        self._system.step()
        self.steps += 1
        for name in self._bodies.joints:
            at = self._counts(name, self.joint(name))
            self.peaks[name] = max(self.peaks[name] if self._goes_on(name, at) else at, at)
        for catch in self._catches:
            catch.watch()
        for name, thread in self._threads.items():
            thread.watch()
            self.peaks[name] = thread.peak

    def _counts(self, name: str, at: float) -> float:
        """The travel that counts: for a joint to be held, at most the holding point until it was held long enough."""
        glow = self._to_hold.get(name)
        if glow is None:
            return at
        if at <= glow.travel:
            self._since[name] = self.time
        return at if self.time - self._since[name] >= glow.hold else min(at, glow.travel)

    def _goes_on(self, name: str, at: float) -> bool:
        """Whether a joint is still in the stroke whose largest travel counts: if pressing too far turns a lamp off
        again, each press counts separately.
        """
        if name not in self._strokes:
            return True
        before, self._strokes[name] = self._strokes[name], at > LET_GO
        return before or not self._strokes[name]

    def sane(self) -> bool:
        """Whether all positions and speeds are finite and physically possible."""
        speeds = self._robot.qvel
        robot = np.isfinite(self._robot.qpos).all() and (np.abs(speeds) < IMPOSSIBLE_JOINT_SPEED).all()
        poses = (entity.pose for entity in self._bodies.entities.values())
        bodies = all(math.isfinite(sum(pose.p.tolist()) + sum(pose.q.tolist())) for pose in poses)
        return bool(robot and bodies and self._speed() < IMPOSSIBLE_SPEED)

    @property
    def joints(self) -> FloatArray:
        """(dof,) the arm's joints, radians."""
        return np.asarray(self._robot.qpos[self._arm], dtype=np.float64)

    @property
    def time(self) -> float:
        """Simulated seconds since the scene had settled."""
        return self.steps / self.rate

    @property
    def joint_speeds(self) -> FloatArray:
        """(dof,) rad/s."""
        return np.asarray(self._robot.qvel[self._arm], dtype=np.float64)

    @property
    def gripper_width(self) -> float:
        """Between the fingers, metres."""
        travel = (self._robot.qpos[self._fingers] - self._closed) * np.sign(self._opening)
        return float(self._cell.gap + travel.sum())

    def place_arm(self, joints: FloatArray, width: float) -> None:
        """Put the arm at rest at joints (dof,) radians, its fingers ``width`` metres apart."""
        self.drive_arm(joints, np.zeros(len(joints)))
        self.drive_fingers(0.5 * width)
        all_joints = np.zeros(len(self._robot.active_joints), dtype=np.float32)
        all_joints[self._arm] = joints
        all_joints[self._fingers] = [np.ravel(joint.drive_target)[0] for joint in self._finger_joints]
        self._robot.set_qpos(all_joints)
        self._robot.set_qvel(np.zeros_like(all_joints))

    @property
    def arm_target(self) -> FloatArray:
        """(dof,) where the arm's joints are driven to, radians."""
        return np.array([float(np.ravel(joint.drive_target)[0]) for joint in self._arm_joints])

    def drive_arm(self, joints: FloatArray, speeds: FloatArray) -> None:
        """Set the arm's targets: joints (dof,) radians, speeds (dof,) rad/s."""
        for joint, target, speed in zip(self._arm_joints, joints.tolist(), speeds.tolist(), strict=True):
            joint.set_drive_target(target)
            joint.set_drive_velocity_target(speed)

    def drive_fingers(self, travel: float) -> None:
        """Set each finger's target: half of the width between them, metres."""
        self.finger_target = travel
        share = np.clip((2 * travel - self._cell.gap) / np.abs(self._opening).sum(), 0.0, 1.0)
        for joint, target in zip(self._finger_joints, self._closed + share * self._opening, strict=True):
            joint.set_drive_target(float(target))

    def link_poses(self, names: Sequence[str]) -> dict[str, FloatArray]:
        """world_from_link (4, 4) of the robot's links at its measured joints."""
        return {name: _matrix(self._links[name].entity.pose) for name in names}

    def touching_links(self) -> set[str]:
        """The robot's links that press on something else now; the base, which stands on the table, left out."""
        touched: set[str] = set()
        for one, other, contact in self._contacts():
            mine = {one, other} & self._links.keys()
            if len(mine) == 1 and not mine & touched and np.linalg.norm(_impulse(contact)) > TOUCH:
                touched |= mine
        return touched - self._cell.base_links

    def hand_force(self) -> FloatArray:
        """(3,) newtons, world: a wrist sensor's reading of everything that presses on or hangs from hand and fingers.

        It is taken from the hand's joint, since contact forces lack friction.
        """
        hand = self._links[self._cell.gripper.palm]
        forces = np.asarray(self._robot.get_link_incoming_joint_forces(), dtype=np.float64)  # (links, 6)
        return np.asarray(_matrix(hand.entity.pose)[:3, :3] @ forces[hand.index, :3])

    def finger_forces(self) -> dict[str, tuple[float, ...]]:
        """Force of the left and the right finger on each object that they press on, newtons, by SAPIEN's name."""
        forces: dict[str, FloatArray] = {}
        links = self._cell.gripper.finger_links
        for one, other, contact in self._contacts():
            for finger, obj in ((one, other), (other, one)):
                if finger in links and obj not in self._links:
                    by_finger = forces.setdefault(obj, np.zeros((2, 3)))
                    by_finger[links.index(finger)] += _impulse(contact) * self.rate
        return {obj: tuple(np.linalg.norm(f, axis=1).tolist()) for obj, f in forces.items()}

    def _contacts(self) -> Iterator[tuple[str, str, Any]]:
        """The names of two that are in contact, and the contact, whose :func:`_impulse` is costly to ask for."""
        for contact in self._system.get_contacts():
            one, other = contact.bodies
            yield one.entity.name, other.entity.name, contact

    def pose(self, body: str) -> FloatArray:
        """world_from_body (4, 4) of a task's body."""
        return _matrix(self._bodies.entities[body].pose)

    def joint(self, name: str) -> float:
        """Travel of a joint or turn of a thread now, radians or metres."""
        if name in self._threads:
            return self._threads[name].angle
        articulation, index = self._bodies.joints[name]
        return float(articulation.qpos[index])

    def peak(self, name: str) -> float:
        """Largest travel of a joint, or turn of a thread either way, since the reset."""
        return self.peaks[name]

    def loose(self, thread: str) -> bool:
        """Whether a thread has been turned until it holds no more."""
        return self._threads[thread].loose

    def held(self, body: str) -> bool:
        """Whether both fingers press on the body now."""
        return min(self.finger_forces().get(PREFIX + body, (0.0, 0.0))) > HOLDING_FORCE

    def touching(self, body: str) -> frozenset[str]:
        """Names of what presses on a task's body now: other bodies, "table", "robot"."""
        found = set()
        for one, other, contact in self._contacts():
            if PREFIX + body in (one, other) and np.linalg.norm(_impulse(contact)) > TOUCH:
                obj = other if one == PREFIX + body else one
                found.add("robot" if obj in self._links else obj.removeprefix(PREFIX))
        return frozenset(found)

    def resting(self, body: str) -> bool:
        """Whether the body lies still now and the robot does not touch it."""
        entity = self._bodies.entities[body]
        speed = max((_speed_of(c) for c in self._movers if c.entity == entity), default=0.0)
        return speed < RESTING_SPEED and "robot" not in self.touching(body)


def _impulse(contact: Any) -> FloatArray:
    """(3,) newton seconds, of all points of a contact."""
    return np.asarray(np.sum([point.impulse for point in contact.points], axis=0, dtype=np.float64))


def _speed_of(component: Any) -> float:
    linear, angular = component.linear_velocity.tolist(), component.angular_velocity.tolist()
    return max(math.hypot(*linear), 0.05 * math.hypot(*angular))


def _matrix(pose: Any) -> FloatArray:
    return np.asarray(pose.to_transformation_matrix(), dtype=np.float64)
