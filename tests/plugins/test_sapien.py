"""The simulated Panda and its world, with real physics: reset, cameras, success check, what goes wrong; motions."""

import numpy as np
import pytest

from gvla2.errors import ConfigurationError, RobotError
from gvla2.geometry.transform import rigid, transform_points
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint, grasp_rotation
from gvla2.robot.backend import ExecutionListener
from gvla2.robot.task import Body, Primitive, TaskInstance
from gvla2.robot.timing import MotionLimits, time_path
from gvla2_plugins.sapien import SapienPandaConfig, gvla2_robots
from gvla2_plugins.sapien.backend import SapienArm
from gvla2_plugins.sapien.driver import SapienDriver
from gvla2_plugins.tabletop import gvla2_tasks
from tests.plugins.tabletop_layouts import Laid

TABLE_HEIGHT = SapienPandaConfig().table_height

DOWN = np.array([0.0, 0.0, -1.0])
TASKS = {c.name: c.build(c.config()) for c in gvla2_tasks()}


@pytest.fixture(scope="module")
def panda():
    component = gvla2_robots()[0]
    robot = component.build(SapienPandaConfig(image_size=128))
    yield robot
    robot.close()


def driver(panda: SapienArm) -> SapienDriver:
    return SapienDriver(panda._world, panda._config, panda.arm.hand.max_width)


@pytest.mark.parametrize("name", TASKS)
def test_bodies_rest_where_they_were_laid_and_nothing_is_done_yet(panda, name):
    for seed in (0, 1):
        instance = panda.reset(TASKS[name], seed)
        before = {b.name: panda._world.pose(b.name) for b in instance.layout.bodies}
        for body in instance.layout.bodies:
            np.testing.assert_allclose(before[body.name], body.world_from_body, atol=1e-3)
        verdict = panda.success_check()
        assert (verdict.relaxed, verdict.strict) == (False, False)
        for body in instance.layout.bodies:  # and a quarter of a second later still
            np.testing.assert_allclose(panda._world.pose(body.name), before[body.name], atol=2e-4)


# Cameras


def test_depth_is_that_of_the_cubes_tops(panda):
    instance = panda.reset(TASKS["pick_and_lift"], 3)
    views = panda.observe().views
    assert [v.name for v in views] == ["front", "left_shoulder", "right_shoulder", "wrist"]
    measured = 0
    for body in instance.layout.bodies:
        top = body.world_from_body[:3, 3] + (0, 0, 0.025)
        for view in views:
            uv, depth = view.camera.project(top)
            if not view.camera.inside(uv):
                continue
            u, v = (int(c) for c in uv)
            seen = view.points()[v, u]
            if view.robot_mask[v, u] or abs(view.depth[v, u] - depth) > 0.02:
                continue  # something stands before it
            assert seen[2] == pytest.approx(TABLE_HEIGHT + 0.05, abs=1e-3)
            colour = view.image[v, u] / 255
            hue = np.array(body.solids[0].rgb)
            assert np.abs(colour - hue * colour.max() / max(hue.max(), 1e-9)).max() < 0.1 or not hue.any()
            measured += 1
    assert measured >= 6


def test_the_robots_own_pixels_are_known_and_only_those(panda):
    instance = panda.reset(TASKS["pick_and_lift"], 3)
    seen = panda.observe()
    shares = {}
    for view in seen.views:
        points = view.points()
        assert not np.isnan(view.depth[view.robot_mask]).any()
        assert (points[view.robot_mask][:, 2] > TABLE_HEIGHT - 0.005).all()
        shares[view.name] = view.robot_mask.mean()
        for body in instance.layout.bodies:
            top = transform_points(np.linalg.inv(body.world_from_body), points)
            on_cube = (np.abs(top) < 0.0251).all(axis=-1)
            assert not (on_cube & view.robot_mask).any()
    assert 0.02 < shares["front"] < 0.3
    assert 0.1 < shares["left_shoulder"] < 0.6
    assert 0.001 < shares["wrist"] < 0.2  # the fingertips


# What goes wrong


def test_a_simulation_that_blows_up_is_noticed_and_the_next_one_is_clean(panda):
    panda.reset(TASKS["pick_and_lift"], 0)
    drive = driver(panda)
    panda._world._movers[0].set_linear_velocity((0.0, 0.0, 1000.0))
    result = drive.follow(np.tile(panda.arm.home, (100, 1)), 1 / 60, 1.0)
    assert result.diverged
    assert panda._world.time < 0.1  # broken off at once
    panda._world._robot.set_qpos(np.full(9, np.nan, dtype=np.float32))
    drive.hold()
    for look in (panda.observe, panda.success_check):
        with pytest.raises(RobotError, match="blown up"):
            look()
    panda.reset(TASKS["pick_and_lift"], 0)
    np.testing.assert_allclose(panda.observe().joints, panda.arm.home, atol=1e-4)
    assert not panda.success_check().relaxed


