"""The simulated Panda, with real physics, real cameras and the core's own executor."""

import sys

import numpy as np
import pytest
from gvla2_plugins.sapien_panda import SapienPandaConfig, gvla2_robots
from gvla2_plugins.sapien_panda.backend import SapienPanda
from gvla2_plugins.sapien_panda.driver import SapienDriver
from gvla2_plugins.sapien_panda.world import TABLE_HEIGHT
from gvla2_plugins.tabletop import gvla2_tasks

from gvla2.errors import ConfigurationError, MissingDependencyError, RobotError
from gvla2.geometry.transform import rigid, transform_points
from gvla2.planning.colours import COLOURS, colours_in
from gvla2.planning.scene import Scene, SceneObject
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint, grasp_rotation
from gvla2.robot.backend import ExecutionListener
from gvla2.robot.task import Body, Joint, Layout, Primitive, TaskInstance
from gvla2.robot.timing import MotionLimits, time_path

DOWN = np.array([0.0, 0.0, -1.0])
TASKS = {c.name: c.build(c.config()) for c in gvla2_tasks()}


@pytest.fixture(scope="module")
def panda():
    (component,) = gvla2_robots()
    robot = component.build(SapienPandaConfig(image_size=128))
    yield robot
    robot.close()


def driver(panda: SapienPanda) -> SapienDriver:
    return SapienDriver(panda._world, panda._config, panda.arm.hand.max_width)


def above(xyz, closing, up=0.0) -> np.ndarray:
    """Tool pose (4, 4) pointing down, ``up`` metres above ``xyz``."""
    return rigid(grasp_rotation(DOWN, np.asarray(closing)), np.add(xyz, (0, 0, up)))


def move(panda: SapienPanda, drive: SapienDriver, pose, gripper, speed=0.25, straight=True):
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


class Laid:
    """A task that is just a layout."""

    instructions = ("a", "b", "c", "d")

    def __init__(self, *bodies: Body, joints: tuple[Joint, ...] = ()):
        self.layout = Layout(bodies, joints)

    def sample(self, rng, site, instruction=None):
        never = {"eased": lambda world: False, "strict": lambda world: False}
        return TaskInstance(self.layout, "-", never)


def cube(name: str, xyz, size=0.05, **more) -> Body:
    return Body(name, (Primitive("box", (size,) * 3, COLOURS["blue"]),), rigid(translation=xyz), **more)


# Reset


@pytest.mark.parametrize("name", TASKS)
def test_bodies_rest_where_they_were_laid_and_nothing_is_done_yet(panda, name):
    for seed in (0, 1):
        instance = panda.reset(TASKS[name], seed)
        before = {b.name: panda._world.body_pose(b.name) for b in instance.layout.bodies}
        for body in instance.layout.bodies:
            np.testing.assert_allclose(before[body.name], body.world_from_body, atol=1e-3)
        verdict = panda.judge()
        assert (verdict.eased, verdict.strict) == (False, False)
        for body in instance.layout.bodies:  # and a quarter of a second later still
            np.testing.assert_allclose(panda._world.body_pose(body.name), before[body.name], atol=2e-4)


def test_the_arm_starts_at_home_with_an_open_hand(panda):
    panda.reset(None, 0)
    seen = panda.observe()
    np.testing.assert_allclose(seen.joints, panda.arm.home, atol=1e-4)
    np.testing.assert_allclose(seen.world_from_tcp, panda.arm.forward(panda.arm.home), atol=1e-3)
    assert seen.gripper == pytest.approx(1.0, abs=1e-3)
    assert seen.gripper_width == pytest.approx(0.08, abs=1e-4)
    assert panda.judge() is None


def test_the_model_of_the_arm_agrees_with_the_simulated_one(panda):
    panda.reset(None, 0)
    hand = panda._world.link_poses(["panda_hand_tcp"])["panda_hand_tcp"]
    np.testing.assert_allclose(hand, panda.arm.forward(panda._world.joints), atol=1e-5)


