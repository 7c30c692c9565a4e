"""RGB-D cameras: where they are, and the robot's own silhouette in them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, RayImage, Surface
from gvla2.geometry.transform import FloatArray, look_along
from gvla2.geometry.views import View
from gvla2.robot.backend import ExecutionListener, Moment

EXPLAINED = 0.010
"""Depth counts as the robot's own within this distance of its model, metres."""

_WRIST = "wrist"
_FOV, _WRIST_FOV = np.deg2rad(40.0), np.deg2rad(60.0)


@dataclass(frozen=True)
class Mounts:
    """Where a cell's cameras are.

    ``fixed``: position and viewing direction in the world, metres, by name. ``tcp_from_wrist`` (4, 4) is the
    camera ``wrist`` on the hand.
    """

    fixed: Mapping[str, tuple[tuple[float, float, float], tuple[float, float, float]]]
    tcp_from_wrist: FloatArray

    @property
    def names(self) -> tuple[str, ...]:
        """All cameras there are."""
        return (*self.fixed, _WRIST)

    def check(self, names: Sequence[str]) -> None:
        """Raises :class:`ConfigurationError` for an unknown camera, one named twice, or none at all."""
        unknown = [name for name in names if name not in self.names]
        if unknown or not names or len(set(names)) != len(names):
            raise ConfigurationError(
                f"robot.cameras={list(names)} must be one or more different names out of {', '.join(self.names)}."
            )

    def camera(self, name: str, size: int, world_from_tcp: FloatArray) -> Camera:
        """The camera of that name with square images of ``size`` pixels; the wrist's moves with the tool."""
        if name == _WRIST:
            return Camera.from_fov(float(_WRIST_FOV), world_from_tcp @ self.tcp_from_wrist, size, size, name)
        position, forward = self.fixed[name]
        return Camera.from_fov(float(_FOV), look_along(position, forward), size, size, name)


class CameraRig:
    """Sees one scene: the robot's links by their model, everything else at its true pose.

    The two are cast separately and merged by depth: this gives the robot's own depth image, explained by its measured
    joints, for free.
    """

    def __init__(self, robot: RayCaster, links: Sequence[str], things: Mapping[str, Surface]) -> None:
        self._robot, self._links = robot, links
        self._names = list(things)
        self._things = RayCaster(list(things.values()))

    def look(
        self,
        cameras: Sequence[Camera],
        world_from_link: Mapping[str, FloatArray],
        world_from_thing: Mapping[str, FloatArray],
    ) -> list[View]:
        """One view per camera; poses (4, 4) by link name and by the name of each thing."""
        robot = self._robot.cast(cameras, {i: world_from_link[n] for i, n in enumerate(self._links)})
        things = self._things.cast(cameras, {i: world_from_thing[n] for i, n in enumerate(self._names)})
        return [_merge(*images) for images in zip(cameras, robot, things, strict=True)]


def _merge(camera: Camera, robot: RayImage, things: RayImage) -> View:
    nearer = np.isfinite(robot.depth) & ~(things.depth < robot.depth)
    depth = np.where(nearer, robot.depth, things.depth)
    with np.errstate(invalid="ignore"):
        mask = np.abs(depth - robot.depth) <= EXPLAINED
    return View(camera, np.where(nearer[..., None], robot.image, things.image), depth, robot_mask=mask)


class Filming:
    """Draws frames beside the moving robot, on another core, and tells the listener of them in order, in our thread."""

    def __init__(self, listener: ExecutionListener) -> None:
        self._listener = listener
        self._studio = ThreadPoolExecutor(1, "film")
        self._awaited: deque[Future[list[View]]] = deque()

    def shoot(self, moment: Moment, sight: Callable[[], list[View]]) -> None:
        """Tell of the moment, and have its frame drawn if it is wanted; those that are ready go to the listener."""
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
