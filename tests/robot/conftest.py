"""The real Panda model, scenes to move in, and a driver that moves exactly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from gvla2.geometry.transform import rigid
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import grasp_rotation
from gvla2.robot.arm_from_urdf import ArmModel
from gvla2.robot.driver import DriverState, GripResult, MoveResult
from gvla2.robot.workcell import make_cell
from gvla2_plugins.sapien import SapienPandaConfig


@pytest.fixture(scope="session")
def arm() -> ArmModel:
    return make_cell(SapienPandaConfig()).arm


@pytest.fixture
def scene_of(arm) -> Callable[..., Scene]:
    def make(*objects: SceneObject, table: float = 0.752) -> Scene:
        return Scene(tuple(objects), table, arm.workspace)

    return make


@pytest.fixture
def block() -> Callable[..., SceneObject]:
    def make(
        name="block", at=(0.3, 0.0, 0.777), size=(0.05, 0.05, 0.05), shape="box", parent=""
    ) -> SceneObject:
        pose = rigid(None, at)
        return SceneObject(name, name, shape, "", pose, np.array(size), np.array([at]), parent=parent)

    return make


@pytest.fixture
def down() -> Callable[..., np.ndarray]:
    """Tool pose (4, 4) that points down at a place, fingers closing along world y turned by ``yaw``."""

    def make(xyz, yaw: float = 0.0) -> np.ndarray:
        closing = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
        return rigid(grasp_rotation(np.array([0.0, 0.0, -1.0]), closing), xyz)

    return make


@dataclass
class ExactDriver:
    """A kinematic robot: goes exactly to its targets; ``between`` metres are between its fingers when closed."""

    joints: np.ndarray
    width: float = 0.08
    between: float = 0.05
    off: np.ndarray | float = 0.0
    on_follow: Callable[[int], None] = lambda call: None
    diverges: bool = False
    calls: list[str] = field(default_factory=list)
    samples: list[np.ndarray] = field(default_factory=list)

    def state(self) -> DriverState:
        return DriverState(self.joints.copy(), self.width)

    def follow(self, samples: np.ndarray, dt: float, gripper: float, stop: object = None) -> MoveResult:
        self.calls.append("follow")
        np.testing.assert_allclose(samples[0], np.clip(self.joints, samples[0], samples[0]), atol=0.05)
        self.samples.append(samples)
        self.joints = samples[len(samples) // 2].copy()
        self.on_follow(self.calls.count("follow"))
        self.joints = samples[-1] + self.off
        return MoveResult(("panda_hand",) if gripper < 0.5 else (), self.diverges)

    def grip(self, opening: float) -> GripResult:
        self.calls.append("grip")
        self.width = max(0.08 * opening, self.between)
        return GripResult(self.width, self.width > 0.08 * opening + 1e-6)

    def hold(self) -> None:
        self.calls.append("hold")


@pytest.fixture
def driver(arm) -> ExactDriver:
    return ExactDriver(arm.home)
