"""A MuJoCo model as a simulation: its arm, its cameras' RGB-D pictures drawn offscreen, its state."""

from __future__ import annotations

import atexit
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import View
from gvla2.planning.scene import Box, Scene
from gvla2.robot.arm_from_urdf import RobotModel
from gvla2.robot.mujoco.arm import ArmNames, arm_from_mjcf, robot_bodies
from gvla2.robot.mujoco.objects import true_scene
from gvla2.robot.mujoco.options import MujocoConfig
from gvla2.robot.options import ArmConfig
from gvla2.robot.simulation import Simulation

log = logging.getLogger(__name__)

FARTHEST = 5.0
"""Depth beyond this counts as not measured, metres, as with depth cameras."""

_GL = "apt install libegl1 libgl1-mesa-dri (MUJOCO_GL=egl), or apt install libosmesa6 (MUJOCO_GL=osmesa)"


def _cannot_draw(error: Exception) -> MissingDependencyError:
    return MissingDependencyError(f"an offscreen OpenGL ({error})", "A picture of a MuJoCo world", _GL)


def import_mujoco() -> Any:
    """MuJoCo, drawing offscreen where there is no display.

    Raises :class:`MissingDependencyError` without the package or without the library that draws, and
    :class:`ConfigurationError` for a version that is too new.
    """
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco
    except (ImportError, AttributeError, OSError, RuntimeError) as error:  # PyOpenGL raises each of them
        if getattr(error, "name", "") == "mujoco":
            raise MissingDependencyError("mujoco", "A MuJoCo world", 'pip install "gvla2[mujoco]"') from error
        raise _cannot_draw(error) from error
    if int(mujoco.__version__.partition(".")[0]) >= 4:
        raise ConfigurationError(
            f'MuJoCo {mujoco.__version__} is installed and the worlds need one below 4: pip install "mujoco<4"'
        )
    mujoco.set_mju_user_warning(log.info)  # else it writes a file into the working folder
    return mujoco


def _check_cameras(model: Any, names: Sequence[str], option: str) -> None:
    there = [model.camera(i).name for i in range(model.ncam)]
    if not names or not {*names} <= {*there} or len({*names}) != len(names):
        raise ConfigurationError(
            f"robot.{option}={list(names)} must be one or more different names out of {', '.join(there)}."
        )


class ModelEyes:
    """Draws one model with its present ``data``; ``groups`` are the groups of geoms that are drawn.

    Raises :class:`ConfigurationError` for a camera that the model lacks.
    """

    def __init__(self, model: Any, data: Any, cameras: Sequence[str], groups: Sequence[int]) -> None:
        self._mujoco = mujoco = import_mujoco()
        _check_cameras(model, cameras, "cameras")
        self.model, self.data, self.cameras = model, data, tuple(cameras)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = [group in groups for group in range(len(self._option.geomgroup))]
        self._option.sitegroup[:] = 0
        self._shown = mujoco.MjData(model)  # of earlier moments
        self._renderers: dict[int, Any] = {}  # by the side of their pictures
        self._frusta = mujoco.MjvScene(model, 1)  # holds cameras' lenses

    def camera(self, name: str, size: int) -> Camera:
        """The camera as it is now, with square images of ``size`` pixels; its lens as MuJoCo draws by it, which a
        sensor in the model decides where there is one. Raises :class:`ConfigurationError` for a parallel projection.
        """
        mujoco, index = self._mujoco, self.model.camera(name).id
        pose = rigid(self.data.cam_xmat[index].reshape(3, 3), self.data.cam_xpos[index])
        chosen = mujoco.MjvCamera()
        chosen.type, chosen.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, index
        mujoco.mjv_updateCamera(self.model, self.data, chosen, self._frusta)
        lens = self._frusta.camera[0]
        if lens.orthographic:
            raise ConfigurationError(f"The camera '{name}' is orthographic; choose one with a perspective.")
        height = lens.frustum_top - lens.frustum_bottom
        width = 2.0 * lens.frustum_width or height
        K = np.diag([size * lens.frustum_near / width, size * lens.frustum_near / height, 1.0])
        K[:2, 2] = size * (0.5 - lens.frustum_center / width), size * lens.frustum_top / height
        return replace(Camera.from_opengl(1.0, pose, size, size, name), K=K)

    def view(self, name: str, size: int) -> View:
        """The picture with depth, metres, NaN beyond 5 m; the robot is not marked."""
        return View(self.camera(name, size), self.picture(name, size), self.depth(name, size))

    def depth(self, name: str, size: int) -> NDArray[np.float32]:
        """(H, W) metres, NaN beyond 5 m; takes a fraction of a picture's time."""
        renderer = self._prepared(self.data, name, size, lit=False)
        renderer.enable_depth_rendering()
        depth = renderer.render()
        renderer.disable_depth_rendering()
        return np.where(depth < FARTHEST, depth, np.float32(np.nan))

    def picture(self, name: str, size: int) -> NDArray[np.uint8]:
        """(H, W, 3) what the camera sees."""
        return np.asarray(self._prepared(self.data, name, size, lit=True).render())

    def draw_later(self, names: Sequence[str], size: int) -> Callable[[], NDArray[np.uint8]]:
        """A function that draws what the cameras see now, side by side and unlit, until the world's next reset."""
        mujoco, whole = self._mujoco, self._mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, whole))
        mujoco.mj_getState(self.model, self.data, state, whole)

        def draw() -> NDArray[np.uint8]:
            mujoco.mj_setState(self.model, self._shown, state, whole)
            mujoco.mj_forward(self.model, self._shown)
            return np.hstack([self._prepared(self._shown, name, size, lit=False).render() for name in names])

        return draw

    def _prepared(self, data: Any, name: str, size: int, lit: bool) -> Any:
        """The renderer with the scene of ``data``; shadows and reflections, if ``lit``, draw it several times."""
        renderer, flags = self._renderer(size), self._mujoco.mjtRndFlag
        renderer.update_scene(data, name, self._option)
        renderer.scene.flags[flags.mjRND_SHADOW] = lit
        renderer.scene.flags[flags.mjRND_REFLECTION] = lit
        return renderer

    def _renderer(self, size: int) -> Any:
        if size not in self._renderers:
            buffer = self.model.vis.global_
            buffer.offwidth, buffer.offheight = max(buffer.offwidth, size), max(buffer.offheight, size)
            try:
                self._renderers[size] = self._mujoco.Renderer(self.model, size, size)
            except Exception as error:  # each of EGL, OSMesa and GLFW raises its own
                raise _cannot_draw(error) from error
            atexit.register(self.close)  # before the display itself ends, which it does at exit, too
        return self._renderers[size]

    def close(self) -> None:
        """Release the framebuffers."""
        atexit.unregister(self.close)
        for renderer in self._renderers.values():
            renderer.close()
        self._renderers = {}


