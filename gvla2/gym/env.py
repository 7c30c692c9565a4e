"""The environment: one task on one robot, a waypoint a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, get_args

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.catalog import load_plugins
from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.views import Observation
from gvla2.gym.actions import HIGH, LOW, WaypointActions
from gvla2.gym.observing import arrays, cameras, observation_space
from gvla2.gym.stepping import Stepper, reported
from gvla2.planning.arm import Arm
from gvla2.robot.task import Profile, TaskInstance

INSTRUCTION = "instruction"


class TaskEnv(gymnasium.Env[dict[str, Any], NDArray[np.float32]]):
    """A task as a Gymnasium environment.

    An action is a waypoint (see :class:`gvla2.gym.actions.WaypointActions`), which the robot's own motion planner and
    executor carry out: straight where they can, else around the table and the arm itself. What lies on the table is
    no obstacle: minding it is up to the agent. A waypoint that cannot be reached moves nothing, costs its step, and
    is told in ``info["waypoint"]``. The observation is that of :func:`gvla2.gym.observing.arrays`.

    The reward is 1 when the referee finds the goal of ``profile`` reached, which ends the episode, and 0 otherwise.
    ``info`` has the ``instruction`` and the ``cameras``, and after a step ``success`` by profile, ``is_success``
    and ``waypoint``. :meth:`reset` with ``seed=N`` lays out what ``gvla2 run seed=N`` does, and takes the option
    ``instruction``, a sentence of your own.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012 - as gymnasium declares it

    def __init__(
        self,
        task: str,
        *,
        robot: str = "sapien_panda",
        image_size: int | None = None,
        cameras: Sequence[str] | None = None,
        task_options: Mapping[str, Any] | None = None,
        robot_options: Mapping[str, Any] | None = None,
        profile: Profile = "eased",
        speed: float = 0.2,
        render_mode: str | None = None,
    ) -> None:
        """Build task and robot by name, with their options as on the command line.

        ``image_size`` (pixels) and ``cameras`` (names) are options of the robot, here for short; a task may ask for
        larger images than that. ``speed`` of the tool in m/s. Raises :class:`gvla2.errors.UnknownComponentError` and
        :class:`ConfigurationError` for names and options that there are not.
        """
        if profile not in get_args(Profile):
            raise ConfigurationError(f"profile is '{profile}'; it is one of {', '.join(get_args(Profile))}.")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigurationError(f"render_mode is '{render_mode}'; it is None or 'rgb_array'.")
        if not 0 < speed <= 1:
            raise ConfigurationError(f"speed is {speed} m/s; it lies above 0 and is 1 at most.")
        short = {"image_size": image_size, "cameras": None if cameras is None else list(cameras)}
        options = {
            **(robot_options or {}),
            **{key: value for key, value in short.items() if value is not None},
        }
        root = {"robot": {**options, "name": robot}, "task": {**(task_options or {}), "name": task}}
        registry = load_plugins()
        if needs := registry.get("robot", robot).needs:
            raise ConfigurationError(
                f"The robot '{robot}' needs a {needs[0]} beside it: an environment takes a simulated robot, which has "
                "eyes of its own and a referee."
            )
        built = registry.build_all(root, ("task", "robot"))
        self._names = (robot, task)
        self._robot, self._task, self._profile = built["robot"], built["task"], profile
        self._speed, self.render_mode = speed, render_mode
        self._instance: TaskInstance | None = None
        self._stepper: Stepper | None = None
        self.actions = WaypointActions(self._robot.arm.workspace)
        self.action_space = gymnasium.spaces.Box(LOW, HIGH, dtype=np.float32)
        try:
            _, seen = self._lay_out(0, None)  # how large the images are, the cameras themselves know
            self.observation_space = observation_space(seen, self.arm)
        except BaseException:
            self.close()
            raise
        self._instance = self._stepper = None

    @property
    def arm(self) -> Arm:
        """Kinematics and collision model of the robot."""
        arm: Arm = self._robot.arm
        return arm

    @property
    def observation(self) -> Observation:
        """What the robot saw last, as perceivers and planners of gvla2 take it."""
        return self._running().seen

    @property
    def instruction(self) -> str:
        """The episode's sentence."""
        self._running()
        assert self._instance is not None
        return self._instance.instruction

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode: that of ``seed``, or without one the next of the generator seeded last."""
        super().reset(seed=seed)
        chosen = int(self.np_random.integers(2**31)) if seed is None else seed
        unknown = set(options or {}) - {INSTRUCTION}
        if unknown:
            raise ConfigurationError(
                f"reset() knows no option '{min(unknown)}'; it takes '{INSTRUCTION}', a sentence."
            )
        self._instance = self._stepper = None
        self._instance, seen = self._lay_out(chosen, (options or {}).get(INSTRUCTION))
        self._stepper = Stepper(self._robot, seen, self._speed)
        return arrays(seen), self._info(seen)

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Carry out a waypoint, let the referee look, and observe.

        A simulation that blows up truncates the episode: the last sane observation comes back, and ``info["error"]``
        says what happened.
        """
        stepper = self._running()
        pose, gripper = self.actions.pose(action)
        success: dict[str, bool] = {"eased": False, "strict": False}
        lost = ""
        try:
            judgement = stepper.go(pose, gripper)
            success = {"eased": judgement.eased, "strict": judgement.strict}
        except RobotError as error:
            lost = str(error)
        done = success[self._profile]
        info = self._info(stepper.seen)
        info |= {"success": success, "is_success": done, "waypoint": reported(stepper.report)}
        if lost:
            info["error"] = lost
        return arrays(stepper.seen), float(done), done, bool(lost), info

    def render(self) -> NDArray[np.uint8] | None:
        """The first camera's image (H, W, 3) of the last observation."""
        return None if self.render_mode is None else self.observation.views[0].image.copy()

    def close(self) -> None:
        """Let go of the simulator; safe to call twice."""
        self._instance = self._stepper = None
        self._robot.close()

    def _lay_out(self, seed: int, instruction: str | None) -> tuple[TaskInstance, Observation]:
        instance = self._robot.reset(self._task, seed, instruction)
        if instance is None:
            robot, task = self._names
            raise ConfigurationError(
                f"The robot '{robot}' cannot lay out the task '{task}': choose a simulated one."
            )
        return instance, self._robot.observe()

    def _running(self) -> Stepper:
        if self._stepper is None:
            raise RobotError("No episode is under way: call reset() first.")
        return self._stepper

    def _info(self, seen: Observation) -> dict[str, Any]:
        return {INSTRUCTION: self.instruction, "cameras": cameras(seen)}
