"""Rollouts of a policy, stored as runs are, so that `gvla2 export lerobot` makes a data set of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, OutputError
from gvla2.gym.env import TaskEnv
from gvla2.io.files import make_folder, write_json
from gvla2.record.motion import SMALLEST, Motion
from gvla2.robot.backend import Moment

Step = dict[str, Any]


class RecordRollouts(gymnasium.Wrapper[Step, NDArray[np.float32], Step, NDArray[np.float32]]):
    """Stores every episode in a folder of its own below ``folder``, which must be empty or missing.

    One frame per step, and one at the start: the first camera's picture, the measured joints and opening, 20
    frames a second. An episode is stored when it ends, or is left by :meth:`reset` or :meth:`close`;
    ``gvla2 export lerobot FOLDER to=DATASET`` takes those that succeeded. Raises :class:`ConfigurationError` for an
    environment that is not gvla2's or shows no images, or images too small for a film, and :class:`OutputError` for a
    folder that is not empty.
    """

    def __init__(self, env: gymnasium.Env[Step, NDArray[np.float32]], folder: str | Path) -> None:
        super().__init__(env)
        if not isinstance(env.unwrapped, TaskEnv) or not env.unwrapped.shows_pictures:
            raise ConfigurationError("Only gvla2's own environments, with obs_mode='rgbd', can be recorded.")
        self._task = env.unwrapped
        space: Any = env.unwrapped.observation_space
        height, width = space["rgb"].shape[1:3]
        if min(height, width) < SMALLEST:
            raise ConfigurationError(
                f"Pictures of {width} x {height} pixels cannot be filmed: use image_size={SMALLEST} or more."
            )
        self._folder = make_folder(Path(folder))
        if any(self._folder.iterdir()):
            raise OutputError(f"The folder '{folder}' is not empty: name a new one for these rollouts.")
        self._place, self._episodes, self._steps = self._folder, 0, 0
        self._motion: Motion | None = None
        self._result: dict[str, Any] = {}

    def reset(self, **given: Any) -> tuple[Step, dict[str, Any]]:
        """Begin the next episode; one that did not end is kept as it is."""
        self._keep()
        seen, info = self.env.reset(**given)
        self._place = make_folder(self._folder / f"{self._episodes:06d}")
        self._episodes += 1
        self._motion, self._steps = Motion(self._place), 0
        self._result = {
            "episode": f"rollout-{self._place.name}",
            "task": self._task.task_name,
            "seed": -1 if given.get("seed") is None else given["seed"],
            "instruction": info["instruction"],
            "robot": self._task.robot_name,
            "robot_options": dict(self._task.robot_options),
            "success": False,
        }
        self._note(seen)
        return seen, info

    def step(self, action: NDArray[np.float32]) -> tuple[Step, float, bool, bool, dict[str, Any]]:
        """A step of the environment, and its frame."""
        seen, reward, terminated, truncated, info = self.env.step(action)
        self._note(seen)
        self._result["success"] = bool(info["is_success"])
        if terminated or truncated:
            self._keep()
        return seen, float(reward), terminated, truncated, info

    def close(self) -> None:
        """Store the running episode, and release the simulator."""
        self._keep()
        super().close()

    def _note(self, seen: Step) -> None:
        if self._motion is not None:
            seconds, opening = self._steps * self._task.actions.period, float(seen["gripper"][0])
            joints, command = seen["joints"].astype(np.float64), self._task.actions.command
            self._motion.moment(Moment(seconds, joints, opening, command=command))
            self._motion.frame(seen["rgb"][0])
            self._steps += 1

    def _keep(self) -> None:
        """Close the film; last of all the result, which makes the folder an episode's."""
        if self._motion is not None:
            self._motion.finish()
            write_json(self._place / "result.json", self._result)
            self._motion = None
