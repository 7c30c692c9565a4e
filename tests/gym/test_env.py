"""Tasks through Gymnasium's interface, in the real simulator."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gvla2.gym  # noqa: F401 - registers the environments
from gvla2.errors import ConfigurationError, Gvla2Error, RobotError, UnknownComponentError
from gvla2.geometry.transform import rigid
from gvla2.gym.env import TaskEnv
from gvla2.plugins.registry import Registry

DOWN = np.diag([1.0, -1.0, -1.0])
STILL = np.array([0.0] * 7 + [1.0], np.float32)
"""The action that changes no joint and keeps the hand open."""
SMALL = {"image_size": 48, "cameras": ["front"]}


@pytest.fixture(scope="module")
def small():
    """One small environment for all tests that only look at what a step does."""
    env = gymnasium.make("gvla2/pick_and_lift-v0", render_mode="rgb_array", **SMALL)
    yield env
    env.close()


def test_it_passes_gymnasiums_own_check():
    env = gymnasium.make("gvla2/put_block-v0", image_size=32, cameras=["front", "wrist"])
    check_env(env.unwrapped)  # its warnings are errors here
    env.close()


def test_the_observation_is_what_the_cameras_and_joints_measure(small):
    observation, info = small.reset(seed=4)
    seen = small.unwrapped.observation
    assert observation["rgb"].shape == (1, 48, 48, 3)
    np.testing.assert_array_equal(observation["rgb"][0], seen.views[0].image)
    depth = np.nan_to_num(seen.views[0].depth)
    np.testing.assert_array_equal(observation["depth"][0], depth)
    assert (depth == 0).any()  # past the table there is nothing
    np.testing.assert_allclose(observation["tcp"][:3], seen.world_from_tcp[:3, 3], atol=1e-6)
    np.testing.assert_allclose(observation["joints"], small.unwrapped.arm.home, atol=1e-3)
    assert observation["gripper"][0] == pytest.approx(seen.gripper_width)
    camera = info["cameras"]["front"]
    np.testing.assert_array_equal(camera["intrinsics"], seen.views[0].camera.K)
    np.testing.assert_array_equal(camera["world_from_camera"], seen.views[0].camera.world_from_camera)
    assert info["instruction"] == small.unwrapped.instruction
    np.testing.assert_array_equal(small.render(), seen.views[0].image)


def test_the_seed_decides_the_episode(small):
    first, info = small.reset(seed=7)
    small.reset(seed=8)
    again, same = small.reset(seed=7)
    assert all(np.array_equal(first[key], again[key]) for key in first)
    assert info["instruction"] == same["instruction"]
    following, _ = small.reset()
    assert not np.array_equal(following["rgb"], first["rgb"])
    small.reset(seed=7)
    assert np.array_equal(small.reset()[0]["rgb"], following["rgb"])


def test_the_seed_is_that_of_a_run(small, compose_run, registry: Registry):
    observation, info = small.reset(seed=11)
    config = compose_run("task=pick_and_lift", "robot.image_size=48", "robot.cameras=[front]")
    parts = registry.build_all(config, ("robot", "task"))
    instance = parts["robot"].reset(parts["task"], 11)
    assert instance.instruction == info["instruction"]
    np.testing.assert_array_equal(parts["robot"].observe().views[0].image, observation["rgb"][0])
    parts["robot"].close()


def test_a_sentence_of_your_own(small):
    before, _ = small.reset(seed=3)
    after, info = small.reset(seed=3, options={"instruction": "hoist something"})
    assert info["instruction"] == "hoist something"
    assert np.array_equal(before["rgb"], after["rgb"])
    with pytest.raises(ConfigurationError, match="no option 'sentence'"):
        small.reset(options={"sentence": "hoist"})


def test_a_simulation_that_blows_up_truncates_the_episode(small):
    before, _ = small.reset(seed=0)
    robot = small.unwrapped._robot
    robot._world._robot.set_qpos(np.full(9, np.nan, dtype=np.float32))
    after, reward, terminated, truncated, info = small.step(STILL)
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert "blown up" in info["error"]
    assert all(np.array_equal(before[key], after[key]) for key in before)
    clean, _ = small.reset(seed=0)
    assert all(np.array_equal(before[key], clean[key]) for key in before)


def test_nothing_happens_before_reset(small):
    env = TaskEnv("pick_and_lift", **SMALL)
    for ask in (lambda: env.step(STILL), lambda: env.observation, lambda: env.instruction):
        with pytest.raises(RobotError, match=r"call reset\(\) first"):
            ask()
    env.close()
    env.close()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"task": "put_blok"}, UnknownComponentError, "Did you mean 'put_block'"),
        ({"robot": "sapien_pand"}, UnknownComponentError, "Did you mean 'sapien_panda'"),
        ({"robot": "piper"}, ConfigurationError, "takes a simulated robot"),
        ({"cameras": ["frnt"]}, ConfigurationError, "front, left_shoulder"),
        ({"task_options": {"scale": 2}}, ConfigurationError, "from 0.8 to 1.2"),
        ({"robot_options": {"imag_size": 8}}, ConfigurationError, "imag_size"),
        ({"profile": "kind"}, ConfigurationError, "relaxed, strict"),
        ({"joint_step": 2}, ConfigurationError, "joint_step is 2"),
        ({"control": "waypoint"}, ConfigurationError, "joint_delta, joint_position"),
        ({"obs_mode": "depth"}, ConfigurationError, "rgbd, state"),
        ({"render_mode": "human"}, ConfigurationError, "rgb_array"),
    ],
)
def test_wrong_choices_are_errors(options, error, words):
    with pytest.raises(error, match=words) as caught:
        TaskEnv(**{"task": "put_block", **options})
    assert isinstance(caught.value, Gvla2Error)


@pytest.mark.parametrize("bad", [STILL[:7], [*STILL[:7], np.nan], [STILL], [np.inf] * 8])
def test_an_action_of_another_shape_or_not_finite_is_refused(small, bad):
    small.reset(seed=0)
    with pytest.raises(RobotError, match="8 finite numbers"):
        small.unwrapped.step(bad)


@pytest.fixture(scope="module")
def driven():
    env = gymnasium.make("gvla2/put_block-v0", obs_mode="state", **SMALL)
    yield env
    env.close()


def test_the_state_holds_true_poses_and_no_pictures(driven):
    observation, info = driven.reset(seed=2)
    assert set(observation) == {"bodies", "tcp", "gripper", "joints"}
    state = driven.unwrapped._robot.true_state()
    for row, name in zip(observation["bodies"], info["bodies"], strict=False):
        np.testing.assert_allclose(row[:3], state.pose(name)[:3, 3], atol=1e-6)
    assert (observation["bodies"][len(info["bodies"]) :] == 0).all()


def test_twenty_actions_are_a_second_and_move_the_joints(driven):
    before, _ = driven.reset(seed=2)
    turn = np.array([0.2, 0, 0, 0, 0, 0, -0.3, 0.5], dtype=np.float32)
    started = driven.unwrapped._robot._world.time
    for _ in range(20):
        after, reward, terminated, truncated, info = driven.step(turn)
    assert driven.unwrapped._robot._world.time - started == pytest.approx(1.0, abs=0.01)
    moved = after["joints"] - before["joints"]
    np.testing.assert_allclose(moved[[0, 6]], (0.4, -0.6), atol=0.03)  # it lags its targets a little
    np.testing.assert_allclose(moved[1:6], 0, atol=0.02)
    assert after["gripper"][0] == pytest.approx(0.04, abs=2e-3)
    assert (reward, terminated, truncated, info["is_success"]) == (0.0, False, False, False)


def test_a_task_is_solved_by_changes_of_the_joints(driven):
    """Through inverse kinematics: what a policy would have to learn."""
    env = driven
    observation, info = env.reset(seed=1)
    raw = env.unwrapped
    names = info["bodies"]
    block, goal = (
        observation["bodies"][next(i for i, n in enumerate(names) if word in n)][:3]
        for word in ("block", "target")
    )
    stages = [(block, 0.12, 1.0), (block, 0.0, 1.0), (block, 0.0, 0.0), (block, 0.15, 0.0)]
    stages += [(goal, 0.15, 0.0), (goal, 0.045, 0.0), (goal, 0.045, 1.0), (goal, 0.2, 1.0)]
    for point, above, opening in stages:
        joints = raw.arm.inverse(rigid(DOWN, point + np.array([0, 0, above])), observation["joints"]).joints
        for _ in range(25):
            change = np.clip((joints - observation["joints"]) / 0.1, -1, 1)
            observation, reward, terminated, *_ = env.step(np.append(change, opening))
            if terminated:
                assert reward == 1.0
                return
    pytest.fail("the block is not on its target")
