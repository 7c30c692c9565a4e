"""A MuJoCo world, its cameras' RGB-D pictures drawn offscreen, and the driver that steps it."""

from __future__ import annotations

import atexit
import itertools
import math
import os
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.geometry.views import View
from gvla2.planning.scene import Box
from gvla2.robot.driver import DriverState, GripResult, MoveResult, StopRule
from gvla2.robot.mujoco.description import ArmNames


class World(Protocol):
    """A compiled model with its state, one task in it, and what judges it.

    ``steps`` counts those of the present episode, ``max_steps`` (0: none) ends it; ``rate`` is in steps a second.
    ``groups`` are the groups of geoms that cameras see. ``workspace`` is where the tool may go, ``table_height`` that
    of the main support, metres. The arm follows its targets ``lag`` seconds late, and the hand's target moves over its
    whole range in ``hand_steps``.
    """

    model: Any
    data: Any
    names: ArmNames
    instruction: str
    goal: str
    rate: float
    steps: int
    max_steps: int
    groups: tuple[int, ...]
    workspace: Box
    table_height: float
    lag: float
    hand_steps: int

    def begin(self, seed: int) -> None:
        """The initial state of that number, objects at rest, ``steps`` at 0."""
        ...

    def step(self, joints: FloatArray, opening: float) -> None:
        """One step towards joints (dof,) and an opening in [0, 1] of the hand."""
        ...

    def succeeded(self) -> bool | None:
        """Whether the task's goal was reached at any step of the episode; None where the world cannot know."""
        ...


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
        self._shown = mujoco.MjData(model)  # of earlier moments
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
        return View(self.camera(name, size), self.picture(name, size), self.depth(name, size))

    def depth(self, name: str, size: int) -> NDArray[np.float32]:
        """(H, W) metres, NaN beyond 5 m; takes a fraction of a picture's time."""
        renderer = self._prepared(self.data, name, size, shadows=False)
        renderer.enable_depth_rendering()
        depth = renderer.render()
        renderer.disable_depth_rendering()
        return np.where(depth < FARTHEST, depth, np.float32(np.nan))

    def picture(self, name: str, size: int) -> NDArray[np.uint8]:
        """(H, W, 3) what the camera sees, with shadows and without reflections."""
        return np.asarray(self._prepared(self.data, name, size, shadows=True).render())

    def draw_later(self, name: str, size: int) -> Callable[[], NDArray[np.uint8]]:
        """A function that draws what the camera sees now, without shadows, until the world's next reset."""
        mujoco, whole = self._mujoco, self._mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, whole))
        mujoco.mj_getState(self.model, self.data, state, whole)

        def draw() -> NDArray[np.uint8]:
            mujoco.mj_setState(self.model, self._shown, state, whole)
            mujoco.mj_forward(self.model, self._shown)
            return np.asarray(self._prepared(self._shown, name, size, shadows=False).render())

        return draw

    def _prepared(self, data: Any, name: str, size: int, shadows: bool) -> Any:
        """The renderer with the scene of ``data``; without reflections: MuJoCo draws all of it again for each reflecting
        face of a box, which doubles the time for the steel of a stove.
        """
        renderer, flags = self._renderer(size), self._mujoco.mjtRndFlag
        renderer.update_scene(data, name, self._option)
        renderer.scene.flags[flags.mjRND_SHADOW] = shadows
        renderer.scene.flags[flags.mjRND_REFLECTION] = False
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

SETTLED, SLOW, SETTLE_SECONDS, NEARER = 3e-3, 0.03, 0.3, 0.03
"""A motion is over at this joint error (rad) and speed (rad/s), or when for so long it came nearer by less (rad)."""

GRIP_SECONDS, STILL, STILL_STEPS = 1.0, 5e-4, 3
"""Gripping is over, once the hand's target has arrived, when the width (metres) changed by less over this number of
steps, or after this long."""

STOPPED_SHORT = 0.004
"""Fingers hold something when they stop this far short of where they were sent, metres."""

HOLD_STEPS = 3


