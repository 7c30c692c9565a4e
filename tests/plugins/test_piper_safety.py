"""Faults on the virtual bus: whatever breaks, the arm ends in a hold, powered, with a complete log."""

import contextlib
import os
import signal
import threading
import time
from random import Random
from unittest.mock import Mock

import can
import numpy as np
import pytest

from gvla2.errors import RobotError
from gvla2.robot import executor
from gvla2_plugins.piper import frames, session
from gvla2_plugins.piper.arm import HOME, Bounds
from gvla2_plugins.piper.driver import measured
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.loop import SILENT_AFTER, SafetyStopError
from gvla2_plugins.piper.session import ask_person, check_health, confirm
from gvla2_plugins.piper.writer import CommandLog
from tests.plugins.piper_rig import SWIFT, Rig, forbidden, logged_frames, read_log, waypoint
from tests.plugins.virtual_piper import Faults, VirtualArm, pair

FAULTS = {
    "bus silent": {"silent": True},
    "20 % of frames lost": {"loss": 0.2},
    "frames 200 ms late": {"delay": 0.2},
    "feedback frozen": {"frozen": True},
    "joint stuck": {"stuck": 0},
    "status collision": {"state": 7},
}


@pytest.fixture
def rig(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(session, "LISTEN_SECONDS", 0.2)  # a sound arm is listened to for longer

    def make(**options):
        made.append(Rig(tmp_path, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
        assert not forbidden(one.sent())
        assert one.arm.enabled or frames.ENABLE not in [i for i, _ in one.sent()]


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_at_a_random_instant_ends_in_a_hold(rig, fault):
    one = rig(**SWIFT)
    one.robot.reset(None, 0)

    def break_something():
        for name, value in FAULTS[fault].items():
            setattr(one.arm.faults, name, value)

    breaking = threading.Timer(Random(fault).uniform(0.0, 0.5), break_something)
    breaking.start()
    completed = False
    with contextlib.suppress(RobotError):
        completed = one.go(waypoint(0.12), waypoint(-0.12)).completed
    breaking.join()
    loop = one.robot.session.loop
    assert completed or loop.stopped
    assert loop.held_at - loop.stopped_at < 0.15
    time.sleep(0.5)  # late frames arrive, and the arm goes back to where it was last measured
    assert one.at_rest()
    sent = one.sent()
    assert logged_frames(one.log)[: len(sent)] == sent  # each frame is logged before it is sent


def test_a_planner_that_raises_leaves_the_arm_held(rig, monkeypatch):
    one = rig(**SWIFT)
    one.robot.reset(None, 0)
    plan = executor.plan_motion

    def breaks(*args, seed=0, **kwargs):
        if seed:
            raise ZeroDivisionError
        return plan(*args, seed=seed, **kwargs)

    monkeypatch.setattr(executor, "plan_motion", breaks)
    with pytest.raises(ZeroDivisionError):
        one.go(waypoint(0.12), waypoint(-0.12))
    assert one.at_rest()
    assert "hold" in {e.get("event") for e in read_log(one.log)}


@pytest.mark.parametrize("outside", [(0.9, 0.0, 0.1), (0.3, 0.8, 0.1), (0.3, 0.0, -0.2)])
def test_a_target_out_of_the_workspace_is_refused_before_anything_moves(rig, outside):
    one = rig()
    one.robot.reset(None, 0)
    before = one.arm.joints.copy()
    report = one.go(waypoint(0.12), waypoint(xyz=outside))
    assert report.abort.abort == "not_started"
    assert np.allclose(one.arm.joints, before, atol=2e-3)


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
    with pytest.raises(SafetyStopError, match="the program that moves the arm was silent"):
        one.go(waypoint(0.15), waypoint(-0.15), moment=lambda moment: time.sleep(0.5))
    assert one.at_rest()


def test_an_exception_of_the_listener_holds_the_arm_and_is_passed_on(rig):
    one = rig(speed=0.2, tool_speed=0.1, acceleration=4.0)
    one.robot.reset(None, 0)

    def broken(moment):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        one.go(waypoint(0.15), moment=broken)
    assert one.at_rest()
    assert np.abs(one.arm.joints[0]) < 0.3  # it was stopped on the way
    assert one.go(waypoint(0.02)).completed  # a hold is no stop: the next motion may follow


def test_a_swallowed_interrupt_still_holds_the_arm(rig):
    """An interrupt that lands in a library's callback is printed and lost; not for the arm."""
    before = signal.getsignal(signal.SIGINT)
    one = rig(tool_speed=0.05)
    one.robot.reset(None, 0)

    def swallow(moment):
        with contextlib.suppress(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.01)

    with pytest.raises(KeyboardInterrupt):
        one.go(waypoint(0.15), moment=swallow)
    assert one.at_rest()
    assert np.abs(one.arm.joints[0]) < 0.3
    one.robot.close()
    assert signal.getsignal(signal.SIGINT) is before


def test_another_program_on_the_bus_stops_the_arm(rig):
    import can

    one = rig(tool_speed=0.05)
    one.robot.reset(None, 0)
    other = can.Bus(one.channel, interface="virtual")
    intruder = can.Message(arbitration_id=0x155, data=pair(20_000, 90_000), is_extended_id=False)
    with pytest.raises(SafetyStopError, match="another program commands the arm: frame 155"):
        one.go(waypoint(0.15), waypoint(-0.15), moment=lambda moment: other.send(intruder))
    other.shutdown()


@pytest.mark.parametrize(
    ("faults", "message"),
    [
        ({"zeros": True}, "all six joints read exactly 0"),
        ({"silent": True}, "No frames come from the arm .*wrong bitrate"),
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


def test_a_bus_that_fails_is_said_and_heard_again(monkeypatch):
    with VirtualArm("virtual", "down", joints=HOME):
        link = PiperLink("virtual", "down", Bounds(), None)
        link.wait_for_feedback()
        with monkeypatch.context() as patch:
            broken = Mock(side_effect=can.CanOperationError("Network is down"))
            patch.setattr(link._bus, "recv", broken)
            time.sleep(0.7)
            with pytest.raises(RobotError, match=r"ago \(Network is down\): is the cable out"):
                measured(link)
            assert broken.call_count < 30
        time.sleep(0.2)
        assert measured(link).joints == pytest.approx(HOME, abs=1e-4)
        link.close()


def test_a_log_that_cannot_be_written_means_nothing_is_sent(rig, monkeypatch):
    one = rig()
    one.robot.reset(None, 0)

    def full(self, kind, **fields):
        raise RobotError("the disk is full")

    monkeypatch.setattr(CommandLog, "write", full)
    with pytest.raises(RobotError):
        one.go(waypoint())
    monkeypatch.undo()
    assert one.at_rest()


def test_closing_leaves_the_arm_powered_and_logs_the_end(rig):
    one = rig(**SWIFT)
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
