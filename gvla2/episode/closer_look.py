"""A closer look: a camera on the arm is moved to a side of an object that no camera has seen."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from gvla2.episode.attempts import NO_MORE
from gvla2.episode.record import EpisodeRecord
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, invert_rigid, look_along
from gvla2.geometry.views import Observation, Views
from gvla2.planning.arm import Arm
from gvla2.planning.asking import look_again
from gvla2.planning.calls import SkillOptions
from gvla2.planning.contracts import LooksCloser
from gvla2.planning.findings import FREE_CLEARANCE
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener, RobotBackend

ON_THE_ARM = 0.3
"""Distance of a camera from the tool below which it is on the arm, metres."""
AWAY = 0.15
"""Metres between the camera and the object: nearer ones are out of focus, or have no depth."""
TURNS = np.radians(np.arange(-180, 180, 30))
RISES = np.radians([25.0, 40.0, 55.0])
"""Directions of a look: about the object, and above the level, the lowest first: they see most of a side."""
NEW, BEST = np.radians(30.0), np.radians(120.0)
"""Angles about the object between a look and the nearest camera that has seen it: the least, and the best one, since a
picture shows a third of what is around something."""
STEEP = 0.5
"""Cosine of the angle above the level from which a camera sees the top of objects: 60 degrees."""
HIDDEN = 0.005
"""A line of sight that is nearer to another object's box is blocked, metres."""


@dataclass(frozen=True)
class Look:
    """The motion that takes the camera on the arm to a place (3,) from which it sees an object."""

    object: SceneObject
    trajectory: Trajectory
    position: FloatArray


@dataclass(frozen=True)
class Eyes:
    """What a closer look needs: the perceiver, called ``who`` in messages, the robot whose arm has a camera,
    ``observe``, which gives the observation of a look by its number, and who hears of the motion.
    """

    perceiver: LooksCloser
    who: str
    robot: RobotBackend
    observe: Callable[[int], Observation]
    listener: ExecutionListener


def with_closer_looks(
    record: EpisodeRecord, eyes: Eyes, plan: Callable[[EpisodeRecord], EpisodeRecord]
) -> EpisodeRecord:
    """A planned record; while nothing seen is what was asked for, look closer at unnamed objects and ``plan`` again."""
    observation, looks = record.seen.observation, 0
    camera = camera_on_arm(observation)
    if camera is None:
        return record
    tcp_from_camera = invert_rigid(observation.world_from_tcp) @ camera.world_from_camera
    seen_from = [view.camera.position for view in observation.views]
    while record.failure is not None and record.failure.kind == "nothing_matches":
        scene, arm, began = record.seen.scene, eyes.robot.arm, time.perf_counter()
        wanted = eyes.perceiver.to_look_at(scene, looks)
        look = closer_look(wanted, scene, arm, record.seen.observation, tcp_from_camera, seen_from)
        if look is None:
            break
        observation.pictured()  # the finer pictures of this moment must be taken before the arm moves
        stopped = eyes.robot.execute(look.trajectory, scene, eyes.listener).abort
        looks += 1
        if stopped is not None:
            note = f"No closer look at {look.object.id}: {stopped.message or stopped.abort}"
            record = replace(record, notes=(*record.notes, note))
            if stopped.abort in (*NO_MORE, "expired"):
                break
            seen_from.append(look.position)
            continue
        now = eyes.observe(looks)
        nearer = next(view for view in now.views if view.name == camera.name)
        seen = look_again(eyes.perceiver, scene, replace(now, views=Views((nearer,))), eyes.who)
        seconds, names = time.perf_counter() - began, _newly_named(scene, seen) or "no name is seen"
        note = f"Looked closer at {look.object.id}, {look.object.label}, in {seconds:.1f} s: {names}."
        now = replace(now, views=observation.views, finer=observation.finer)
        record = replace(record, scene=seen, observation=now, notes=(*record.notes, note), failure=None)
        seen_from.append(nearer.camera.position)
        record = plan(record)
    return record


