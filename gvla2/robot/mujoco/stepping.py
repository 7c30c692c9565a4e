"""Environments of robosuite, versions 1.4 and 1.5, as worlds: stepped by joint positions and one sign for the hand."""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box
from gvla2.robot.mujoco.description import ArmNames
from gvla2.robot.mujoco.world import import_mujoco

RATE = 20.0
"""Control steps a second of the published evaluations."""

DRAWN: tuple[int, ...] = (1,)
"""Group of the geoms that robosuite draws; group 0 are collision shapes."""


def import_robosuite(wanted: str, needed_by: str, extra: str) -> Any:
    """Robosuite of the version that begins with ``wanted``.

    Raises :class:`MissingDependencyError` without it and :class:`ConfigurationError` with another: 1.4 and 1.5 cannot
    be in one environment.
    """
    try:
        found = version("robosuite")
    except PackageNotFoundError:
        raise MissingDependencyError("robosuite", needed_by, f'pip install "gvla2[{extra}]"') from None
    if not found.startswith(f"{wanted}."):
        raise ConfigurationError(
            f"{needed_by} needs robosuite {wanted}, and this environment has {found}. robot=libero needs 1.4 and "
            "robot=robosuite 1.5, which exclude each other: make an environment for each, with gvla2[libero] in one "
            "and gvla2[robosuite] in the other."
        )
    import_mujoco()
    with silent():
        import robosuite
    return robosuite


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Without what robosuite and LIBERO print, log and warn of on import and while they make environments."""
    logger = logging.getLogger("robosuite_logs")
    before, logger.disabled = logger.disabled, True
    with (
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
        warnings.catch_warnings(),
    ):
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logger.disabled = before


class EnvWorld:
    """A world (:class:`gvla2.robot.mujoco.world.World`) around an environment that was made with :meth:`options`."""

    rate, groups = RATE, DRAWN

    def __init__(
        self,
        env: Any,
        *,
        instruction: str,
        goal: str,
        workspace: Box,
        table_height: float,
        stiffness: float,
        max_steps: int = 0,
    ) -> None:
        self.env, self.instruction, self.goal = env, instruction, goal
        self.workspace, self.table_height, self.max_steps = workspace, table_height, max_steps
        self.lag: float = 2.0 / np.sqrt(stiffness)  # of a critically damped joint
        self.steps, self._reached = 0, False
        self.model, self.data = env.sim.model._model, env.sim.data._data
        self.names = self._named()
        self._absolute = hasattr(env.robots[0], "composite_controller")  # since 1.5
        for observed in env.observation_names:  # nobody reads them, and they take longer than the physics
            env.modify_observable(observed, "enabled", False)
        self._sent = 0.0  # where the hand's command is, from -1 (closed) to 1
        # Version 1.4 moves it with every step of the physics, 1.5 with every step of control.
        self._stride = self._hand.speed * (
            1 if self._absolute else round(env.control_timestep / env.model_timestep)
        )
        self.hand_steps = round(2 / self._stride)

    @staticmethod
    def options(controller: dict[str, Any]) -> dict[str, Any]:
        """Of an environment that draws nothing itself, loads its model once and ends no episode."""
        return {
            "controller_configs": controller,
            "has_renderer": False,
            "has_offscreen_renderer": False,
            "use_camera_obs": False,
            "control_freq": RATE,
            "ignore_done": True,
            "hard_reset": False,
        }

    def _named(self) -> ArmNames:
        robot, hand = self.env.robots[0], self._hand
        prefix = hand.naming_prefix
        bodies = [self.model.body(i).name for i in range(self.model.nbody)]
        tool = next((b for b in bodies if b == f"{prefix}right_gripper"), bodies[-1])
        return ArmNames("robot0_base", tool, tuple(robot.robot_joints), tuple(hand.joints))

    @property
    def _hand(self) -> Any:
        gripper = self.env.robots[0].gripper
        return gripper["right"] if isinstance(gripper, dict) else gripper

    def step(self, joints: FloatArray, opening: float) -> None:
        """One control step; the hand's command moves by its own speed, up or down."""
        off = 2 * opening - 1 - self._sent
        sign = 0.0 if abs(off) < 0.5 * self._stride else float(np.sign(off))
        self._sent = float(np.clip(self._sent + sign * self._stride, -1.0, 1.0))
        indexes = self.env.robots[0]._ref_joint_pos_indexes
        here = np.zeros(len(joints)) if self._absolute else self.data.qpos[indexes]
        self.env.step(np.append(joints - here, -sign))
        self.steps += 1
        self._reached = self._reached or bool(self.env._check_success())

    def settle(self, steps: int) -> None:
        """Let the objects come to rest with the arm held, uncounted."""
        joints = np.array(self.data.qpos[self.env.robots[0]._ref_joint_pos_indexes])
        self._sent = 0.0
        for _ in range(steps):
            self.step(joints, 1.0)
        self.steps, self._reached = 0, False

    def succeeded(self) -> bool:
        """Whether the environment's own check was met at any step of the episode."""
        return self._reached

    def reset(self, seed: int) -> None:
        """The environment's own reset, reproducible by the seed."""
        np.random.seed(seed % 2**32)
        with silent():
            self.env.reset()
        self._hand.current_action = np.zeros_like(
            self._hand.current_action
        )  # the environment leaves it as it was
        self.data = self.env.sim.data._data


def joint_controller(stiffness: float) -> dict[str, Any]:
    """Robosuite's controller of joint positions, radians in and out."""
    span = {"input_max": 10, "input_min": -10, "output_max": 10, "output_min": -10}
    return {"type": "JOINT_POSITION", **span, "kp": stiffness, "interpolation": None}
