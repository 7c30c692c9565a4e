"""The environment: one task on one robot, one waypoint or joint change per step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, ClassVar, Literal, get_args

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gvla2.errors import ConfigurationError, RobotError, SimulationError
from gvla2.geometry.views import Observation
from gvla2.gym.spaces import (
    HIGH,
    LOW,
    MOST_BODIES,
    Arrays,
    JointDeltas,
    WaypointActions,
    body_arrays,
    body_space,
    cameras,
    joint_arrays,
    joint_space,
    picture_arrays,
    picture_space,
)
from gvla2.gym.stepping import JointStepper, WaypointStepper
from gvla2.planning.arm import Arm
from gvla2.plugins.registry import load_plugins
from gvla2.robot.backend import Truthful
from gvla2.robot.task import Profile, TaskInstance

INSTRUCTION = "instruction"


Control = Literal["waypoint", "joint_delta"]
ObservationMode = Literal["rgbd", "state"]


class TaskEnv(gymnasium.Env[dict[str, Any], NDArray[np.float32]]):
    """A task as a Gymnasium environment.

    ``control="waypoint"``: an action is a waypoint (see :class:`gvla2.gym.spaces.WaypointActions`), which the robot's
    own motion planner and executor carry out: straight where they can, else around the table and the arm itself.
    Objects on the table are not obstacles: avoiding them is up to the agent. A waypoint that cannot be reached moves
    nothing, costs its step, and is reported in ``info["waypoint"]``. ``control="joint_delta"``: an action changes the
    joints' targets (see :class:`gvla2.gym.spaces.JointDeltas`), 20 times a second; nothing is planned or checked.

    The observation holds ``tcp``, ``gripper`` and ``joints``, and with ``obs_mode="rgbd"`` what the cameras see
    (``rgb``, ``depth``), with ``"state"`` the true poses of the task's bodies (``bodies``) instead; see
    :mod:`gvla2.gym.spaces`.

    The reward is 1 when the goal of ``profile`` is reached, which ends the episode, and 0 otherwise.
    ``info`` has the ``instruction`` and the ``cameras`` or the ``bodies``' names, and after a step ``success`` by
    profile, ``is_success`` and ``waypoint``. :meth:`reset` with ``seed=N`` lays out what ``gvla2 run seed=N`` does, and
    takes the option ``instruction``, a sentence of your own.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 1}

    def __init__(
        self,
        task: str,
        *,
        robot: str = "sapien_panda",
        image_size: int | None = None,
        cameras: Sequence[str] | None = None,
        task_options: Mapping[str, Any] | None = None,
        robot_options: Mapping[str, Any] | None = None,
        profile: Profile = "relaxed",
        control: Control = "waypoint",
        obs_mode: ObservationMode = "rgbd",
        speed: float = 0.2,
        joint_step: float = 0.1,
        render_mode: str | None = None,
    ) -> None:
        """Build task and robot by name, with their options as on the command line.

        ``image_size`` (pixels) and ``cameras`` (names) are shortcuts for options of the robot; a task may ask for
        larger images than that. ``speed`` of the tool in m/s, for waypoints; ``joint_step`` in radians, what 1 means in
        an action of joint changes. Raises :class:`gvla2.errors.UnknownComponentError` and :class:`ConfigurationError`
        for names and options that do not exist.
        """
        for name, value, known in (
            ("profile", profile, Profile),
            ("control", control, Control),
            ("obs_mode", obs_mode, ObservationMode),
        ):
            if value not in get_args(known):
                raise ConfigurationError(f"{name} is '{value}'; it is one of {', '.join(get_args(known))}.")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigurationError(f"render_mode is '{render_mode}'; it is None or 'rgb_array'.")
        if not 0 < speed <= 1:
            raise ConfigurationError(f"speed is {speed} m/s; it lies above 0 and is 1 at most.")
        if not 0 < joint_step <= 0.5:
            raise ConfigurationError(f"joint_step is {joint_step} rad; it lies above 0 and is 0.5 at most.")
        if isinstance(cameras, str):
            raise ConfigurationError(f"cameras is '{cameras}'; it is a list of names: ['{cameras}'].")
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
                f"cameras of its own and a success check."
            )
        # As composed: recordings of two arms of one robot's name differ in them.
        self.robot_options: Mapping[str, Any] = asdict(registry.configure(root, "robot")[0])
        built = registry.build_all(root, ("robot", "task"))
        self.robot_name = robot
        """As in ``robot=``."""
        self._robot, self._task, self._profile = built["robot"], built["task"], profile
        self._pictures, self._speed, self.render_mode = obs_mode == "rgbd", speed, render_mode
        self._instance: TaskInstance | None = None
        self._stepper: WaypointStepper | JointStepper | None = None
        self._last: Arrays = {}
        self._shown: dict[str, Any] = {}
        self.actions: WaypointActions | JointDeltas
        if control == "waypoint":
            self.actions, (low, high) = WaypointActions(self.arm.workspace), (LOW, HIGH)
        else:
            self.actions = JointDeltas(len(self.arm.home), joint_step)
            low, high = self.actions.bounds
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        try:
            stepper = self._lay_out(0, None)  # the cameras themselves know how large the images are
            shown = picture_space(stepper.seen.views) if self._pictures else body_space()
            self.observation_space = gymnasium.spaces.Dict({**shown, **joint_space(self.arm)})
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
    def shows_pictures(self) -> bool:
        """Whether observations hold what the cameras see."""
        return self._pictures

    @property
    def observation(self) -> Observation:
        """The robot's last observation, in the form that gvla2's perceivers and planners take."""
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
        """Begin an episode: that of ``seed``, or without one the next from the generator seeded last."""
        super().reset(seed=seed)
        chosen = int(self.np_random.integers(2**31)) if seed is None else seed
        unknown = set(options or {}) - {INSTRUCTION}
        if unknown:
            raise ConfigurationError(
                f"reset() knows no option '{min(unknown)}'; it takes '{INSTRUCTION}', a sentence."
            )
        self._instance = self._stepper = None
        self._stepper = self._lay_out(chosen, (options or {}).get(INSTRUCTION))
        self._look(self._stepper)
        return self._last, dict(self._shown)

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Carry out an action, check its success, and observe.

        A simulation that blows up truncates the episode: the last sane observation comes back, and ``info["error"]``
        says what happened.
        """
        stepper = self._running()
        success: dict[str, bool] = {"relaxed": False, "strict": False}
        lost = ""
        try:
            success_check = stepper.step(action)
            success = {"relaxed": success_check.relaxed, "strict": success_check.strict}
            self._look(stepper)
        except SimulationError as error:
            lost = str(error)
        done = success[self._profile]
        info = {**self._shown, **stepper.info, "success": success, "is_success": done}
        if lost:
            info["error"] = lost
        return self._last, float(done), done, bool(lost), info

    def render(self) -> NDArray[np.uint8] | None:
        """The first camera's image (H, W, 3) of the last observation."""
        return None if self.render_mode is None else self.observation.views[0].image.copy()

    def close(self) -> None:
        """Release the simulator; safe to call twice."""
        self._instance = self._stepper = None
        self._robot.close()

    def _lay_out(self, seed: int, instruction: str | None) -> WaypointStepper | JointStepper:
        instance = self._robot.reset(self._task, seed, instruction)
        if instance is None:
            instance = TaskInstance(instruction or "")
        if not self._pictures and not isinstance(self._robot, Truthful):
            raise ConfigurationError(
                f"The robot '{self.robot_name}' does not expose the true state of its world: choose obs_mode='rgbd'."
            )
        if not self._pictures and len(instance.layout.bodies) > MOST_BODIES:
            raise ConfigurationError(
                f"This episode has {len(instance.layout.bodies)} bodies, and obs_mode='state' has room for "
                f"{MOST_BODIES}: ask for fewer distractors, or for obs_mode='rgbd'."
            )
        self._instance, seen = instance, self._robot.observe()
        if isinstance(self.actions, WaypointActions):
            return WaypointStepper(self._robot, self.actions, seen, self._speed)
        return JointStepper(self._robot, self.actions, instance, seen)

    def _running(self) -> WaypointStepper | JointStepper:
        if self._stepper is None:
            raise RobotError("No episode is running: call reset() first.")
        return self._stepper

    def _look(self, stepper: WaypointStepper | JointStepper) -> None:
        """Note the policy's observation and info."""
        assert self._instance is not None
        measured = joint_arrays(stepper.state, self.arm)
        info: dict[str, Any]
        if self._pictures:
            views = stepper.seen.views
            shown, info = picture_arrays(views), {"cameras": cameras(views)}
        else:
            names = [body.name for body in self._instance.layout.bodies]
            shown, info = body_arrays(self._robot.true_state(), names), {"bodies": names}
        self._last = {**shown, **measured}
        self._shown = {INSTRUCTION: self._instance.instruction, **info}
