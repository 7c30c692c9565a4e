"""The environment: one task on one robot, one change of its joints, or their targets, per step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, ClassVar, Literal, get_args

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, RobotError, SimulationError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.gym.actions import JointActions, JointPositions
from gvla2.planning.arm import Arm
from gvla2.plugins.registry import load_plugins
from gvla2.robot.backend import HasTrueState
from gvla2.robot.task import Profile, TaskInstance

INSTRUCTION = "instruction"
MAX_DEPTH = 10.0
"""Metres; anything further away counts as not measured."""
BEYOND = 1.0
"""How far outside the workspace the tool may be seen, metres."""
MOST_STEP = 0.5
"""Largest change of a joint in one action, radians."""
MOST_BODIES = 16
"""Rows for true poses; layouts have four to a dozen bodies, and spaces don't change from one episode to the next."""

Control = Literal["joint_delta", "joint_position"]
ObservationMode = Literal["rgbd", "state"]
Arrays = dict[str, NDArray[Any]]


class TaskEnv(gymnasium.Env[dict[str, Any], NDArray[np.float32]]):
    """A task as a Gymnasium environment.

    ``control="joint_delta"``: an action changes the joints' targets (see :class:`~gvla2.gym.actions.JointActions`), 20
    times a second; ``control="joint_position"``: it is the targets (see :class:`~gvla2.gym.actions.JointPositions`).
    Nothing is planned or checked.

    The observation holds ``tcp`` (7,): x, y, z in metres and the quaternion x, y, z, w (x >= 0), world; ``gripper``
    (1,): width between the fingers, metres; ``joints`` (dof,), radians. With ``obs_mode="rgbd"`` there are ``rgb``
    (C, H, W, 3) uint8 and ``depth`` (C, H, W) float32, metres along each camera's z, 0 where nothing was measured; with
    ``"state"`` instead ``bodies`` (16, 7), the true poses like ``tcp`` in the layout's order, then zeros.

    The reward is 1 when the goal of ``profile`` is reached, which ends the episode, and 0 otherwise.
    ``info`` has the ``instruction`` and the ``cameras`` or the ``bodies``' names, and after a step ``success`` by
    profile, and ``is_success``. :meth:`reset` with ``seed=N`` lays out what ``gvla2 run seed=N`` does, and
    takes the option ``instruction``, a sentence of your own.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 20}

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
        control: Control = "joint_delta",
        obs_mode: ObservationMode = "rgbd",
        joint_step: float = 0.1,
        render_mode: str | None = None,
    ) -> None:
        """Build task and robot by name, with their options as on the command line.

        ``image_size`` (pixels) and ``cameras`` (names) are shortcuts for options of the robot; a task may ask for
        larger images than that. ``joint_step`` in radians is what 1 means in an action of joint changes.
        Raises :class:`gvla2.errors.UnknownComponentError` and :class:`ConfigurationError` for names and options that
        do not exist.
        """
        for name, value, known in (
            ("profile", profile, get_args(Profile)),
            ("control", control, get_args(Control)),
            ("obs_mode", obs_mode, get_args(ObservationMode)),
            ("render_mode", render_mode, (None, "rgb_array")),
        ):
            if value not in known:
                raise ConfigurationError(f"{name} is '{value}'; it is one of {', '.join(map(str, known))}.")
        if not 0 < joint_step <= MOST_STEP:
            raise ConfigurationError(
                f"joint_step is {joint_step}; it lies above 0 and is {MOST_STEP} at most."
            )
        short = {"image_size": image_size, "cameras": None if cameras is None else list(cameras)}
        options = {**(robot_options or {}), **{name: one for name, one in short.items() if one is not None}}
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
        self.robot_name, self.task_name = robot, task
        """As in ``robot=`` and ``task=``."""
        self._robot, self._task, self._profile = built["robot"], built["task"], profile
        self.shows_pictures, self.render_mode = obs_mode == "rgbd", render_mode
        self._instance: TaskInstance | None = None
        self._last: Arrays = {}
        self._shown: dict[str, Any] = {}
        try:
            self.actions = (
                JointActions(self._robot, joint_step)
                if control == "joint_delta"
                else JointPositions(self._robot)
            )
            self.action_space = self.actions.space
            self._lay_out(0, None)  # the cameras themselves know how large the images are
            self.observation_space = gymnasium.spaces.Dict(self._spaces())
        except BaseException:
            self.close()
            raise
        self._instance = None

    @property
    def arm(self) -> Arm:
        """Kinematics and collision model of the robot."""
        arm: Arm = self._robot.arm
        return arm

    @property
    def observation(self) -> Observation:
        """The robot's last observation, in the form that gvla2's perceivers and planners take."""
        self._running()
        return self.actions.seen

    @property
    def instruction(self) -> str:
        """The episode's sentence."""
        return self._running().instruction

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
        self._lay_out(chosen, (options or {}).get(INSTRUCTION))
        self._look()
        return self._last, dict(self._shown)

    def step(self, action: ArrayLike) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Carry out an action, check its success, and observe.

        A simulation that blows up truncates the episode: the last sane observation comes back, and ``info["error"]``
        says what happened.
        """
        self._running()
        success: dict[str, bool] = {"relaxed": False, "strict": False}
        error: dict[str, str] = {}
        try:
            success_check = self.actions.step(action)
            success = {"relaxed": success_check.relaxed, "strict": success_check.strict}
            self._look()
        except SimulationError as lost:
            error = {"error": str(lost)}
        done = success[self._profile]
        info = {**self._shown, "success": success, "is_success": done, **error}
        return self._last, float(done), done, bool(error), info

    def render(self) -> NDArray[np.uint8] | None:
        """The first camera's image (H, W, 3) of the last observation."""
        return None if self.render_mode is None else self.observation.views[0].image.copy()

    def close(self) -> None:
        """Release the simulator; safe to call twice."""
        self._instance = None
        self._robot.close()

    def _lay_out(self, seed: int, instruction: str | None) -> None:
        self._instance = None
        instance = self._robot.reset(self._task, seed, instruction) or TaskInstance(instruction or "")
        if not self.shows_pictures and not isinstance(self._robot, HasTrueState):
            raise ConfigurationError(
                f"The robot '{self.robot_name}' does not expose the true state of its world: choose obs_mode='rgbd'."
            )
        if not self.shows_pictures and len(instance.layout.bodies) > MOST_BODIES:
            raise ConfigurationError(
                f"This episode has {len(instance.layout.bodies)} bodies, and obs_mode='state' has room for "
                f"{MOST_BODIES}: ask for fewer distractors, or for obs_mode='rgbd'."
            )
        self.actions.begin(self._robot.observe())
        self._instance = instance

    def _running(self) -> TaskInstance:
        if self._instance is None:
            raise RobotError("No episode is running: call reset() first.")
        return self._instance

    def _spaces(self) -> dict[str, Box]:
        """The spaces of the observation's arrays.

        Raises :class:`ConfigurationError` when the cameras' images differ in size: they come as one array.
        """
        box, hand = self.arm.workspace, self.arm.hand
        low, high = np.full(7, -1.0, np.float32), np.ones(7, np.float32)
        low[:3], high[:3] = box.low - BEYOND, box.high + BEYOND
        found = {
            "tcp": Box(low, high),
            "gripper": Box(0.0, 2.0 * hand.max_width, (1,), np.float32),
            "joints": Box(-2.0 * np.pi, 2.0 * np.pi, (len(self.arm.home),), np.float32),
        }
        if not self.shows_pictures:
            return {"bodies": Box(-np.inf, np.inf, (MOST_BODIES, 7), np.float32), **found}
        views = self.actions.seen.views
        sizes = {view.image.shape[:2] for view in views}
        if len(sizes) > 1:
            named = ", ".join(f"{v.name} {v.image.shape[1]}x{v.image.shape[0]}" for v in views)
            raise ConfigurationError(
                f"The cameras see in different sizes ({named}): choose those of one size with cameras=[...]."
            )
        shape = (len(views), *sizes.pop())
        rgb, depth = Box(0, 255, (*shape, 3), np.uint8), Box(0.0, MAX_DEPTH, shape, np.float32)
        return {"rgb": rgb, "depth": depth, **found}

    def _look(self) -> None:
        """Note the policy's observation, in new arrays, and info."""
        instance, state = self._running(), self.actions.state
        shown: Arrays
        info: dict[str, Any]
        if self.shows_pictures:
            views = self.actions.seen.views
            shown = {"rgb": np.stack([v.image for v in views]), "depth": np.stack([_depth(v) for v in views])}
            lenses = {v.name: (v.camera.K.copy(), v.camera.world_from_camera.copy()) for v in views}
            info = {
                "cameras": {
                    n: {"intrinsics": K, "world_from_camera": pose} for n, (K, pose) in lenses.items()
                }
            }
        else:
            truth, names = self._robot.true_state(), [body.name for body in instance.layout.bodies]
            bodies = np.zeros((MOST_BODIES, 7), dtype=np.float32)
            bodies[: len(names)] = np.reshape([_pose(truth.pose(name)) for name in names], (-1, 7))
            shown, info = {"bodies": bodies}, {"bodies": names}
        self._last = {
            **shown,
            "tcp": _pose(self.arm.forward(state.joints)),
            "gripper": np.array([max(0.0, state.gripper_width)], dtype=np.float32),
            "joints": np.asarray(state.joints).astype(np.float32),
        }
        self._shown = {INSTRUCTION: instance.instruction, **info}


def _pose(world_from_frame: FloatArray) -> NDArray[np.float32]:
    turn = Rotation.from_matrix(world_from_frame[:3, :3]).as_quat()
    # Not w: it is near 0 for every hand that points down, so its sign would flip back and forth.
    turn = -turn if turn[0] < 0 else turn
    return np.concatenate([world_from_frame[:3, 3], np.clip(turn, -1.0, 1.0)]).astype(np.float32)


def _depth(view: View) -> NDArray[np.float32]:
    if view.depth is None:
        return np.zeros(view.image.shape[:2], dtype=np.float32)
    with np.errstate(invalid="ignore"):
        measured = (view.depth > 0) & (view.depth <= MAX_DEPTH)
    return np.where(measured, view.depth, 0).astype(np.float32)
