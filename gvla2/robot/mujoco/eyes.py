"""RGB-D pictures of a MuJoCo model by its own cameras, drawn offscreen."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import View

LARGEST = 640
"""Least side of the framebuffer, pixels: pictures for people are as large."""

FARTHEST = 5.0
"""Depth beyond this counts as not measured, metres, as with depth cameras."""

MAX_GEOMS = 10_000
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
        buffer = model.vis.global_
        buffer.offwidth, buffer.offheight = max(buffer.offwidth, LARGEST), max(buffer.offheight, LARGEST)
        try:
            self._gl = mujoco.GLContext(buffer.offwidth, buffer.offheight)
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        except Exception as error:  # each of EGL, OSMesa and GLFW raises its own
            raise MissingDependencyError(f"an offscreen OpenGL ({error})", "MuJoCo's cameras", _GL) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(model, maxgeom=MAX_GEOMS)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [group in groups for group in range(len(self._option.geomgroup))]
        self._option.sitegroup[:] = 0

    def camera(self, name: str, size: int) -> Camera:
        """The camera as it is now, with square images of ``size`` pixels."""
        index = self.model.camera(name).id
        turn = self.data.cam_xmat[index].reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])  # MuJoCo's looks along -z
        u, _, v = np.linalg.svd(turn)
        fov = float(np.deg2rad(self.model.cam_fovy[index]))
        return Camera.from_fov(fov, rigid(u @ v, self.data.cam_xpos[index]), size, size, name)

    def view(self, name: str, size: int) -> View:
        """The picture with depth, metres, NaN beyond 5 m; the robot is not marked."""
        image = self.picture(name, size)
        flags = self._scene.flags
        before = flags.copy()
        # Without lights and smoothed edges a pixel's depth is that of one surface.
        flags[self._mujoco.mjtRndFlag.mjRND_SEGMENT] = flags[self._mujoco.mjtRndFlag.mjRND_IDCOLOR] = True
        raw = np.empty((size, size), dtype=np.float32)
        self._draw(size, None, raw)
        np.copyto(flags, before)
        return View(self.camera(name, size), image, self._metres(raw))

    def picture(self, name: str, size: int, shadows: bool = True) -> NDArray[np.uint8]:
        """(H, W, 3) what the camera sees; ``shadows`` cost most of the time."""
        self._gl.make_current()
        mujoco = self._mujoco
        camera = mujoco.MjvCamera()
        camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, self.model.camera(name).id
        everything = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self.model, self.data, self._option, None, camera, everything, self._scene)
        image = np.empty((size, size, 3), dtype=np.uint8)
        for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
            self._scene.flags[flag] = shadows
        self._draw(size, image, None)
        return np.flipud(image)

    def _draw(self, size: int, image: NDArray[np.uint8] | None, depth: NDArray[np.float32] | None) -> None:
        window = self._mujoco.MjrRect(0, 0, size, size)
        self._mujoco.mjr_render(window, self._scene, self._context)
        self._mujoco.mjr_readPixels(image, depth, window, self._context)

    def _metres(self, raw: NDArray[np.float32]) -> NDArray[np.float32]:
        """Depth (H, W) along the camera's z, metres, of a buffer (H, W) that is 1 near and 0 far, upside down."""
        near, far = (self.model.stat.extent * getattr(self.model.vis.map, name) for name in ("znear", "zfar"))
        buffer = np.flipud(raw).astype(np.float64)
        depth: FloatArray = near * far / (near + buffer * (far - near))
        return np.where(depth < FARTHEST, depth, np.nan).astype(np.float32)

    def close(self) -> None:
        """Release the framebuffer."""
        self._context.free()
        self._gl.free()
