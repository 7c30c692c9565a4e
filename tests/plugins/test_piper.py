"""The Piper's description, gate, lock, log and camera: what needs no moving arm."""

import os
import struct
import subprocess
import sys
import time
import warnings

import can
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, RobotError
from gvla2.planning.scene import Scene
from gvla2.testing.robot import check_camera, check_robot
from gvla2_plugins.piper import PiperConfig, frames
from gvla2_plugins.piper.arm import HIGH, HOME, LOW, Bounds, make_arm
from gvla2_plugins.piper.backend import Piper
from gvla2_plugins.piper.feedback import Feedback
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.writer import CommandLog, WriterLock
from tests.plugins.piper_rig import logged_frames, read_log
from tests.plugins.synthetic_table import Scenery
from tests.plugins.virtual_piper import PARKED, VirtualArm, pair


@pytest.fixture(scope="module")
def arm():
    return make_arm(PiperConfig()).arm


def test_forward_kinematics_are_the_sdks(arm):
    """Within 0.01 mm and 1e-6 of rotation over 1,000 random poses."""
    fk = pytest.importorskip("piper_sdk.kinematics.piper_fk", reason="the maker's library is not installed")
    sdk, rng = fk.C_PiperForwardKinematics(0x01), np.random.default_rng(0)
    for joints in rng.uniform(LOW, HIGH, (1000, 6)):
        x, y, z, *rpy = sdk.CalFK(joints.tolist())[-1]
        tool = arm.forward(joints)
        flange = 1e3 * (tool[:3, 3] - PiperConfig().tcp_offset * tool[:3, 2])
        assert np.abs(flange - [x, y, z]).max() < 0.01
        turn = Rotation.from_euler("xyz", rpy, degrees=True).as_matrix()
        assert np.abs(turn - tool[:3, :3]).max() < 1e-6


def test_home_and_the_parked_pose_touch_nothing(arm):
    scene = Scene((), 0.0, arm.workspace)
    for joints in (HOME, PARKED):
        assert arm.clearance(np.array(joints), 1.0, scene).distance > 0.005


def message(arbitration_id, data):
    return can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False)


@pytest.fixture
def bench(tmp_path):
    """A virtual arm, and a link to it whose gate is open."""
    channel = f"test-{tmp_path.name}-{time.monotonic_ns()}"
    log = CommandLog(tmp_path / "log.jsonl")
    with VirtualArm("virtual", channel, joints=HOME, enabled=True) as arm:
        link = PiperLink("virtual", channel, Bounds(), log)
        link.wait_for_feedback()
        yield arm, link
        link.close()
        log.close()


FORBIDDEN = {
    "reset": (0x150, "0200000000000000"),
    "emergency stop": (0x150, "0100000000000000"),
    "teach": (0x150, "0000010000000000"),
    "disable all": (0x471, "ff01000000000000"),
    "disable": (0x471, "0701000000000000"),
    "standby": (0x151, "00010a0000000000"),
    "tool moves": (0x151, "01000a0000000000"),
    "gripper off": (0x159, "0000000000000000"),
    "joint zero": (0x475, "07ae0001f4000000"),
    "master": (0x470, "fa00000000000000"),
    "tool target": (0x152, "00030d4000000000"),
    "torque": (0x15A, "7fff7ff0519477fd"),
    "limits": (0x474, "017fff7fff7fff00"),
    "crash protection": (0x47A, "0000000000000000"),
    "parameters": (0x477, "0100000003000000"),
    "master home": (0x191, "0101010000000000"),
}
"""Frames that would release, reset or reconfigure an arm, or move it by other means."""


@pytest.mark.parametrize("what", FORBIDDEN)
def test_what_is_dangerous_never_leaves_the_gate(bench, what):
    arm, link = bench
    link.gate.open_gate()
    frame, data = FORBIDDEN[what]
    link.gate.send(frame, bytes.fromhex(data))
    time.sleep(0.03)
    assert not arm.heard
    assert link.gate.refused
    assert link.gate.trouble
    assert arm.enabled


def test_a_shut_gate_lets_nothing_out(bench):
    arm, link = bench
    link.move_joints(np.array(HOME))
    link.enable()
    link.joint_mode()
    link.move_gripper(0.03)
    link.ask()
    time.sleep(0.03)
    assert not arm.heard
    assert len(link.gate.refused) == 7