def test_nothing_works_before_reset_or_after_close():
    robot = gvla2_robots()[0].build(SapienPandaConfig())
    for _ in range(2):
        with pytest.raises(RobotError, match="reset"):
            robot.observe()
        with pytest.raises(RobotError, match="reset"):
            robot.execute(Trajectory(()), Scene((), TABLE_HEIGHT, robot.arm.workspace))
        assert robot.success_check() is None
        robot.close()
    robot.reset(None, 0)
    assert robot.observe().gripper > 0.9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cameras": ["front", "top"]}, "front, left_shoulder, right_shoulder, wrist"),
        ({"cameras": []}, "one or more"),
        ({"cameras": ["wrist", "wrist"]}, "different"),
        ({"image_size": 0}, "image_size is 0; it must be from 1 to 8192 pixels"),
        ({"physics_rate": -1}, "physics_rate is -1"),
    ],
)
def test_senseless_options_are_refused(options, message):
    with pytest.raises(ConfigurationError, match=message):
        gvla2_robots()[0].build(SapienPandaConfig(**options))


# Motions, by the driver


def above(xyz, closing, up=0.0) -> np.ndarray:
    """Tool pose (4, 4) pointing down, ``up`` metres above ``xyz``."""
    return rigid(grasp_rotation(DOWN, np.asarray(closing)), np.add(xyz, (0, 0, up)))


def move(panda: SapienArm, drive: SapienDriver, pose, gripper, speed=0.25, straight=True):
    joints = drive.state().joints
    path = panda.arm.line(joints, pose) if straight else [joints, panda.arm.inverse(pose, joints).joints]
    assert path is not None
    limits = MotionLimits(0.7 * panda.arm.velocity_limits, np.full(7, 5.0), speed)
    result = drive.follow(
        time_path(np.array(path), 1 / 60, limits, panda.arm.tool_positions), 1 / 60, gripper
    )
    reached = panda.arm.forward(drive.state().joints)[:3, 3]
    return result, float(np.linalg.norm(reached - pose[:3, 3]))


def target_cube(instance: TaskInstance) -> Body:
    (colour,) = colours_in(instance.instruction)
    return next(b for b in instance.layout.bodies if b.solids[0].rgb == COLOURS[colour])


def test_joint_moves_track_their_samples(panda):
    panda.reset(None, 0)
    drive = driver(panda)
    goal = panda.arm.home + np.array([0.5, 0.3, -0.3, -0.8, 0.2, 0.6, 0.5])
    share = np.linspace(0.0, 1.0, 121)[:, None] ** 2 * (3 - 2 * np.linspace(0.0, 1.0, 121)[:, None])
    samples = panda.arm.home + share * (goal - panda.arm.home)
    seen = []
    step = panda._world.step
    panda._world.step = lambda: (step(), seen.append(panda._world.joints))
    result = drive.follow(samples, 1 / 60, 1.0)
    reached = np.array([panda.arm.forward(q)[:3, 3] for q in seen[3 : 4 * 120 : 4]])
    wanted = np.array([panda.arm.forward(q)[:3, 3] for q in samples[1:]])
    assert np.linalg.norm(reached - wanted, axis=1).max() < 0.005
    assert np.abs(drive.state().joints - goal).max() < 1e-3
    assert not result.contacts
    assert not result.diverged
    assert np.linalg.norm(panda.arm.forward(drive.state().joints)[:3, 3] - wanted[-1]) < 0.001


@pytest.mark.parametrize(("seed", "scale", "off"), [(0, 1.0, 0.0), (2, 1.2, 0.008)])
def test_a_grasped_cube_is_lifted_and_stays(panda, seed, scale, off):
    component = next(c for c in gvla2_tasks() if c.name == "pick_and_lift")
    instance = panda.reset(component.build(component.config(scale=scale)), seed)
    size = 0.05 * scale
    body = target_cube(instance)
    place, closing = body.world_from_body[:3, 3], body.world_from_body[:3, 1]
    place = place + closing * off  # the hand is beside the cube's middle: the fingers centre it
    drive = driver(panda)
    move(panda, drive, above(place, closing, 0.12), 1.0, straight=False)
    move(panda, drive, above(place, closing), 1.0)
    grip = drive.grip(0.0)
    assert grip.held
    assert grip.width == pytest.approx(size, abs=0.001)
    assert set(grip.contacts) == {"panda_leftfinger", "panda_rightfinger"}
    result, error = move(panda, drive, above(place, closing, 0.24), 0.0)
    assert error < 0.005
    assert "panda_hand" not in result.contacts
    verdict = panda.success_check()
    assert (verdict.relaxed, verdict.strict) == (True, True)
    lifted = panda._world.pose(body.name)
    assert lifted[2, 3] - body.world_from_body[2, 3] == pytest.approx(0.24, abs=0.004)
    drive.grip(1.0)  # let go: it falls, and does not count as held any more
    for _ in range(240):
        panda._world.step()
    assert panda._world.pose(body.name)[2, 3] < TABLE_HEIGHT + size
    assert not panda.success_check().strict


