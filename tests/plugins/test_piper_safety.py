"""Faults on the virtual bus: whatever breaks, the arm ends in a hold, powered, with a complete log."""

import contextlib
import itertools
import os
import signal
import time

import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener
from gvla2_plugins.piper import PiperConfig, SceneryConfig, frames, session
from gvla2_plugins.piper.arm import HOME, Bounds
from gvla2_plugins.piper.backend import Piper
from gvla2_plugins.piper.command_log import CommandLog
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.loop import SILENT_AFTER, SafetyStopError
from gvla2_plugins.piper.scenery import Scenery
from gvla2_plugins.piper.session import ask_person, check_health, confirm
from gvla2_plugins.piper.virtual_arm import Faults, VirtualArm
from tests.plugins.piper_trials import (
    FAULTS,
    TrialBench,
    interrupted,
    judge_frames,
    logged_frames,
    read_log,
)

DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
NUMBERS = itertools.count()


def waypoint(y=0.12):
    return Waypoint((0.24, y, 0.07), 1.0, "go", DOWN, tolerance=0.01)  # the fingers stay as they are


class Rig:
    """An external virtual arm and an armed backend on its channel."""

    def __init__(self, folder, answer=None, start=HOME, **options):
        self.channel = f"rig-{folder.name}-{next(NUMBERS)}"
        self.log = folder / "log.jsonl"
        self.arm = VirtualArm("virtual", self.channel, joints=start).start()
        config = PiperConfig(
            **{"bus": "virtual", "channel": self.channel, "armed": True, "log": str(self.log), **options}
        )
        camera = Scenery(SceneryConfig(image_size=8))
        self.robot = Piper(config, camera, lambda question: answer or f"move {self.channel}")
        self.scene = Scene((), 0.0, self.robot.arm.workspace)

    def go(self, *waypoints, listener=None):
        return self.robot.execute(Trajectory(waypoints), self.scene, listener or ExecutionListener())

    def sent(self):
        return [(i, data) for _, i, data in list(self.arm.heard)]

    def at_rest(self):
        time.sleep(0.15)
        before = self.arm.joints.copy()
        time.sleep(0.1)
        return self.arm.enabled and np.abs(self.arm.joints - before).max() < 2e-3

    def close(self):
        self.robot.close()
        self.arm.stop()


@pytest.fixture
def short_listening(monkeypatch):
    """A sound arm is listened to for a shorter time before it is armed."""
    monkeypatch.setattr(session, "LISTEN_SECONDS", 0.2)


