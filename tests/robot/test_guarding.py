"""Guarded motions of the executor: what ends them, what is reported, and where the next motion starts."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from gvla2.planning.trajectory import Guard, Orientation, Trajectory, Waypoint
from gvla2.robot.driver import DriverState, GripResult, MoveResult
from gvla2.robot.executor import execute

DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))


@dataclass
class FeelingDriver:
    """A kinematic arm; the ``floor`` (m) pushes back with ``spring`` N a metre and lets nothing in."""

    joints: np.ndarray
    arm: object
    floor: float = 0.85
    spring: float = 5000.0
    measures: bool = True
    calls: list[str] = field(default_factory=list)
    samples: list[np.ndarray] = field(default_factory=list)

    def state(self):
        return DriverState(self.joints.copy(), 0.0)

    def follow(self, samples, dt, gripper, stop=None):
        if stop is not None:
            return self.guarded(samples, stop)
        self.calls.append("follow")
        self.samples.append(samples)
        self.joints = samples[-1].copy()
        return MoveResult()

    def grip(self, opening):
        self.calls.append("grip")
        return GripResult(0.08 * opening, False)

    def hold(self):
        self.calls.append("hold")

    def guarded(self, samples, stop):
        self.calls.append("guarded")
        for sample in samples:
            depth = max(0.0, self.floor - self.arm.forward(sample)[2, 3])
            force = np.array([0.0, 0.0, self.spring * depth]) if self.measures else None
            if depth < 1e-3:  # from there on the floor keeps the arm
                self.joints = sample.copy()
            if stop(sample, self.joints, force):
                return MoveResult(stopped=True)
        return MoveResult()


@pytest.fixture
def go(arm, scene_of):
    def start(driver, guard, target=0.80, dwell=0.0):
        press = Trajectory(
            (
                Waypoint((0.3, 0.2, 0.95), 0.0, "approach", DOWN),
                Waypoint(
                    (0.3, 0.2, target), 0.0, "press", motion="linear", speed=0.05, guard=guard, dwell=dwell
                ),
                Waypoint((0.3, 0.2, 0.95), 1.0, "retreat", motion="linear"),
            )
        )
        return execute(press, scene_of(), arm, driver)

    return start


def test_force_ends_a_motion_well(go, arm):
    driver = FeelingDriver(arm.home, arm)
    report = go(driver, Guard(force=10.0))
    assert report.completed
    press = report.waypoints[1]
    assert press.status == "guarded"
    assert 10.0 < press.force < 15.0
    assert press.error == pytest.approx(0.05, abs=0.003)  # far from its target, and yet carried out
    assert "guarded at 10 N" in press.message
    assert report.to_json()["waypoints"][1]["force"] == press.force
    # It held there, and the next motion started from where it stood.
    at = driver.calls.index("guarded")
    assert driver.calls[at : at + 3] == ["guarded", "hold", "follow"]
    np.testing.assert_allclose(arm.forward(driver.samples[-1][0])[2, 3], 0.85, atol=0.003)
    assert report.waypoints[0].force is None


def test_the_arm_stays_where_it_got_to_for_the_dwell(go, arm):
    for floor, target in ((0.85, 0.80), (0.85, 0.90)):  # stopped by the floor, and not
        driver = FeelingDriver(arm.home, arm, floor=floor)
        without = go(FeelingDriver(arm.home, arm, floor=floor), Guard(force=10.0), target).waypoints[1]
        press = go(driver, Guard(force=10.0), target, dwell=2.0).waypoints[1]
        stay = driver.samples[1]
        assert np.ptp(stay, axis=0).max() == 0.0
        assert arm.forward(stay[0])[2, 3] == pytest.approx(max(floor, target), abs=2e-3)
        assert (len(stay) - 1) / 60 == pytest.approx(2.0, abs=0.02)
        assert press.motion_seconds - without.motion_seconds == pytest.approx(2.0, abs=0.02)