def test_the_gate_bounds_speed_steps_limits_and_effort(bench):
    arm, link = bench
    link.gate.open_gate()
    home = np.array(HOME)

    def mode(percent, mit=0):
        link.gate.send(frames.MODE, bytes([1, 1, percent, mit, 0, 0, 0, 0]))

    def grip(*values):
        link.gate.send(frames.GRIPPER_TARGET, struct.pack(">ihBB", *values))

    def lets(function, *arguments):
        before, refused = len(arm.heard), len(link.gate.refused)
        function(*arguments)
        time.sleep(0.02)
        assert (len(arm.heard) > before) != (len(link.gate.refused) > refused)
        return len(arm.heard) > before

    assert lets(mode, 20)
    assert not lets(mode, 21)
    assert not lets(mode, 20, 0xAD)
    assert lets(link.move_joints, home)
    step = np.array([*link.bounds.step[:2], 0, 0, 0, 0])
    assert lets(link.move_joints, home + 0.9 * step)
    link.move_joints(home + 0.3 * np.eye(6)[0])
    assert "joint 1 would jump" in link.gate.refused[-1]
    time.sleep(0.05)
    assert not lets(grip, 20_000, 1_001, 1, 0)
    assert not lets(grip, 80_000, 500, 1, 0)
    assert not lets(grip, 20_000, 500, 1, 0xAE)
    assert lets(grip, 20_000, 1_000, 1, 0)


def test_leaps_and_impossible_angles_are_not_believed():
    feedback = Feedback()
    for index, frame in enumerate(frames.JOINTS):
        raw = [frames.millidegrees(v) for v in HOME[2 * index : 2 * index + 2]]
        feedback.take(frame, pair(*raw), now=1.0)
    feedback.take(0x2A5, pair(0, 0), now=1.005)
    seen = feedback.snapshot(1.01)
    assert "joint 2 seems to have leapt" in seen.unbelievable
    assert np.allclose(seen.joints, HOME, atol=1e-4)
    feedback.take(0x2A6, pair(90_000, 0), now=1.01)
    assert "joint 3 reads" in feedback.snapshot().unbelievable


def test_one_process_holds_the_lock_whatever_names_it_gives_the_device(tmp_path):
    _, terminal = os.openpty()
    port, by_id = os.ttyname(terminal), tmp_path / "by-id"
    by_id.symlink_to(port)
    first = WriterLock("slcan", port)
    first.acquire()
    code = (
        "import sys; from gvla2_plugins.piper.writer import WriterLock\n"
        "from gvla2.errors import RobotError\n"
        "try: WriterLock('slcan', sys.argv[1]).acquire(); print('taken')\n"
        "except RobotError as error: print(error)"
    )

    def other(name):
        command, elsewhere = [sys.executable, "-c", code, name], os.environ | {"TMPDIR": str(tmp_path)}
        return subprocess.run(command, capture_output=True, text=True, env=elsewhere).stdout

    for name in (port, str(by_id), f"{by_id}@115200", "/dev/../" + port):
        assert "already commanded by another program" in other(name)
    assert not [path for path in tmp_path.iterdir() if path != by_id], "no file to plant a link at"
    first.release()
    first.release()
    assert other(str(by_id)) == "taken\n"


def test_the_log_is_appended_to_and_read_back(tmp_path):
    path = tmp_path / "deep" / "log.jsonl"
    for session in range(2):
        log = CommandLog(path)
        log.write("session", number=session)
        log.write("frame", id="155", data=pair(1, -2).hex())
        log.write("event", event="hold")
        log.close()
    assert [e["kind"] for e in read_log(path)] == ["session", "frame", "event"] * 2
    assert logged_frames(path)[0] == (0x155, pair(1, -2))
    with pytest.raises(RobotError, match="closed"):
        log.write("event", event="late")
    with pytest.raises(RobotError, match="can't be written"):
        CommandLog(tmp_path / "deep")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speed": 0.3}, "robot.speed=0.3"),
        ({"speed": 0.0}, "robot.speed"),
        ({"grip_effort": 4.0}, "robot.grip_effort"),
        ({"workspace_low": [0.0, 0.0]}, "three numbers"),
        ({"workspace_low": [0.7, -0.4, 0.0]}, "low below high"),
        ({"bus": "none", "armed": True}, "needs an arm"),
    ],
)
def test_options_are_checked(options, message):
    with pytest.raises(ConfigurationError, match=message):
        Piper(PiperConfig(**options), Scenery(8))


def test_a_bus_that_is_not_there_says_how_to_bring_it_up():
    robot = Piper(PiperConfig(channel="can93"), Scenery(8))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # python-can's half-open socket
        with pytest.raises(RobotError, match=r"can93.* can't be opened.*ip link set can93 up"):
            robot.reset(None, 0)
    robot.close()


def test_components_conform():
    check_camera(Scenery(64))
    check_robot(Piper(PiperConfig(bus="none"), Scenery(64)), move=False)


def test_a_real_arm_does_not_move_by_pictures_of_the_past():
    with pytest.raises(ConfigurationError, match="live camera"):
        Piper(PiperConfig(bus="socketcan", armed=True), Scenery(64))
