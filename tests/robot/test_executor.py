"""The waypoint loop against a robot that moves exactly, and its ways to stop."""

import numpy as np
import pytest

from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener
from gvla2.robot.executor import ExecutorOptions, execute

DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
CUBE = frozenset({"block"})

PICK = Trajectory(
    (
        Waypoint((0.3, 0.0, 0.93), 1.0, "approach", DOWN),
        Waypoint((0.3, 0.0, 0.782), 0.0, "grasp", motion="linear", speed=0.1, allowed_contacts=CUBE),
        Waypoint((0.3, 0.0, 0.95), 0.0, "lift", motion="linear", allowed_contacts=CUBE, carries="block"),
        Waypoint((0.3, 0.25, 0.79), 1.0, "place", carries="block", allowed_contacts=frozenset({"table"})),
        Waypoint((0.3, 0.25, 0.95), 1.0, "retreat", motion="linear", allowed_contacts=CUBE),
    )
)


@pytest.fixture
def run(arm, scene_of, block, driver):
    def start(trajectory=PICK, *objects, listener=None, **options):
        scene = scene_of(*(objects or (block(),)))
        return execute(trajectory, scene, arm, driver, listener, ExecutorOptions(**options))

    return start


def test_a_pick_and_place_is_carried_out(run, driver, arm):
    reported = []
    report = run(listener=ExecutionListener(waypoint=reported.append))
    assert report.completed, report.abort
    assert tuple(reported) == report.waypoints
    assert [w.stage for w in report.waypoints] == ["approach", "grasp", "lift", "place", "retreat"]
    assert [w.status for w in report.waypoints][1::3] == ["linear", "linear"]
    assert driver.calls == ["follow", "follow", "grip", "follow", "follow", "grip", "follow"]
    for waypoint, said in zip(PICK, report.waypoints, strict=True):
        assert said.target == waypoint.xyz
        assert said.error == pytest.approx(np.linalg.norm(np.subtract(said.reached, waypoint.xyz)))
        assert said.error < 1e-3
        assert said.motion_seconds > 0.1
        assert said.planning_seconds > 0
    assert [w.held for w in report.waypoints] == [False, True, True, False, False]
    assert report.waypoints[2].gripper_width == pytest.approx(0.05)
    assert report.waypoints[2].contacts == ("panda_hand",)
    assert np.array(report.joint_path).shape[1] == arm.dof
    lift = arm.tool_positions(driver.samples[2])
    np.testing.assert_allclose(lift[:, :2], [[0.3, 0.0]] * len(lift), atol=2e-3)


def test_closing_on_nothing_is_a_slip(run, driver):
    driver.between = 0.0
    report = run()
    assert report.abort.abort == "slipped"
    assert report.abort.stage == "grasp"
    assert report.abort.held is False
    assert driver.calls[-1] == "hold"


def test_missing_the_target_is_a_tracking_error(run, driver):
    driver.off = np.array([0.15, 0, 0, 0, 0, 0, 0])
    report = run()
    assert report.abort.abort == "tracking"
    assert report.abort.error > 0.03
    assert not report.completed


def test_a_goal_in_an_obstacle_is_a_collision(run, block, driver):
    report = run(Trajectory(PICK.waypoints[:1]), block(), block("shelf", (0.3, 0.0, 0.95), (0.3, 0.3, 0.05)))
    assert report.abort.abort == "collision"
    assert "shelf" in report.abort.message
    assert "follow" not in driver.calls


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ValueError("listener broke")])
def test_an_interrupt_holds_reports_and_is_passed_on(run, driver, error):
    def interrupt(call):
        if call == 2:
            raise error

    driver.on_follow = interrupt
    reported = []
    with pytest.raises(type(error)):
        run(listener=ExecutionListener(waypoint=reported.append))
    assert driver.calls[-1] == "hold"
    assert [(w.stage, w.abort) for w in reported] == [("approach", ""), ("grasp", "interrupted")]
    assert reported[-1].reached != reported[0].reached


def test_measurements_that_are_not_numbers_stop_it(run, driver):
    driver.off = np.full(7, np.nan)
    report = run()
    assert report.abort.abort == "diverged"
    assert np.isfinite(report.abort.reached).all()
    driver.joints = np.full(7, np.nan)
    assert run().abort.abort == "diverged"


def test_what_was_let_go_is_an_obstacle_where_it_lies(run, driver, block):
    """After the place, the block blocks a straight way through where it was put, and no longer where it was."""
    tail = (
        Waypoint((0.45, 0.25, 0.95), 0.0, "aside"),
        Waypoint((0.45, 0.0, 0.79), 0.0, "down"),
        Waypoint((0.3, 0.0, 0.79), 0.0, "where it was", motion="linear"),
    )
    report = run(Trajectory(PICK.waypoints + tail))
    assert report.completed, report.abort
    through = Waypoint((0.3, 0.35, 0.79), 0.0, "through it", motion="linear")
    driver.joints, driver.width = driver.samples[0][0], 0.08
    report = run(Trajectory((*PICK.waypoints, *tail, through)))
    assert report.abort is not None
    assert (report.abort.stage, report.abort.abort) == ("through it", "collision")
    assert "block" in report.abort.message