def test_the_same_seed_is_the_same_episode_to_the_bit():
    def episode():
        robot = SapienPanda(SapienPandaConfig(image_size=64))
        instance = robot.reset(TASKS["push_block"], 7)
        block = instance.layout.bodies[0].world_from_body
        drive = driver(robot)
        drive.grip(0.0)
        move(robot, drive, above(block[:3, 3], block[:3, 1], 0.06), 0.0, straight=False)
        move(robot, drive, above(block[:3, 3], block[:3, 1], 0.03), 0.0)  # presses on the block
        seen = robot.observe()
        pose = robot._world.body_pose("block")
        robot.close()
        return instance.instruction, seen, pose

    one, two = episode(), episode()
    assert one[0] == two[0]
    np.testing.assert_array_equal(one[1].joints, two[1].joints)
    np.testing.assert_array_equal(one[2], two[2])
    for a, b in zip(one[1].views, two[1].views, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.depth, b.depth)


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


def test_views_are_calibrated_with_each_other_and_hold_the_table(panda):
    panda.reset(None, 0)
    for view in panda.observe().views:
        assert view.image.dtype == np.uint8
        assert view.depth.dtype == np.float32
        points = view.points()[np.isfinite(view.depth) & ~view.robot_mask]
        assert len(points) > 1000
        on_top = np.abs(points[:, 2] - TABLE_HEIGHT) < 1e-3
        assert on_top.mean() > 0.98  # the rest is the table's rim


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


def test_the_wrist_camera_goes_with_the_hand(panda):
    panda.reset(None, 0)
    before = panda.observe()
    move(panda, driver(panda), above((0.35, 0.1, 1.1), (0, 1, 0)), 1.0, straight=False)
    after = panda.observe()
    np.testing.assert_array_equal(before.views[0].camera.position, after.views[0].camera.position)

    def in_hand(seen):
        return np.linalg.inv(seen.world_from_tcp) @ seen.views[3].camera.world_from_camera

    np.testing.assert_allclose(in_hand(before), in_hand(after), atol=1e-9)
    assert np.nanmedian(after.views[3].depth) < np.nanmedian(before.views[3].depth) - 0.2


# Motion


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
    assert result.tracking_error < 1e-3
    assert not result.contacts
    assert not result.diverged
    assert np.linalg.norm(panda.arm.forward(drive.state().joints)[:3, 3] - wanted[-1]) < 0.001


def test_the_fingers_open_and_close_and_hold_nothing_in_the_air(panda):
    panda.reset(None, 0)
    drive = driver(panda)
    closed = drive.grip(0.0)
    assert closed.width < 0.001
    assert not closed.held
    half = drive.grip(0.5)
    assert half.width == pytest.approx(0.04, abs=0.001)
    assert not half.held
    assert drive.grip(1.0).width == pytest.approx(0.08, abs=0.001)


@pytest.mark.parametrize(("seed", "size", "mass", "off"), [(0, 0.05, 0.125, 0.0), (2, 0.06, 0.25, 0.008)])
def test_a_grasped_cube_is_lifted_and_stays(panda, seed, size, mass, off):
    component = next(c for c in gvla2_tasks() if c.name == "pick_and_lift")
    instance = panda.reset(component.build(component.config(size=size, mass=mass)), seed)
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
    verdict = panda.judge()
    assert (verdict.eased, verdict.strict) == (True, True)
    lifted = panda._world.body_pose(body.name)
    assert lifted[2, 3] - body.world_from_body[2, 3] == pytest.approx(0.24, abs=0.004)
    drive.grip(1.0)  # let go: it falls, and does not count as held any more
    for _ in range(240):
        panda._world.step()
    assert panda._world.body_pose(body.name)[2, 3] < TABLE_HEIGHT + size
    assert not panda.judge().strict


