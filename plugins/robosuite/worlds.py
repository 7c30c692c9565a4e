"""A task of robosuite as a world."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from gvla2.errors import ConfigurationError
from gvla2.planning.scene import Box
from gvla2.robot.mujoco.stepping import OPTIONS, EnvWorld, hand_of, import_robosuite, silent
from gvla2_plugins.robosuite import RobosuiteConfig

SUITE = "robosuite/"
SENTENCES: Mapping[str, str] = MappingProxyType(
    {
        f"{SUITE}Lift": "lift the red cube",
        f"{SUITE}Stack": "put the red cube on the green cube",
        f"{SUITE}NutAssemblySquare": "put the square nut on the square peg",
        f"{SUITE}NutAssemblyRound": "put the round nut on the round peg",
        f"{SUITE}Door": "open the door",
        f"{SUITE}PickPlaceMilk": "put the milk in the near right compartment of the left bin",
        f"{SUITE}PickPlaceBread": "put the bread in the far right compartment of the left bin",
        f"{SUITE}PickPlaceCereal": "put the cereal in the near left compartment of the left bin",
        f"{SUITE}PickPlaceCan": "put the can in the far left compartment of the left bin",
    }
)
"""Ours: robosuite has none."""

TABLE = 0.8
"""Height of the table of all tasks, metres."""

LOW, HIGH = (-0.38, -0.50, TABLE), (0.38, 0.55, TABLE + 0.8)
"""Where the tool may go, metres."""


class RobosuiteWorld(EnvWorld):
    """One task, laid out by a seed."""

    def __init__(self, task: str, config: RobosuiteConfig) -> None:
        robosuite = import_robosuite("robosuite")
        if config.arm not in robosuite.ALL_ROBOTS:
            raise ConfigurationError(
                f"robot.arm={config.arm} is no robot of robosuite: {', '.join(robosuite.ALL_ROBOTS)}."
            )
        span = {"input_max": 10, "input_min": -10, "output_max": 10, "output_min": -10}  # radians in and out
        law = {"type": "JOINT_POSITION", "input_type": "absolute", **span, "kp": config.stiffness}
        arm = {**law, "interpolation": None, "gripper": {"type": "GRIP"}}
        name = task.removeprefix(SUITE)
        # The sizes of objects are drawn once, here: from numpy's global state until 1.5.1, then from a seed.
        own = "seed" in inspect.signature(robosuite.environments.REGISTERED_ENVS[name]).parameters
        with silent():
            np.random.seed(0)
            env = robosuite.make(
                name,
                robots=config.arm,
                gripper_types=config.gripper,
                controller_configs={"type": "BASIC", "body_parts": {"right": arm}},
                **OPTIONS,
                **({"seed": 0} if own else {}),
            )
        # The hand's command moves with every step of control.
        super().__init__(config, env, config.max_steps, hand_of(env).speed)
        self.workspace, self.table_height = Box(np.array(LOW), np.array(HIGH)), TABLE
        self.instruction, self.goal = SENTENCES[task], f"robosuite's own check of {name}"
        self._settle_steps = config.settle_steps

    def begin(self, seed: int) -> None:
        """The state that robosuite draws for the seed."""
        if hasattr(self.env, "rng"):  # since 1.5.2, shared with its samplers; numpy's global state before
            self.env.rng.bit_generator.state = np.random.default_rng(seed).bit_generator.state
        self.reset(seed)
        self.settle(self._settle_steps)