IMPOSSIBLE = 1e3
"""Speed of a joint or body beyond which the physics has blown up, m/s or rad/s."""


class ModelWorld(Simulation):
    """A compiled model with its state.

    The arm is the one that ``names`` names. Derived worlds begin, step and judge, and have: the ``groups`` of geoms
    that cameras see, where the tool may go (``workspace``), and how high the main support is (``table_height``).
    """

    groups: Sequence[int]
    workspace: Box
    table_height: float

    def __init__(self, config: MujocoConfig, model: Any, data: Any, names: ArmNames) -> None:
        self.model, self.data, self.names, self._config = model, data, names, config
        self.lag = 2.0 / np.sqrt(config.stiffness)  # of a critically damped joint
        self.eyes = ModelEyes(model, data, config.cameras, self.groups)
        self._filming = config.video_cameras or config.cameras[:1]
        _check_cameras(model, self._filming, "video_cameras")
        names.check(model)
        self._qpos = [int(model.joint(name).qposadr[0]) for name in names.joints]
        self._dofs = [int(model.joint(name).dofadr[0]) for name in names.joints]

    @cached_property
    def robot(self) -> RobotModel:  # type: ignore[override]  # an attribute that is made when it is first asked for
        """The arm, its home where it is now: at the begin of an episode."""
        arm = ArmConfig(
            name=self._config.name,
            home=self.data.qpos[self._qpos].tolist(),
            table_height=self.table_height,
            workspace_low=self.workspace.low.tolist(),
            workspace_high=self.workspace.high.tolist(),
        )
        return arm_from_mjcf(self.model, self.names, arm, self._config.joint_speed)

    def measure(self) -> tuple[FloatArray, FloatArray, float]:
        """What the arm's own sensors measure."""
        qpos, qvel, fingers = self.data.qpos, self.data.qvel, self.robot.gripper.fingers
        now = [float(self.data.joint(finger.joint).qpos[0]) for finger in fingers]
        apart = sum(abs(at - finger.closed) for at, finger in zip(now, fingers, strict=True))
        return np.array(qpos[self._qpos]), np.array(qvel[self._dofs]), self.robot.gap + apart

    def sane(self) -> bool:
        """Whether the physics went well: MuJoCo starts anew by itself after a state that it cannot continue."""
        data, kinds = self.data, import_mujoco().mjtWarning
        bad = kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC
        blown = any(data.warning[kind].number for kind in bad)
        return not blown and bool(np.isfinite(data.qpos).all() and np.abs(data.qvel).max() < IMPOSSIBLE)

    def look(self) -> Sequence[View]:
        """The views of ``config.cameras``."""
        return [self.eyes.view(name, self._config.image_size) for name in self.eyes.cameras]

    def depths(self) -> Sequence[NDArray[np.float32]]:
        """Their depth maps (H, W)."""
        return [self.eyes.depth(name, self._config.image_size) for name in self.eyes.cameras]

    def finer(self) -> Callable[[str], View] | None:
        """A function that takes a camera's picture of this moment with more pixels, for as long as nothing moves."""
        eyes, size = self.eyes, self._config.picture_size
        if size <= self._config.image_size:
            return None
        return cache(lambda name: View(eyes.camera(name, size), eyes.picture(name, size)))

    def draw_later(self) -> Callable[[], NDArray[np.uint8]]:
        """A function that draws a frame of the film as the world is now."""
        return self.eyes.draw_later(self._filming, -(-self._config.video_size // 2) * 2)

    def true_scene(self) -> Scene:
        """The model's bodies as scene objects."""
        robot = robot_bodies(self.model, self.names.base)
        return true_scene(self.model, self.data, self.groups, robot, self.table_height, self.workspace)

    def close(self) -> None:
        """Release the framebuffers."""
        self.eyes.close()