def test_the_same_seed_is_the_same_episode_to_the_bit():
    def episode():
        robot = gvla2_robots()[0].build(SapienPandaConfig(image_size=64))
        instance = robot.reset(TASKS["push_block"], 7)
        block = instance.layout.bodies[0].world_from_body
        drive = driver(robot)
        drive.grip(0.0)
        move(robot, drive, above(block[:3, 3], block[:3, 1], 0.06), 0.0, straight=False)
        move(robot, drive, above(block[:3, 3], block[:3, 1], 0.03), 0.0)  # presses on the block
        seen = robot.observe()
        pose = robot._world.pose("block")
        robot.close()
        return instance.instruction, seen, pose

    one, two = episode(), episode()
    assert one[0] == two[0]
    np.testing.assert_array_equal(one[1].joints, two[1].joints)
    np.testing.assert_array_equal(one[2], two[2])
    for a, b in zip(one[1].views, two[1].views, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.depth, b.depth)


# Through the core's executor


def empty_scene(panda) -> Scene:
    return Scene((), TABLE_HEIGHT, panda.arm.workspace)


def test_execute_reports_waypoints_and_shows_pictures(panda):
    panda.reset(None, 0)
    down = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    plan = Trajectory(
        (
            Waypoint((0.35, 0.1, 1.0), 1.0, "approach", down),
            Waypoint((0.35, 0.1, 0.9), 0.0, "down", motion="linear"),
        )
    )
    pictures, reports = [], []
    report = panda.execute(plan, empty_scene(panda), ExecutionListener(pictures.append, reports.append))
    assert report.completed
    assert reports == list(report.waypoints)
    assert max(w.error for w in report.waypoints) < 0.005
    assert report.waypoints[1].gripper_width < 0.001
    assert report.waypoints[1].contacts == ()
    seconds = sum(w.motion_seconds for w in report.waypoints)
    assert len(pictures) >= 5 * seconds
    assert pictures[0].shape == (320, 320, 3)
    assert np.abs(pictures[0].astype(int) - pictures[-1]).max() > 50


def test_a_listener_that_raises_stops_the_arm(panda):
    panda.reset(None, 0)

    def stop(image):
        raise KeyboardInterrupt

    plan = Trajectory((Waypoint((0.35, 0.1, 1.0), 1.0, "a"), Waypoint((0.35, 0.1, 0.9), 1.0, "b")))
    with pytest.raises(KeyboardInterrupt):
        panda.execute(plan, empty_scene(panda), ExecutionListener(frame=stop))
    assert np.abs(panda._world.joint_speeds).max() < 0.02
    assert panda.observe() is not None


@pytest.mark.parametrize(("asked", "fps"), [(5.0, 5.0), (20.0, 20.0), (25.0, 24.0)])
def test_frames_are_evenly_spaced_over_motions_and_grips(asked, fps):
    """25 frames a second are 24: a period is a whole number of the 240 steps of physics."""
    panda = gvla2_robots()[0].build(SapienPandaConfig(video_fps=asked, video_size=32))
    panda.reset(None, 0)
    times = []
    heard = ExecutionListener(moment=lambda moment: times.append(moment.time))
    for height in (1.0, 0.9):  # two executions of one episode
        plan = Trajectory((Waypoint((0.35, 0.1, height), 1.0, "a"), Waypoint((0.35, 0.1, height), 0.0, "b")))
        report = panda.execute(plan, empty_scene(panda), heard)
        assert report.completed, report.abort
    np.testing.assert_allclose(np.diff(times), 1.0 / fps)
    assert times[-1] > panda._world.time - 1.0 / fps
    # Both close on nothing, for .8 s and until they are still, and it is counted.
    assert 0.8 < report.waypoints[1].motion_seconds < 1.2


@pytest.mark.parametrize("guard", [Guard(force=20.0), Guard(stall=0.003)], ids=["force", "stall"])
def test_the_hand_stops_on_what_does_not_give_way(panda, guard):
    solid = Primitive("box", (0.05, 0.05, 0.05), (0.1, 0.2, 0.8))
    panda.reset(Laid(Body("block", (solid,), rigid(translation=(0.3, 0.0, TABLE_HEIGHT + 0.025)), 0.356)), 0)
    met = TABLE_HEIGHT + 0.05 + panda.arm.hand.tip_beyond_tcp
    down = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
    steps = (
        Waypoint((0.3, 0.0, met + 0.05), 0.0, "approach", down),
        Waypoint((0.3, 0.0, met - 0.015), 0.0, "press", motion="linear", speed=0.05, guard=guard),
        Waypoint((0.3, 0.0, met + 0.05), 0.0, "retreat", motion="linear", guard=Guard(force=25.0)),
    )
    report = panda.execute(Trajectory(steps), Scene((), TABLE_HEIGHT - 0.2, panda.arm.workspace))
    assert report.completed, report.abort
    pressed, back = report.waypoints[1:]
    assert pressed.status == "guarded"
    assert pressed.message
    assert abs(pressed.reached[2] - met) < 0.004
    if guard.force:
        assert 20.0 < pressed.force < 60.0
    assert back.status == "linear"  # in the open nothing is felt
    assert back.error < 0.002
