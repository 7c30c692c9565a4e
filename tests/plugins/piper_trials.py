"""Fault injection: an armed virtual arm is moved, something breaks at a random instant, and the result is judged.

Used by the tests and by ``tests.benchmarks.piper_faults``; it uses the same link, gate, loop, driver and executor as
a run.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from gvla2.errors import RobotError
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.motion import MotionPlanner
from gvla2_plugins.piper import PiperConfig, frames
from gvla2_plugins.piper.backend import Piper
from gvla2_plugins.piper.virtual_arm import Faults, VirtualArm

FAULTS: dict[str, Callable[[Faults], None]] = {
    "bus silent": lambda f: setattr(f, "silent", True),
    "20 % of frames lost": lambda f: setattr(f, "loss", 0.2),
    "frames 200 ms late": lambda f: setattr(f, "delay", 0.2),
    "feedback frozen": lambda f: setattr(f, "frozen", True),
    "joint stuck": lambda f: setattr(f, "stuck", 0),
    "status collision": lambda f: setattr(f, "state", 7),
}
"""What breaks in the arm or on the bus. The others are: a planner that raises, Ctrl-C, a target out of bounds."""

OTHERS = ("planner raises", "kill -INT", "target out of workspace")


def read_log(path: Path) -> list[dict[str, Any]]:
    """The entries of a command log in order; ``m`` is the monotonic clock."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def logged_frames(path: Path) -> list[tuple[int, bytes]]:
    """Identifier and data of every frame in a command log."""
    return [(int(e["id"], 16), bytes.fromhex(e["data"])) for e in read_log(path) if e["kind"] == "frame"]


_DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
_AFTER = 0.4  # seconds that are watched after the end of a motion
_REST = 2e-3  # radians that a held arm may still creep in the last part of them


@dataclass
class FaultTrial:
    """The result of one injected fault.

    ``ending``: "stopped" by the watch, "held" by an exception, "refused" before motion, or "finished" (the motion came
    to its end unharmed, and is held there). ``latency`` seconds from detection to the first hold frame; ``problems``
    lists violations.
    """

    fault: str
    ending: str = ""
    reason: str = ""
    latency: float = 0.0
    problems: list[str] = field(default_factory=list)