def test_a_pressed_button_comes_back_and_its_peak_stays(panda):
    instance = panda.reset(TASKS["lamp_on"], 1)
    lamp, button = instance.layout.bodies
    tip = panda.arm.hand.tip_beyond_tcp
    top = button.world_from_body[:3, 3] + (0, 0, 0.007 + tip)
    closing = lamp.world_from_body[:3, 1]
    drive, world = driver(panda), panda._world
    drive.grip(0.0)
    move(panda, drive, above(top, closing, 0.06), 0.0, straight=False)
    assert world.travel("press") == pytest.approx(0.0, abs=1e-4)  # it carries its own weight
    pressed, _ = move(panda, drive, above(top, closing, -0.009), 0.0, speed=0.05)
    assert {"panda_leftfinger", "panda_rightfinger"} & set(pressed.contacts)
    assert world.travel("press") == pytest.approx(0.009, abs=0.0015)
    moved = button.world_from_body[2, 3] - world.body_pose("button")[2, 3]
    assert moved == pytest.approx(world.travel("press"), abs=1e-4)
    move(panda, drive, above(top, closing, 0.06), 0.0)
    assert world.travel("press") == pytest.approx(0.0, abs=2e-4)
    assert 0.0075 < world.peaks["press"] < 0.0101
    verdict = panda.judge()
    assert (verdict.eased, verdict.strict) == (True, True)


def test_a_half_pressed_button_is_not_strict(panda):
    instance = panda.reset(TASKS["lamp_on"], 1)
    lamp, button = instance.layout.bodies
    top = button.world_from_body[:3, 3] + (0, 0, 0.007 + panda.arm.hand.tip_beyond_tcp)
    drive = driver(panda)
    drive.grip(0.0)
    move(panda, drive, above(top, lamp.world_from_body[:3, 1], 0.06), 0.0, straight=False)
    move(panda, drive, above(top, lamp.world_from_body[:3, 1], -0.0055), 0.0, speed=0.05)
    verdict = panda.judge()
    assert (verdict.eased, verdict.strict) == (True, False)


def test_a_block_is_pushed_and_slides_on_the_table(panda):
    block = cube("block", (0.35, 0.0, TABLE_HEIGHT + 0.025), mass=0.356)
    panda.reset(Laid(block), 0)
    drive = driver(panda)
    drive.grip(0.0)
    start = block.world_from_body[:3, 3] - (0.08, 0, 0)
    move(panda, drive, above(start, (0, 1, 0), 0.10), 0.0, straight=False)
    move(panda, drive, above(start, (0, 1, 0)), 0.0)
    result, error = move(panda, drive, above(np.add(start, (0.15, 0, 0)), (0, 1, 0)), 0.0, speed=0.1)
    assert error < 0.005
    assert result.contacts
    moved = panda._world.body_pose("block")[:3, 3] - block.world_from_body[:3, 3]
    assert moved[0] == pytest.approx(0.15 - 0.08 + 0.025 + 0.0105, abs=0.01)
    assert abs(moved[2]) < 0.001


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


def test_execute_carries_a_cube_around_its_neighbours(panda):
    instance = panda.reset(TASKS["pick_and_lift"], 2)
    objects = tuple(
        SceneObject(
            b.name, "cube", "box", "", b.world_from_body, np.array(b.solids[0].size), np.zeros((0, 3))
        )
        for b in instance.layout.bodies
    )
    scene = Scene(objects, TABLE_HEIGHT, panda.arm.workspace)
    body = target_cube(instance)
    x, y, z = body.world_from_body[:3, 3]
    closing = tuple(body.world_from_body[:3, 1])
    touch = frozenset({body.name, "table"})
    plan = Trajectory(
        (
            Waypoint((x, y, z + 0.12), 1.0, "approach", Orientation("grasp", (0, 0, -1), closing)),
            Waypoint((x, y, z), 0.0, "grasp", motion="linear", speed=0.1, allowed_contacts=touch),
            Waypoint(
                (x, y, z + 0.23), 0.0, "lift", motion="linear", allowed_contacts=touch, carries=body.name
            ),
        )
    )
    report = panda.execute(plan, scene)
    assert report.completed, report.abort
    assert [w.held for w in report.waypoints] == [False, True, True]
    assert report.waypoints[2].gripper_width == pytest.approx(0.05, abs=1e-3)
    assert set(report.waypoints[2].contacts) == {"panda_leftfinger", "panda_rightfinger"}
    assert panda.judge().strict


