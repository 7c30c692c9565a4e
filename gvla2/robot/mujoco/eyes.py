"""RGB-D pictures of a MuJoCo model by its own cameras, drawn offscreen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import rigid
from gvla2.geometry.views import View

FARTHEST = 5.0
"""Depth beyond this counts as not measured, metres, as with depth cameras."""

_GL = "apt install libegl1 libgl1-mesa-dri (MUJOCO_GL=egl), or apt install libosmesa6 (MUJOCO_GL=osmesa)"


def import_mujoco() -> Any:
    """MuJoCo, drawing offscreen where there is no display.

    Raises :class:`MissingDependencyError` without the package or without the library that draws, and
    :class:`ConfigurationError` for a version that is too new.
    """
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise MissingDependencyError("an offscreen OpenGL", "MuJoCo's cameras", _GL) from error
        raise MissingDependencyError("mujoco", "A MuJoCo world", 'pip install "gvla2[mujoco]"') from error
    except (
        ImportError,
        AttributeError,
        OSError,
    ) as error:  # what PyOpenGL raises without the system's library
        raise MissingDependencyError("an offscreen OpenGL", "MuJoCo's cameras", _GL) from error
    if int(mujoco.__version__.partition(".")[0]) >= 4:
        raise ConfigurationError(
            f'MuJoCo {mujoco.__version__} is installed and the worlds need one below 4: pip install "mujoco<4"'
        )
    return mujoco


class ModelEyes:
    """Draws one model with its present ``data``; ``groups`` are the groups of geoms that are drawn.

    Raises :class:`ConfigurationError` for a camera that the model lacks.
    """

    def __init__(self, model: Any, data: Any, cameras: Sequence[str], groups: Sequence[int]) -> None:
        self._mujoco = mujoco = import_mujoco()
        there = [model.camera(i).name for i in range(model.ncam)]
        unknown = [name for name in cameras if name not in there]
        if unknown or not cameras or len(set(cameras)) != len(cameras):
            raise ConfigurationError(
                f"robot.cameras={list(cameras)} must be one or more different names out of {', '.join(there)}."
            )
        self.model, self.data, self.cameras = model, data, tuple(cameras)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [group in groups for group in range(len(self._option.geomgroup))]
        self._option.sitegroup[:] = 0
        self._renderers: dict[int, Any] = {}  # by the side of their pictures

    def camera(self, name: str, size: int) -> Camera:
        """The camera as it is now, with square images of ``size`` pixels."""
        index = self.model.camera(name).id
        turn = self.data.cam_xmat[index].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])  # MuJoCo's looks along -z
        u, _, v = np.linalg.svd(turn)
        fov = float(np.deg2rad(self.model.cam_fovy[index]))
        return Camera.from_fov(fov, rigid(u @ v, self.data.cam_xpos[index]), size, size, name)

    def view(self, name: str, size: int) -> View:
        """The picture with depth, metres, NaN beyond 5 m; the robot is not marked."""
        image, renderer = self.picture(name, size), self._renderer(size)
        renderer.enable_depth_rendering()
        depth = renderer.render()
        renderer.disable_depth_rendering()
        measured = np.where(depth < FARTHEST, depth, np.float32(np.nan))
        return View(self.camera(name, size), image, measured)

    def picture(self, name: str, size: int, shadows: bool = True) -> NDArray[np.uint8]:
        """(H, W, 3) what the camera sees; ``shadows`` cost most of the time."""
        renderer, flags = self._renderer(size), self._mujoco.mjtRndFlag
        renderer.update_scene(self.data, name, self._option)
        for flag in (flags.mjRND_SHADOW, flags.mjRND_REFLECTION):
            renderer.scene.flags[flag] = shadows
        return np.asarray(renderer.render())

    def _renderer(self, size: int) -> Any:
        if size not in self._renderers:
            buffer = self.model.vis.global_
            buffer.offwidth, buffer.offheight = max(buffer.offwidth, size), max(buffer.offheight, size)
            try:
                self._renderers[size] = self._mujoco.Renderer(self.model, size, size)
            except Exception as error:  # each of EGL, OSMesa and GLFW raises its own
                what = f"an offscreen OpenGL ({error})"
                raise MissingDependencyError(what, "MuJoCo's cameras", _GL) from error
        return self._renderers[size]

    def close(self) -> None:
        """Release the framebuffers."""
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers = {}