class TrialBench:
    """One virtual arm and one armed backend, used for many trials; close it in the end.

    Faults come within ``window`` seconds of the start of a motion of about two to each of one or two ``stops``.
    """

    def __init__(self, log: Path, seed: int = 0, window: float = 2.5, stops: int = 2) -> None:
        self.random, self._window, self._stops = Random(seed), window, stops
        self.log = log
        self.channel = f"gvla2-trials-{os.getpid()}-{id(self)}"
        self.arm = VirtualArm(
            "virtual", self.channel, joints=(0.0, 1.45, -1.05, 0.0, 1.05, 0.0), seed=seed
        ).start()
        self.robot: Piper | None = None
        self._read = 0

    def close(self) -> None:
        """End arm and backend."""
        if self.robot is not None:
            self.robot.close()
        self.arm.stop()

    def trial(self, fault: str) -> FaultTrial:
        """One fault at a random instant of a motion."""
        self.arm.faults = Faults()
        robot = self._armed()
        assert robot.session is not None
        loop = robot.session.loop
        assert loop is not None
        first = len(self.arm.heard)
        trial = FaultTrial(fault)
        target = self._trajectory(outside=fault == "target out of workspace")
        planner = (
            _Raising(robot.arm, self.random.uniform(0.0, self._window)) if fault == "planner raises" else None
        )
        breaking = threading.Timer(self.random.uniform(0.0, self._window), self._break, [fault])
        breaking.daemon = True
        breaking.start()
        began = time.monotonic()
        try:
            self._run(robot, target, planner, trial)
        finally:
            breaking.cancel()
        if loop.stopped:
            trial.ending, trial.reason = "stopped", loop.stopped
            trial.latency = loop.held_at - loop.stopped_at
        time.sleep(_AFTER)
        self._judge(trial, first, began)
        self.arm.faults = Faults()
        if loop.stopped:
            time.sleep(0.1)
            robot.close()
            self.robot = None
        return trial

    def _armed(self) -> Piper:
        if self.robot is None:
            config = PiperConfig(
                bus="virtual",
                channel=self.channel,
                armed=True,
                log=str(self.log),
                speed=0.2,
                acceleration=4.0,
                tool_speed=0.25,
            )
            self.robot = Piper(config, _Blind(), lambda question: f"move {self.channel}")
            self.robot.reset(None, 0)
        return self.robot

    def _trajectory(self, outside: bool) -> Trajectory:
        side = 1.0 if self.arm.joints[0] < 0 else -1.0
        points = [
            (0.24, s * side * self.random.uniform(0.08, 0.16), self.random.uniform(0.05, 0.09))
            for s in (1, -1)[: self._stops]
        ]
        if outside:
            away = self.random.choice([(0.9, 0.0, 0.1), (0.3, 0.8, 0.1), (0.3, 0.0, -0.2), (0.3, 0.0, 1.2)])
            points.insert(self.random.randrange(len(points) + 1), away)
        return Trajectory(
            tuple(
                Waypoint(point, self.random.random(), f"stop {i}", _DOWN, speed=0.25, tolerance=0.01)
                for i, point in enumerate(points)
            )
        )

    def _break(self, fault: str) -> None:
        if fault in FAULTS:
            FAULTS[fault](self.arm.faults)

    def _run(self, robot: Piper, target: Trajectory, planner: Any, trial: FaultTrial) -> None:
        scene = Scene((), 0.0, robot.arm.workspace)
        if planner is not None:
            robot.planner = planner
        try:
            report = robot.execute(target, scene)
        except RobotError as error:
            trial.ending, trial.reason = "held", str(error)
        except _PlannerError as error:
            trial.ending, trial.reason = "held", str(error)
            trial.latency = self._held_since(error.at)
        else:
            stop = report.abort
            if stop is None:
                trial.ending = "finished"
            else:
                trial.ending = "refused" if stop.abort == "not_started" else "held"
                trial.reason = stop.message
        finally:
            if planner is not None:
                robot.planner = MotionPlanner(robot.arm)

    def _held_since(self, moment: float) -> float:
        held = [e["m"] for e in read_log(self.log) if e.get("event") == "hold" and e["m"] >= moment]
        return held[0] - moment if held else float("inf")

    def _judge(self, trial: FaultTrial, first: int, began: float) -> None:
        before = self.arm.joints.copy()
        everything = [(i, data) for _, i, data in list(self.arm.heard)]
        said = logged_frames(self.log)
        time.sleep(0.15)
        trial.problems += judge_frames(everything)
        # All that was heard is in the log, which is written first; what is in the log was heard, or soon will be.
        if said[: len(everything)] != everything or not self._hears(said):
            trial.problems.append(f"the log has {len(said)} frames, the bus {len(self.arm.heard)}")
        heard = list(self.arm.heard)[first:]
        if float(np.abs(self.arm.joints - before).max()) > _REST:
            trial.problems.append("the arm still moves")
        latest = heard[-1][0] - 0.2 if heard else 0.0
        targets = {(i, d) for at, i, d in heard if i in frames.JOINT_TARGETS and at > latest}
        if len(targets) > 3:
            trial.problems.append("the targets still change")
        if not self.arm.enabled:
            trial.problems.append("the motors are off")
        if trial.latency > 0.15:
            trial.problems.append(f"held {1e3 * trial.latency:.0f} ms after detection")
        if trial.fault == "target out of workspace" and (
            trial.ending != "refused" or self._moved(heard, began)
        ):
            trial.problems.append(f"a target out of the workspace was not refused but {trial.ending}")

    def _hears(self, said: Sequence[tuple[int, bytes]]) -> bool:
        end = time.monotonic() + 1.0
        while len(self.arm.heard) < len(said) and time.monotonic() < end:
            time.sleep(0.01)
        return [(i, data) for _, i, data in list(self.arm.heard)[: len(said)]] == list(said)

    @staticmethod
    def _moved(heard: Sequence[tuple[float, int, bytes]], began: float) -> bool:
        targets: dict[int, set[bytes]] = {}
        for at, arbitration_id, data in heard:
            if at > began and arbitration_id in frames.JOINT_TARGETS:
                targets.setdefault(arbitration_id, set()).add(data)
        return any(len(seen) > 1 for seen in targets.values())


def judge_frames(sent: Sequence[tuple[int, bytes]]) -> list[str]:
    """Forbidden frames that were sent, in words: stops, resets, disabled motors, standby, and unknown commands."""
    problems = []
    for arbitration_id, data in sent:
        if reason := frames.ends_power(arbitration_id, data):
            problems.append(f"{reason} was sent ({arbitration_id:03X} {data.hex()})")
    return problems


class _PlannerError(Exception):
    def __init__(self) -> None:
        super().__init__("the planner broke")
        self.at = time.monotonic()


class _Raising(MotionPlanner):
    """Breaks at the first call after a moment."""

    def __init__(self, arm: Any, after: float) -> None:
        super().__init__(arm)
        self._moment = time.monotonic() + after

    def plan(self, *args: Any, **kwargs: Any) -> Any:
        """Like the real one, until it breaks; the second waypoint is never planned."""
        if time.monotonic() >= self._moment or kwargs.get("seed", 0) >= 1:
            raise _PlannerError
        return super().plan(*args, **kwargs)


class _Blind:
    """An unused camera."""

    live = False

    def observe(self, base_from_tcp: Any = None) -> Any:
        from gvla2.robot.backend import CameraFrames

        return CameraFrames((), ())

    def close(self) -> None:
        """Nothing is open."""


