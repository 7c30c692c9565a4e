"""Environments of robosuite, versions 1.4 and 1.5, as worlds: stepped by joint positions and one sign for the hand."""

from __future__ import annotations

import contextlib
import io
import logging
import warnings
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.transform import FloatArray
from gvla2.robot.mujoco.arm import ArmNames
from gvla2.robot.mujoco.options import MujocoConfig
from gvla2.robot.mujoco.world import ModelWorld, import_mujoco

RATE = 20.0
"""Control steps a second of the published evaluations."""

DRAWN: tuple[int, ...] = (1,)
"""Group of the geoms that robosuite draws; group 0 are collision shapes."""


WANTED = {"libero": "1.4", "robosuite": "1.5"}
"""Version of robosuite that each robot needs; the two cannot be in one environment."""


def import_robosuite(robot: str) -> Any:
    """Robosuite for ``robot=libero`` or ``robot=robosuite``.

    Raises :class:`MissingDependencyError` without it and :class:`ConfigurationError` with another version.
    """
    try:
        found = version("robosuite")
    except PackageNotFoundError:
        raise MissingDependencyError("robosuite", f"robot={robot}", f'pip install "gvla2[{robot}]"') from None
    if not found.startswith(f"{WANTED[robot]}."):
        raise ConfigurationError(
            f"robot={robot} needs robosuite {WANTED[robot]}, and this environment has {found}. robot=libero needs 1.4 "
            "and robot=robosuite 1.5, which exclude each other: make an environment for each, with gvla2[libero] in "
            "one and gvla2[robosuite] in the other."
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


OPTIONS: Mapping[str, Any] = MappingProxyType(
    {
        "has_renderer": False,
        "has_offscreen_renderer": False,
        "use_camera_obs": False,
        "control_freq": RATE,
        "ignore_done": True,
        "hard_reset": False,
    }
)
"""Of an environment that draws nothing itself, loads its model once and ends no episode."""


class EnvWorld(ModelWorld):
    """An environment that was made with :data:`OPTIONS`, whose arm the controller drives with ``config.stiffness``.

    ``max_steps`` ends an episode. A control step moves the command of the hand, from -1 (closed) to 1, by
    ``hand_stride``. Derived worlds begin, and say what remains.
    """

    rate, groups = RATE, DRAWN

    def __init__(self, config: MujocoConfig, env: Any, max_steps: int, hand_stride: float) -> None:
        self.env, self.max_steps, self._sent = env, max_steps, 0.0
        self._stride, self.hand_steps = hand_stride, round(2 / hand_stride)
        for observed in env.observation_names:  # nobody reads them, and they take longer than the physics
            env.modify_observable(observed, "enabled", False)
        self.env_robot, self.hand = env.robots[0], hand_of(env)
        tool = f"{self.hand.naming_prefix}right_gripper"
        names = ArmNames("robot0_base", tool, tuple(self.env_robot.robot_joints), tuple(self.hand.joints))
        super().__init__(config, env.sim.model._model, env.sim.data._data, names)

    def step(self, joints: FloatArray, opening: float) -> None:
        """One control step; the hand's command moves by its own speed, up or down."""
        off = 2 * opening - 1 - self._sent
        sign = 0.0 if abs(off) < 0.5 * self._stride else float(np.sign(off))
        self._sent = float(np.clip(self._sent + sign * self._stride, -1.0, 1.0))
        self.advance(joints, -sign)

    def advance(self, joints: FloatArray, closing: float) -> None:
        """The physics of one control step towards joints (dof,); the hand closes (1), stays (0) or opens (-1)."""
        self.env.step(np.append(joints, closing))

    def settle(self, steps: int) -> None:
        """Let the objects come to rest with the arm held."""
        joints = np.array(self.data.qpos[self.env_robot._ref_joint_pos_indexes])
        self._sent = 0.0
        for _ in range(steps):
            self.step(joints, 1.0)

    def succeeded(self) -> bool:
        """The environment's own check."""
        return bool(self.env._check_success())

    def reset(self, seed: int) -> None:
        """The environment's own reset, reproducible by the seed."""
        np.random.seed(seed % 2**32)
        with silent():
            self.env.reset()
        # The environment leaves it as it was.
        self.hand.current_action = np.zeros_like(self.hand.current_action)


def hand_of(env: Any) -> Any:
    """The gripper of an environment's robot; since 1.5 a robot has one for each arm."""
    gripper = env.robots[0].gripper
    return gripper["right"] if isinstance(gripper, dict) else gripper
