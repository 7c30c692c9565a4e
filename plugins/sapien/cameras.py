"""RGB-D cameras: where they are, and the robot's own silhouette in them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, RayImage, Surface
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View
from gvla2.robot.backend import ExecutionListener, Moment
from gvla2.robot.looks import OWN_DEPTH, RobotLooks


class CameraRig:
    """Sees one scene: the robot's links by their model, everything else at its true pose.

    The two are cast separately and merged by depth: this gives the robot's own depth image, explained by its measured
    joints, for free.
    """

    def __init__(self, robot: RobotLooks, objects: Mapping[str, Surface]) -> None:
        self._robot = robot
        self._names = list(objects)
        self._objects = RayCaster(list(objects.values()))

    def look(
        self,
        cameras: Sequence[Camera],
        world_from_link: Mapping[str, FloatArray],
        world_from_object: Mapping[str, FloatArray],
    ) -> list[View]:
        """One view per camera; poses (4, 4) by link name and by the name of each object."""
        robot = self._robot.cast(cameras, world_from_link)
        objects = self._objects.cast(cameras, {i: world_from_object[n] for i, n in enumerate(self._names)})
        return [_merge(*images) for images in zip(cameras, robot, objects, strict=True)]


def _merge(camera: Camera, robot: RayImage, objects: RayImage) -> View:
    nearer = np.isfinite(robot.depth) & ~(objects.depth < robot.depth)
    depth = np.where(nearer, robot.depth, objects.depth)
    with np.errstate(invalid="ignore"):
        mask = np.abs(depth - robot.depth) <= OWN_DEPTH
    return View(camera, np.where(nearer[..., None], robot.image, objects.image), depth, robot_mask=mask)


class Filming:
    """Draws frames in another thread while the robot moves; the listener gets them in order, in the caller's thread."""

    def __init__(self, listener: ExecutionListener) -> None:
        self._listener = listener
        self._studio = ThreadPoolExecutor(1, "film")
        self._awaited: deque[Future[list[View]]] = deque()

    def shoot(self, moment: Moment, sight: Callable[[], list[View]]) -> None:
        """Report the moment, and have its frame drawn if frames are wanted; those that are ready go to the listener."""
        self._listener.moment(moment)
        if not self._listener.wants_frames:
            return
        self._awaited.append(self._studio.submit(sight))
        while self._awaited and self._awaited[0].done():
            self._deliver()

    def __enter__(self) -> Filming:
        return self

    def __exit__(self, *_: object) -> None:
        with self._studio:
            while self._awaited:
                self._deliver()

    def _deliver(self) -> None:
        self._listener.frame(self._awaited.popleft().result()[0].image)