_CHILD = """
import sys
from tests.plugins.piper_trials import swing
swing(*sys.argv[1:])
"""


def swing(bus: str, channel: str, log: str) -> None:
    """Move an arm to and fro until interrupted: the child process of :func:`interrupted`."""
    config = PiperConfig(bus=bus, channel=channel, armed=True, log=log, speed=0.2)
    robot = Piper(config, _Blind(), lambda question: f"move {channel}")
    with contextlib.closing(robot):
        robot.reset(None, 0)
        scene = Scene((), 0.0, robot.arm.workspace)
        print("moving", flush=True)
        for side in 10 * [0.15, -0.15]:
            robot.execute(
                Trajectory((Waypoint((0.24, side, 0.07), 0.5, "swing", _DOWN, tolerance=0.01),)), scene
            )


def loop_ticks(folder: Path, channel: str, seconds: float) -> list[tuple[float, bool]]:
    """Ticks of the control loop that moves an arm in another process: the moment (monotonic), and whether it moved."""
    with _multicast_turn():
        return _loop_ticks(folder, channel, seconds)


@contextlib.contextmanager
def _multicast_turn() -> Iterator[None]:
    """One at a time on a machine: python-can's multicast groups share a port, and hear one another there."""
    with (Path(tempfile.gettempdir()) / "gvla2-piper-multicast.lock").open("a") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        yield


def _loop_ticks(folder: Path, channel: str, seconds: float) -> list[tuple[float, bool]]:
    command = [sys.executable, "-m", "gvla2_plugins.piper.virtual_arm", "--channel", channel]
    other = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    ticks: list[tuple[float, bool]] = []
    try:
        assert other.stdout is not None
        other.stdout.readline()
        log = str(folder / "jitter.jsonl")
        config = PiperConfig(bus="udp_multicast", channel=channel, armed=True, log=log, speed=0.2)
        robot = Piper(config, _Blind(), lambda question: f"move {channel}")
        with contextlib.closing(robot):
            robot.reset(None, 0)
            assert robot.session is not None
            assert robot.session.loop is not None
            robot.session.loop.tick_times = ticks
            scene, end, side = Scene((), 0.0, robot.arm.workspace), time.monotonic() + seconds, 0.15
            while time.monotonic() < end:
                stop = Waypoint((0.24, side, 0.07), 0.5, "swing", _DOWN, tolerance=0.01)
                robot.execute(Trajectory((stop,)), scene)
                side = -side
    finally:
        other.terminate()
        other.communicate(timeout=10)
    return ticks


def interrupted(folder: Path, seed: int, channel: str, window: float = 4.0) -> FaultTrial:
    """A process that moves an arm of ours over multicast is sent SIGINT at a random instant of ``window`` seconds."""
    random, trial, log = Random(seed), FaultTrial("kill -INT"), folder / f"interrupted-{seed}.jsonl"
    start = (0.0, 1.45, -1.05, 0.0, 1.05, 0.0)
    with _multicast_turn(), VirtualArm("udp_multicast", channel, joints=start, seed=seed) as arm:
        child = subprocess.Popen(
            [sys.executable, "-c", _CHILD, "udp_multicast", channel, str(log)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=Path(__file__).parents[2],
        )
        assert child.stdout is not None
        if child.stdout.readline().strip() != "moving":
            trial.problems.append(f"the child did not start: {child.communicate(timeout=30)[1][-300:]}")
            return trial
        time.sleep(random.uniform(0.0, window))
        sent = time.monotonic()
        child.send_signal(signal.SIGINT)
        try:
            _, complaint = child.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            child.kill()
            complaint = child.communicate()[1]
            trial.problems.append("the process did not end")
        before = arm.joints.copy()
        time.sleep(0.3)
        holds = [e["m"] for e in read_log(log) if e.get("event") == "hold" and e["m"] >= sent]
        trial.ending = "held" if holds else ""
        trial.latency = holds[0] - sent if holds else float("inf")
        trial.reason = complaint.strip().splitlines()[-1] if complaint.strip() else ""
        heard = [(i, d) for _, i, d in list(arm.heard)]
        trial.problems += judge_frames(heard)
        logged = logged_frames(log)
        if heard != logged:
            trial.problems.append(f"the log has {len(logged)} frames, the bus {len(heard)}")
        if not holds:
            trial.problems.append(f"no hold was sent: {complaint[-200:]}")
        if trial.latency > 0.15:
            trial.problems.append(f"held {1e3 * trial.latency:.0f} ms after the signal")
        if float(np.abs(arm.joints - before).max()) > _REST or not arm.enabled:
            trial.problems.append("the arm moves or is off")
        if "KeyboardInterrupt" not in complaint:
            trial.problems.append("the interrupt was swallowed")
    return trial