def test_a_listener_that_raises_stops_the_arm(panda):
    panda.reset(None, 0)

    def stop(image):
        raise KeyboardInterrupt

    plan = Trajectory((Waypoint((0.35, 0.1, 1.0), 1.0, "a"), Waypoint((0.35, 0.1, 0.9), 1.0, "b")))
    with pytest.raises(KeyboardInterrupt):
        panda.execute(plan, empty_scene(panda), ExecutionListener(frame=stop))
    assert np.abs(panda._world.joint_speeds).max() < 0.02
    assert panda.observe() is not None


# What goes wrong


def test_a_simulation_that_blows_up_is_noticed_and_the_next_one_is_clean(panda):
    panda.reset(TASKS["pick_and_lift"], 0)
    drive = driver(panda)
    panda._world._movers[0].set_linear_velocity((0.0, 0.0, 1000.0))
    result = drive.follow(np.tile(panda.arm.home, (100, 1)), 1 / 60, 1.0)
    assert result.diverged
    assert panda._world.time < 0.1  # broken off at once
    panda._world._panda.set_qpos(np.full(9, np.nan, dtype=np.float32))
    drive.hold()
    for look in (panda.observe, panda.judge):
        with pytest.raises(RobotError, match="blown up"):
            look()
    panda.reset(TASKS["pick_and_lift"], 0)
    np.testing.assert_allclose(panda.observe().joints, panda.arm.home, atol=1e-4)
    assert not panda.judge().eased


def test_bad_samples_are_refused(panda):
    panda.reset(None, 0)
    with pytest.raises(RobotError, match=r"\(T, 7\)"):
        driver(panda).follow(np.zeros((3, 6)), 1 / 60, 1.0)
    with pytest.raises(RobotError, match="finite"):
        driver(panda).follow(np.full((3, 7), np.nan), 1 / 60, 1.0)


def test_nothing_works_before_reset_or_after_close():
    robot = SapienPanda(SapienPandaConfig())
    for _ in range(2):
        with pytest.raises(RobotError, match="reset"):
            robot.observe()
        with pytest.raises(RobotError, match="reset"):
            robot.execute(Trajectory(()), empty_scene(robot))
        assert robot.judge() is None
        robot.close()
    robot.reset(None, 0)
    assert robot.observe().gripper > 0.9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"cameras": ["front", "top"]}, "front, left_shoulder, right_shoulder, wrist"),
        ({"cameras": []}, "one or more"),
        ({"cameras": ["wrist", "wrist"]}, "different"),
        ({"image_size": 0}, "image_size=0"),
        ({"physics_rate": -1}, "physics_rate=-1"),
    ],
)
def test_senseless_options_are_refused(options, message):
    with pytest.raises(ConfigurationError, match=message):
        SapienPanda(SapienPandaConfig(**options))


def test_fewer_cameras_can_be_asked_for():
    robot = SapienPanda(SapienPandaConfig(cameras=["wrist", "front"], image_size=32))
    robot.reset(None, 0)
    assert [v.name for v in robot.observe().views] == ["wrist", "front"]


# Layouts of third parties


def hinge(**more) -> Joint:
    what = {
        "axis": np.array([0.0, 1.0, 0.0]),
        "origin": np.array([0.4, 0.0, 1.0]),
        "limits": (-0.2, 1.0),
    }
    return Joint("hinge", "revolute", "post", "arm", **{**what, **more})


def test_hinges_turn_about_their_axis_up_to_their_stop(panda):
    post = cube("post", (0.4, 0.0, 1.0), 0.02, fixed=True)
    arm = cube("arm", (0.5, 0.0, 1.0), 0.04)
    panda.reset(Laid(post, arm, joints=(hinge(damping=0.02),)), 0)
    for _ in range(600):
        panda._world.step()
    # It falls about +y from x to -z: a positive turn, up to the stop.
    assert panda._world.travel("hinge") == pytest.approx(1.0, abs=0.01)
    assert panda._world.peaks["hinge"] == pytest.approx(1.0, abs=0.02)
    end = np.array([0.4 + 0.1 * np.cos(1.0), 0.0, 1.0 - 0.1 * np.sin(1.0)])
    np.testing.assert_allclose(panda._world.body_pose("arm")[:3, 3], end, atol=0.002)