@pytest.fixture
def rig(tmp_path, short_listening):
    made = []

    def make(**options):
        made.append(Rig(tmp_path, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
        assert not judge_frames(one.sent())
        assert one.arm.enabled or frames.ENABLE not in [i for i, _ in one.sent()]


@pytest.mark.parametrize("fault", [*FAULTS, "planner raises", "target out of workspace"])
def test_a_fault_at_a_random_instant_ends_in_a_hold(fault, tmp_path, short_listening):
    stops = 2 if fault == "planner raises" else 1
    bench = TrialBench(tmp_path / "log.jsonl", seed=len(fault), window=0.5, stops=stops)
    try:
        trial = bench.trial(fault)
    finally:
        bench.close()
    assert trial.ending
    assert not trial.problems, (trial.ending, trial.reason)
    expected = {
        "20 % of frames lost": {"finished", "stopped"},
        "planner raises": {"held"},
        "target out of workspace": {"refused"},
    }.get(fault, {"stopped", "finished"})
    assert trial.ending in expected, trial.reason


def test_ctrl_c_in_another_process_holds_the_arm(tmp_path):
    """Over multicast, with the arm in this process."""
    trial = interrupted(tmp_path, 0, "239.74.163.64", window=1.0)
    assert trial.ending == "held"
    assert not trial.problems


def test_a_stop_is_final_until_the_session_ends(rig):
    one = rig()
    one.robot.reset(None, 0)
    one.arm.faults.state = 7
    with pytest.raises(SafetyStopError, match="status is 'collision'"):
        one.go(waypoint())
    one.arm.faults = Faults()
    with pytest.raises(SafetyStopError):
        one.go(waypoint())
    with pytest.raises(RobotError, match="start again"):
        one.robot.reset(None, 1)
    assert one.at_rest()
    time.sleep(max(0.0, one.robot.session.loop.stopped_at + SILENT_AFTER + 0.05 - time.monotonic()))
    quiet = len(one.sent())
    time.sleep(0.2)
    assert len(one.sent()) == quiet  # nobody is fought for the arm


def test_lost_heartbeat_stops_the_arm(rig):
    one = rig(tool_speed=0.05)
    one.robot.reset(None, 0)
    listener = ExecutionListener(frame=lambda image: time.sleep(0.5))
    with pytest.raises(SafetyStopError, match="the program that moves the arm was silent"):
        one.go(waypoint(0.15), waypoint(-0.15), listener=listener)
    assert one.at_rest()


def test_an_exception_of_the_listener_holds_the_arm_and_is_passed_on(rig):
    one = rig(speed=0.2, tool_speed=0.1, acceleration=4.0)
    one.robot.reset(None, 0)

    def broken(image):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        one.go(waypoint(0.15), listener=ExecutionListener(frame=broken))
    assert one.at_rest()
    assert np.abs(one.arm.joints[0]) < 0.3  # it was stopped on the way
    assert one.go(waypoint(0.02)).completed  # a hold is no stop: the next motion may follow


def test_a_swallowed_interrupt_still_holds_the_arm(rig):
    """An interrupt that lands in a library's callback is printed and lost; not for the arm."""
    before = signal.getsignal(signal.SIGINT)
    one = rig(tool_speed=0.05)
    one.robot.reset(None, 0)

    def swallow(image):
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        one.go(waypoint(0.15), listener=ExecutionListener(frame=swallow))
    assert one.at_rest()
    assert np.abs(one.arm.joints[0]) < 0.3
    one.robot.close()
    assert signal.getsignal(signal.SIGINT) is before


def test_another_program_on_the_bus_stops_the_arm(rig):
    import can

    one = rig(tool_speed=0.05)
    one.robot.reset(None, 0)
    other = can.Bus(one.channel, interface="virtual")
    intruder = can.Message(arbitration_id=0x155, data=frames.pair(20_000, 90_000), is_extended_id=False)
    listener = ExecutionListener(frame=lambda image: other.send(intruder))
    with pytest.raises(SafetyStopError, match="another program commands the arm: frame 155"):
        one.go(waypoint(0.15), waypoint(-0.15), listener=listener)
    other.shutdown()


def test_a_second_writer_in_the_same_process_is_refused_too(rig, tmp_path):
    one = rig()
    one.robot.reset(None, 0)
    config = PiperConfig(bus="virtual", channel=one.channel, armed=True, log=str(tmp_path / "b.jsonl"))
    second = Piper(config, Scenery(SceneryConfig(image_size=8)), lambda question: f"move {one.channel}")
    with pytest.raises(RobotError, match="already commanded by process"):
        second.reset(None, 0)
    second.close()


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ({"zeros": True}, "all six joints read exactly 0"),
        ({"silent": True}, "No frames come from the arm .* wrong bitrate"),
        ({"state": 1}, "the arm's status is 'emergency stop'"),
        ({"delay": 0.3}, "did not answer a query within 150 ms"),
    ],
)
def test_an_unfit_arm_is_refused_before_anything_moves(rig, faults, message):
    one = rig()
    for name, value in faults.items():
        setattr(one.arm.faults, name, value)
    time.sleep(0.05)
    with pytest.raises(RobotError, match=message):
        one.robot.reset(None, 0)
    assert not [i for i, _ in one.sent() if i in frames.COMMANDS]


def test_an_arm_that_is_moved_by_somebody_is_refused(tmp_path):
    with VirtualArm("virtual", "pushed", joints=HOME) as arm:
        link = PiperLink("virtual", "pushed", Bounds(), None)
        link.wait_for_feedback()
        arm.enabled, arm.percent = True, 20
        arm._target = arm.joints + 0.3
        with pytest.raises(RobotError, match="another program commands it, or somebody"):
            check_health(link)
        link.close()


def test_arming_takes_a_typed_word(rig):
    one = rig(answer="yes")
    with pytest.raises(RobotError, match="was not typed"):
        one.robot.reset(None, 0)
    assert not one.sent()
    with pytest.raises(RobotError, match="needs a person at a terminal"):
        confirm("can0", 15, ask_person)  # pytest's stdin is no terminal


def test_a_cable_pulled_while_the_arm_rests_is_noticed(rig):
    one = rig()
    one.robot.reset(None, 0)
    one.arm.faults.silent = True
    time.sleep(0.55)
    with pytest.raises(SafetyStopError, match="no joint feedback"):
        one.go(waypoint())
    with pytest.raises(RobotError, match="is the cable out"):
        one.robot.observe()


def test_a_log_that_cannot_be_written_means_nothing_is_sent(rig, monkeypatch):
    one = rig()
    one.robot.reset(None, 0)

    def full(self, entry):
        raise RobotError("the disk is full")

    monkeypatch.setattr(CommandLog, "_write", full)
    with pytest.raises(RobotError):
        one.go(waypoint())
    monkeypatch.undo()
    assert one.at_rest()


def test_closing_leaves_the_arm_powered_and_logs_the_end(rig):
    one = rig(speed=0.2, tool_speed=0.25, acceleration=4.0)
    one.robot.reset(None, 0)
    assert one.go(waypoint(0.03)).completed
    one.robot.close()
    one.robot.close()
    time.sleep(0.1)
    assert one.arm.enabled
    events = [e["event"] for e in read_log(one.log) if e["kind"] == "event"]
    assert events[0] == "armed"
    assert events[-1] == "hold"
    logged = logged_frames(one.log)
    assert logged == one.sent()