def _newly_named(before: Scene, now: Scene) -> str:
    """The names that objects have now and had not before, listed."""
    named = {o.id: o.label for o in before.objects}
    return ", ".join(f"{o.id} is {o.label}" for o in now.objects if named.get(o.id) != o.label)


def camera_on_arm(observation: Observation) -> Camera | None:
    """The camera nearest to the tool, if it is near enough to be on the arm."""

    def away(camera: Camera) -> float:
        return float(np.linalg.norm(camera.position - observation.world_from_tcp[:3, 3]))

    nearest = min((view.camera for view in observation.views), key=away)
    return nearest if away(nearest) < ON_THE_ARM else None


def closer_look(
    wanted: Sequence[SceneObject],
    scene: Scene,
    arm: Arm,
    observation: Observation,
    tcp_from_camera: FloatArray,
    seen_from: Sequence[FloatArray],
) -> Look | None:
    """The look in the arm's reach that shows most of what no camera at the places (3,) has seen; None without one.

    ``tcp_from_camera`` (4, 4) is the camera's place on the tool; the arm is as observed.
    """
    places = []
    for obj, turn, rise in product(wanted, TURNS, RISES):
        level = np.array([np.cos(turn), np.sin(turn), 0.0])
        nearest = max((_level_cosine(level, place - obj.centre) for place in seen_from), default=-1.0)
        if nearest < np.cos(NEW):
            places.append((abs(nearest - np.cos(BEST)), obj, np.cos(rise) * level + [0.0, 0.0, np.sin(rise)]))
    for _, obj, way in sorted(places, key=lambda each: each[0]):
        position = obj.centre + (0.5 * float(np.linalg.norm(obj.extents)) + AWAY) * way
        if not _hidden(obj, position, scene):
            pose = _reached(position, -way, scene, arm, observation, tcp_from_camera)
            if pose is not None:
                return Look(obj, _trajectory(pose, observation.gripper), position)
    return None


def _level_cosine(level: FloatArray, line: FloatArray) -> float:
    """Cosine of the angle, seen from above, between a level direction (3,) and a line of sight (3,) from an object.

    A camera steeply above has seen none of its sides: -1.
    """
    away = float(np.linalg.norm(line[:2]))
    return float(level @ line) / away if away > STEEP * float(np.linalg.norm(line)) else -1.0


def _hidden(obj: SceneObject, position: FloatArray, scene: Scene) -> bool:
    """Whether another object is in the line from a place (3,) to an object's middle."""
    line = np.linspace(position, obj.centre, 20)
    return any((o.distances(line) < HIDDEN).any() for o in scene.obstacles(frozenset({obj.id, obj.parent})))


def _reached(
    position: FloatArray,
    along: FloatArray,
    scene: Scene,
    arm: Arm,
    observation: Observation,
    tcp_from_camera: FloatArray,
) -> FloatArray | None:
    """The tool's pose (4, 4) with the camera at a place (3,), looking ``along`` (3,), of four turns about that line the
    one with the least motion of the joints; None where the arm cannot be, or not without touching something.
    """
    up = np.array([0.0, 0.0, 1.0])
    side = np.cross(along, up)
    reached = []
    for top in (up, side, -up, -side):
        pose = look_along(position, along, top) @ invert_rigid(tcp_from_camera)
        solution = arm.inverse(pose, near=observation.joints) if arm.workspace.contains(pose[:3, 3]) else None
        if solution is not None:
            clear = arm.clearance(solution.joints, observation.gripper, scene).distance
            if clear >= FREE_CLEARANCE:
                reached.append((float(np.abs(solution.joints - observation.joints).max()), pose))
    return min(reached, key=lambda each: each[0])[1] if reached else None


def _trajectory(pose: FloatArray, gripper: float) -> Trajectory:
    x, y, z = map(float, pose[:3, 3])
    (a, b, c), (d, e, f) = pose[:3, 2].tolist(), pose[:3, 1].tolist()
    turned = Orientation("grasp", (a, b, c), (d, e, f))
    speed = SkillOptions().speed
    return Trajectory((Waypoint((x, y, z), gripper, "look closer", turned, speed=speed, tolerance=0.02),))
