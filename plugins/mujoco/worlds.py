"""An MJCF file as a world: its own position actuators."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gvla2.errors import RobotError, reading
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box
from gvla2.robot.mujoco.arm import ArmNames
from gvla2.robot.mujoco.world import ModelWorld, import_mujoco
from gvla2_plugins.mujoco import MjcfConfig


class MjcfWorld(ModelWorld):
    """The file's model; it has no success check."""

    def __init__(self, config: MjcfConfig) -> None:
        self._mujoco, self._file = import_mujoco(), config.mjcf
        mujoco = self._mujoco
        with reading("robot.mjcf", config.mjcf, RobotError):
            model = mujoco.MjModel.from_xml_path(str(Path(config.mjcf).expanduser()))
            names = ArmNames(config.base, config.tool, tuple(config.joints), tuple(config.fingers))
            self.groups, self.table_height = config.geom_groups, config.table_height
            super().__init__(config, model, mujoco.MjData(model), names)
        self.workspace = Box(np.array(config.workspace_low), np.array(config.workspace_high))
        self.rate, self._settle_seconds = config.rate, config.settle_seconds
        try:
            self._servos = [self._servo_of(self.model.joint(name).id) for name in self.names.joints]
            self._hand = [int(self.model.actuator(name).id) for name in config.gripper_actuators]
            self._key = int(self.model.key(config.keyframe).id) if config.keyframe else None
        except KeyError as error:
            raise RobotError(
                f"robot.joints, robot.gripper_actuators or robot.keyframe: {error.args[0]}"
            ) from error

    def _servo_of(self, joint: int) -> int:
        model = self.model
        found = np.flatnonzero((model.actuator_trntype == 0) & (model.actuator_trnid[:, 0] == joint))
        if len(found) != 1 or model.actuator_biastype[found[0]] == 0:
            raise RobotError(
                f"The joint {model.joint(joint).name} needs one position actuator; the file gives it {len(found)}, or "
                'a motor. <position joint="..." kp="..."/> makes one.'
            )
        return int(found[0])

    def begin(self, seed: int) -> None:
        """The file's initial state, whatever the seed."""
        if self._key is None:
            self._mujoco.mj_resetData(self.model, self.data)
        else:
            self._mujoco.mj_resetDataKeyframe(self.model, self.data, self._key)
        self._mujoco.mj_forward(self.model, self.data)
        joints = np.array([self.data.joint(name).qpos[0] for name in self.names.joints])
        for _ in range(round(self._settle_seconds * self.rate)):
            self.step(joints, 1.0)
            if not self.sane():
                raise RobotError(
                    f"robot.mjcf={self._file}: the physics blows up in the file's first state. Look for positions, "
                    "masses and gains that are too large."
                )

    def step(self, joints: FloatArray, opening: float) -> None:
        """Physics steps of one control period."""
        for actuator in self._hand:
            closed, opened = sorted(self.model.actuator_ctrlrange[actuator], key=abs)  # either sign may open
            self.data.ctrl[actuator] = closed + opening * (opened - closed)
        self.data.ctrl[self._servos] = joints
        count = max(1, round(1.0 / (self.rate * self.model.opt.timestep)))
        self._mujoco.mj_step(self.model, self.data, nstep=count)