class WorldDriver:
    """Implements :class:`gvla2.robot.driver.Driver` in steps of a world, calling ``film`` after each.

    ``joints`` (dof,) radians and ``width`` metres are what the arm's own sensors measure. The hand opens ``max_width``
    and leaves ``gap`` metres between closed fingers. Targets run ahead of the samples by the controller's lag, so that
    the arm follows them without delay.
    """

    def __init__(self, world: World, gap: float, max_width: float) -> None:
        model, names = world.model, world.names
        self.world = world
        self.film: Callable[[], None] = _nothing
        self._gap, self._max_width = gap, max_width
        self._opening = 1.0  # that the hand was sent to
        self._qpos = np.array([model.joint(n).qposadr[0] for n in names.joints])
        self._dofs = np.array([model.joint(n).dofadr[0] for n in names.joints])
        self._fingers = np.array([model.joint(n).qposadr[0] for n in names.fingers], dtype=np.intp)
        ends = [model.joint(n).range for n in names.fingers]
        self._closed = np.array([low if high > -low else high for low, high in ends])

    @property
    def joints(self) -> FloatArray:
        """(dof,) radians."""
        return np.array(self.world.data.qpos[self._qpos], dtype=np.float64)

    @property
    def width(self) -> float:
        """Between the fingers, metres."""
        return self._gap + float(np.abs(self.world.data.qpos[self._fingers] - self._closed).sum())

    @property
    def time(self) -> float:
        """Simulated seconds of the episode."""
        return self.world.steps / self.world.rate

    def sane(self) -> bool:
        """Whether the physics went well: MuJoCo starts anew by itself after a state that it cannot continue."""
        data, kinds = self.world.data, import_mujoco().mjtWarning
        bad = kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC
        blown = any(data.warning[kind].number for kind in bad)
        return not blown and bool(np.isfinite(data.qpos).all() and np.abs(data.qvel).max() < IMPOSSIBLE)

    def state(self) -> DriverState:
        """The measured state, now."""
        return DriverState(self.joints, self.width, self.time)

    def follow(
        self, samples: FloatArray, dt: float, gripper: float, stop: StopRule | None = None
    ) -> MoveResult:
        """Send the arm through joint targets (T, dof), radians, one every ``dt`` seconds, then settle.

        ``stop`` is asked once a step and feels no force.
        """
        # The opening was measured: it must not release what the fingers squeeze at just that width.
        measured = self.width / self._max_width
        short = measured > self._opening + STOPPED_SHORT / self._max_width
        if not (short and abs(gripper - measured) < 0.1):
            self._opening = gripper
        times, rate = np.arange(len(samples)) * dt, self.world.rate

        def at(moment: float) -> FloatArray:
            return np.array([np.interp(moment, times, column) for column in samples.T])

        count, patience = math.ceil(times[-1] * rate - 1e-9), math.ceil(SETTLE_SECONDS * rate)
        nearest, until = np.inf, count + patience
        for step in itertools.count(1):
            off = float(np.abs(self.joints - samples[-1]).max())
            arrived = off < SETTLED and np.abs(self.world.data.qvel[self._dofs]).max() < SLOW
            # Late, since its motors are at their limits, but on its way.
            if step > count and off < nearest - SETTLED:
                nearest, until = off, step + patience
            if self._over() or step >= until or (step > count and arrived):
                break
            self._step(at(step / rate + self.world.lag))
            if stop is not None and stop(at(step / rate), self.joints, None):
                return MoveResult(stopped=True)
        return MoveResult(diverged=not self.sane(), expired=self.expired())

    def grip(self, opening: float) -> GripResult:
        """Open or close to ``opening`` in [0, 1] with the arm held, and wait for it."""
        way = math.ceil(self.world.hand_steps * abs(opening - self._opening))
        still, self._opening = self.joints, opening
        widths: deque[float] = deque(maxlen=STILL_STEPS)
        for step in range(way + math.ceil(GRIP_SECONDS * self.world.rate)):
            widths.append(self.width)
            if self._over() or (step >= way and len(widths) == STILL_STEPS and np.ptp(widths) < STILL):
                break
            self._step(still)
        return GripResult(self.width, self.width > opening * self._max_width + STOPPED_SHORT)

    def hold(self, steps: int = HOLD_STEPS) -> None:
        """Stop at the measured position and stay there."""
        joints = self.joints
        for _ in range(steps):
            if not self._over():
                self._step(joints)

    def expired(self) -> str:
        """Why the world has ended the episode, "" while it goes on."""
        world = self.world
        ended = 0 < world.max_steps <= world.steps
        return f"The world allows {world.max_steps} steps of {1 / world.rate:g} s." if ended else ""

    def _over(self) -> bool:
        return bool(self.expired()) or not self.sane()

    def _step(self, joints: FloatArray) -> None:
        self.world.step(joints, self._opening)
        film, self.film = self.film, _nothing  # a picture that raises is the last: the arm must still be held
        film()
        self.film = film


def _nothing() -> None:
    """No film."""