def test_chains_start_at_rest_and_keep_their_names(panda):
    post = cube("post", (0.4, 0.0, 1.0), 0.02, fixed=True)
    arm = cube("arm", (0.5, 0.0, 1.0), 0.04)
    tip = cube("tip", (0.6, 0.0, 1.0), 0.02, mass=0.01)
    slide = Joint(
        "slide", "prismatic", "arm", "tip", np.array([1.0, 0, 0]), np.array([0.6, 0, 1.0]), (0.0, 0.05),
        rest=0.03, stiffness=500.0, damping=5.0,
    )  # fmt: skip
    panda.reset(Laid(tip, post, arm, joints=(slide, hinge(stiffness=50.0, damping=2.0, rest=0.0))), 0)
    assert panda._world.travel("slide") == pytest.approx(0.03, abs=0.002)
    # The slide follows the hinge's turn; what sags is what its spring gives.
    off = panda._world.body_pose("tip")[:3, 3] - (0.63, 0.0, 1.0)
    assert np.linalg.norm(off) < 0.02
    assert abs(panda._world.travel("hinge")) < 0.06


@pytest.mark.parametrize(
    ("bodies", "joints", "message"),
    [
        ([cube("a", (0.3, 0, 0.8)), cube("a", (0.5, 0, 0.8))], (), "two bodies of one name"),
        ([cube("post", (0.3, 0, 0.8))], (hinge(),), "ties 'post' to 'arm'"),
        ([cube("post", (0.3, 0, 0.8)), cube("arm", (0.5, 0, 0.8))], (hinge(), hinge()), "two joints"),
        (
            [cube("post", (0.3, 0, 0.8)), cube("arm", (0.5, 0, 0.8))],
            (hinge(), Joint("back", "revolute", "arm", "post", np.eye(3)[0], np.zeros(3), (0, 1))),
            "ring",
        ),
        (
            [Body("ghost", (Primitive("box", (0.1,) * 3, (0, 0, 0), collides=False),), np.eye(4))],
            (),
            "nothing of it is solid",
        ),
    ],
)
def test_unsound_layouts_are_refused(panda, bodies, joints, message):
    with pytest.raises(ConfigurationError, match=message):
        panda.reset(Laid(*bodies, joints=joints), 0)
    assert panda.reset(None, 0) is None


def test_cylinders_stand_and_spheres_are_round(panda):
    stand = Primitive("cylinder", (0.04, 0.04, 0.10), (1, 0, 0))
    bottle = Body("bottle", (stand,), rigid(translation=(0.3, 0.1, TABLE_HEIGHT + 0.05)), mass=0.2)
    ball = Body(
        "ball",
        (Primitive("sphere", (0.06,) * 3, (0, 0, 1)),),
        rigid(translation=(0.3, -0.1, TABLE_HEIGHT + 0.03)),
    )
    panda.reset(Laid(bottle, ball), 0)
    np.testing.assert_allclose(panda._world.body_pose("bottle"), bottle.world_from_body, atol=1e-3)
    assert panda._world.body_pose("ball")[2, 3] == pytest.approx(TABLE_HEIGHT + 0.03, abs=1e-3)
    points = np.concatenate([v.points()[~v.robot_mask] for v in panda.observe().views])
    high = points[:, 2] > TABLE_HEIGHT + 0.003
    assert points[high & (points[:, 1] > 0), 2].max() == pytest.approx(TABLE_HEIGHT + 0.10, abs=1e-3)
    round_ones = points[high & (points[:, 1] < 0)] - (0.3, -0.1, TABLE_HEIGHT + 0.03)
    assert len(round_ones) > 20
    np.testing.assert_allclose(np.linalg.norm(round_ones, axis=1), 0.03, atol=1e-3)


# Installation


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sapien", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "gvla2\[sim\]"'):
        SapienPanda(SapienPandaConfig())


def test_a_missing_system_library_is_named(monkeypatch, tmp_path):
    broken = "raise ImportError('libX11.so.6: cannot open shared object file: No such file or directory')"
    (tmp_path / "sapien").mkdir()
    (tmp_path / "sapien" / "__init__.py").write_text(broken)
    for name in [n for n in sys.modules if n == "sapien" or n.startswith("sapien.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingDependencyError, match=r"libX11.*libx11-6 libgl1"):
        SapienPanda(SapienPandaConfig())
