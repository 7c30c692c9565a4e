"""An MJCF file as a world: its own actuators, driven by joint positions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box
from gvla2.robot.mujoco.description import ArmNames
from gvla2.robot.mujoco.eyes import import_mujoco
from gvla2_plugins.mujoco import MjcfConfig

SCENERY: tuple[str, ...] = ("floor", "table", "wall", "ground")


class MjcfWorlds:
    """Implements :class:`gvla2.robot.mujoco.world.Worlds`: the one world of a file."""

    def __init__(self, config: MjcfConfig) -> None:
        missing = [f"robot.{name}=..." for name in config.required if not getattr(config, name)]
        if missing:
            raise ConfigurationError(f"robot=mujoco needs {', '.join(missing)}.")
        if not Path(config.mjcf).expanduser().is_file():
            raise ConfigurationError(f"robot.mjcf={config.mjcf} is no file.")
        self._config = config

    def tasks(self) -> Mapping[str, str]:
        """None: the file knows no sentence."""
        return {}

    def load(self, task: str | None) -> MjcfWorld:
        """The world."""
        if task is not None:
            raise ConfigurationError(f"robot=mujoco has no task '{task}': task=none instruction='...'.")
        return MjcfWorld(self._config)


class MjcfWorld:
    """Implements :class:`gvla2.robot.mujoco.world.World`."""

    instruction, goal, max_steps, scenery, hand_steps = "", "", 0, SCENERY, 1

    def __init__(self, config: MjcfConfig) -> None:
        self._mujoco = mujoco = import_mujoco()
        try:
            self.model: Any = mujoco.MjModel.from_xml_path(str(Path(config.mjcf).expanduser()))
        except ValueError as error:
            raise RobotError(f"robot.mjcf={config.mjcf} does not compile: {error}") from error
        self.data: Any = mujoco.MjData(self.model)
        self.names = ArmNames(config.base, config.tool, tuple(config.joints), tuple(config.fingers))
        self.names.check(self.model)
        self.rate, self.steps, self.groups = config.rate, 0, tuple(config.geom_groups)
        self.workspace = Box(np.array(config.workspace_low), np.array(config.workspace_high))
        self.table_height, self.lag = config.table_height, 2.0 / np.sqrt(config.stiffness)
        self._config, self._stiffness = config, config.stiffness
        ids = [self.model.joint(name).id for name in self.names.joints]
        self._qpos, self._dofs = self.model.jnt_qposadr[ids], self.model.jnt_dofadr[ids]
        self._motors = [self._actuator_of(joint) for joint in ids]
        self._hand = [self._named("actuator", name) for name in config.gripper_actuators]
        self._key = self._named("key", config.keyframe) if config.keyframe else -1
        self._mass = np.zeros((self.model.nv, self.model.nv))
        self._restart()

    def _named(self, kind: str, name: str) -> int:
        """The number of an actuator or keyframe; raises :class:`RobotError` with the names that there are."""
        try:
            return int(getattr(self.model, kind)(name).id)
        except KeyError as error:
            raise RobotError(f"The model has no {kind} '{name}': {error.args[0]}") from error

    def _actuator_of(self, joint: int) -> int:
        found = np.flatnonzero(
            (self.model.actuator_trntype == 0) & (self.model.actuator_trnid[:, 0] == joint)
        )
        if len(found) != 1:
            raise RobotError(
                f"The joint {self.model.joint(joint).name} has {len(found)} actuators; each joint of the arm needs one."
            )
        return int(found[0])

    def _restart(self) -> None:
        if self._key >= 0:
            self._mujoco.mj_resetDataKeyframe(self.model, self.data, self._key)
        else:
            self._mujoco.mj_resetData(self.model, self.data)
        self._mujoco.mj_forward(self.model, self.data)

    def begin(self, seed: int) -> None:
        """The file's initial state, whatever the seed."""
        self._restart()
        joints = np.array(self.data.qpos[self._qpos])
        for _ in range(round(self._config.settle_seconds * self.rate)):
            self.step(joints, 1.0)
        self.steps = 0

    def step(self, joints: FloatArray, opening: float) -> None:
        """Physics steps of one control period: positions for servos, computed torques for motors."""
        for actuator in self._hand:
            closed, opened = sorted(self.model.actuator_ctrlrange[actuator], key=abs)  # either sign may open
            self.data.ctrl[actuator] = closed + opening * (opened - closed)
        servo = np.array([self.model.actuator_biastype[motor] != 0 for motor in self._motors])
        self.data.ctrl[np.array(self._motors)[servo]] = joints[servo]
        for _ in range(max(1, round(1.0 / (self.rate * self.model.opt.timestep)))):
            if not servo.all():
                self.data.ctrl[np.array(self._motors)[~servo]] = self._torques(joints)[~servo]
            self._mujoco.mj_step(self.model, self.data)
        self.steps += 1

    def _torques(self, joints: FloatArray) -> FloatArray:
        """(dof,) of critically damped joints with this stiffness, gravity and velocity forces compensated."""
        data, gain = self.data, self._stiffness
        self._mujoco.mj_fullM(self.model, self._mass, data.qM)
        speeds = data.qvel[self._dofs]
        wanted = gain * (joints - data.qpos[self._qpos]) - 2.0 * np.sqrt(gain) * speeds
        inertia = self._mass[np.ix_(self._dofs, self._dofs)]
        return np.asarray(inertia @ wanted + data.qfrc_bias[self._dofs])

    def succeeded(self) -> None:
        """Unknown: the file has no success check."""
