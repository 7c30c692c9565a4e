"""A connection to one arm for one run: opened, checked, armed on request, and closed with the arm still held."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError, RobotError
from gvla2_plugins.piper import PiperConfig
from gvla2_plugins.piper.arm import HIGH, HIGHEST_GRIP_EFFORT, HIGHEST_SPEED_SHARE, LOW, Bounds
from gvla2_plugins.piper.command_log import CommandLog, default_log
from gvla2_plugins.piper.feedback import Snapshot, Watch, WatchLimits
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.lock import WriterLock
from gvla2_plugins.piper.loop import ControlLoop

LISTEN_SECONDS, STILL = 0.5, 0.01
"""An arm that moves by more than this (radians) without a command has another master."""

ANSWER_SECONDS = 0.15
"""Time limit for answering a query: beyond it, feedback is older than it seems."""

ENABLE_SECONDS = 5.0


def check_health(link: PiperLink) -> Snapshot:
    """Listen to the arm for a moment and return its state; sends nothing.

    Raises :class:`RobotError` for silence, zeros, an arm outside its limits, with a fault or in another mode, and for
    one under another program's command.
    """
    first = link.wait_for_feedback()
    time.sleep(LISTEN_SECONDS)
    seen = link.feedback.snapshot()
    refusal = "Nothing was sent to the arm: "
    if seen.zeros:
        raise RobotError(
            f"{refusal}all six joints read exactly 0, which is what firmware without data reports. Power-cycle the "
            "arm (hold it!) and read its joints with the maker's tool."
        )
    if seen.foreign:
        raise RobotError(
            f"{refusal}another program commands it (frame {seen.foreign}). End that program first."
        )
    if seen.unbelievable:
        raise RobotError(f"{refusal}its measurements can't be believed: {seen.unbelievable}.")
    if seen.joint_age > 0.1:
        raise RobotError(f"{refusal}its joint feedback is {1e3 * seen.joint_age:.0f} ms old.")
    if wrong := Watch.condition(seen, armed=False):
        raise RobotError(f"{refusal}{wrong}. Clear it with the maker's tool while somebody holds the arm.")
    outside = np.maximum(LOW - seen.joints, seen.joints - HIGH)
    if outside.max() > link.bounds.slack:
        joint = int(outside.argmax())
        raise RobotError(f"{refusal}joint {joint + 1} is {outside[joint]:.3f} rad outside its limits.")
    drift = float(np.abs(seen.joints - first.joints).max())
    if drift > STILL:
        raise RobotError(
            f"{refusal}it moved by {drift:.3f} rad while listening: another program commands it, or somebody moves it "
            f"manually."
        )
    return seen


def ask_person(question: str) -> str:
    """The answer typed on the terminal; raises :class:`RobotError` without a terminal.

    The question should end with a line break: progress may be drawn on the last line.
    """
    if not sys.stdin.isatty():
        raise RobotError("Arming needs a person at a terminal who types the answer; stdin is none.")
    print(question, end="", file=sys.stderr, flush=True)
    return sys.stdin.readline()


def confirm(channel: str, percent: int, ask: Callable[[str], str] = ask_person) -> None:
    """Ask a person to type the arming word; raises :class:`RobotError` for any other."""
    word = f"move {channel}"
    answer = ask(
        f"\nThe arm on '{channel}' will be switched on and moved, at up to {percent} % speed. Nobody within its "
        f"reach, a hand at the power switch?\nType '{word}' to arm, anything else to leave it:\n"
    )
    if answer.strip() != word:
        raise RobotError(f"The arm on '{channel}' was not armed: '{word}' was not typed. Nothing was sent.")


def power_up(link: PiperLink) -> Snapshot:
    """Open the gate, measure the answer time, switch the motors on, take CAN control of a still arm.

    Raises :class:`RobotError` when the arm answers late or a motor stays off; it is then left unchanged.
    """
    link.open_gate()
    asked = time.monotonic()
    link.ask()
    while link.feedback.snapshot().answered < asked:
        if time.monotonic() - asked > ANSWER_SECONDS:
            link.gate.shut_gate()
            raise RobotError(
                f"The arm did not answer a query within {1e3 * ANSWER_SECONDS:.0f} ms: frames are late or lost. "
                "Nothing was moved."
            )
        time.sleep(0.002)
    began = time.monotonic()
    while True:
        seen = link.feedback.snapshot()
        if all(seen.enabled) and seen.control == 1:
            return seen
        elapsed = time.monotonic() - began
        if elapsed > ENABLE_SECONDS or (seen.foreign or seen.unbelievable):
            link.gate.shut_gate()
            off = [i + 1 for i, on in enumerate(seen.enabled) if not on]
            why = (
                seen.foreign
                or seen.unbelievable
                or (f"the motors of joints {off} stayed off" if off else "no CAN control")
            )
            raise RobotError(f"The arm could not be armed: {why}. Nothing was moved.")
        if not all(seen.enabled):
            link.enable(everything=elapsed > 1.0)
        else:
            # The measured pose is sent before CAN control is taken, so the arm cannot move to an older target.
            link.move_joints(seen.joints)
            link.joint_mode()
            link.move_joints(seen.joints)
        time.sleep(0.02)


PERIOD = 0.01
"""Seconds between joint targets."""


def bounds_of(config: PiperConfig) -> Bounds:
    """The gate's bounds; raises :class:`ConfigurationError` for values beyond what this backend ever allows."""
    if not 0.0 < config.speed <= HIGHEST_SPEED_SHARE:
        raise ConfigurationError(f"robot.speed={config.speed} must lie in (0, {HIGHEST_SPEED_SHARE}].")
    if not 0.0 < config.grip_effort <= HIGHEST_GRIP_EFFORT:
        raise ConfigurationError(
            f"robot.grip_effort={config.grip_effort} must lie in (0, {HIGHEST_GRIP_EFFORT}] Nm."
        )
    return Bounds(speed_share=config.speed, grip_effort=config.grip_effort, period=PERIOD)


class Session:
    """Opens in the constructor; ``loop`` is the running control loop of an armed arm, None in a dry run.

    ``ask`` gets the arming question and returns what was typed.
    """

    def __init__(self, config: PiperConfig, ask: Callable[[str], str] = ask_person) -> None:
        self._link: PiperLink | None = None
        self.loop: ControlLoop | None = None
        self.log: CommandLog | None = None
        self._handlers: dict[signal.Signals, Any] = {}
        channel = config.channel
        self._lock = WriterLock(config.bus, channel)
        try:
            bounds = bounds_of(config)
            if config.armed:
                self._lock.acquire()
                self.log = CommandLog(
                    Path(config.log) if config.log else default_log(config.bus, config.channel)
                )
                self.log.write(
                    "session", pid=os.getpid(), bus=config.bus, channel=channel, percent=bounds.percent
                )
            self._link = PiperLink(config.bus, channel, bounds, self.log)
            check_health(self.link)
            if self.log is not None:
                confirm(channel, bounds.percent, ask)
                self._arm(config, self.link, self.log)
        except BaseException:
            self.close()
            raise

    @property
    def link(self) -> PiperLink:
        """The open connection; raises :class:`RobotError` where opening it has failed."""
        if self._link is None:
            raise RobotError("The arm is not connected.")
        return self._link

    def _arm(self, config: PiperConfig, link: PiperLink, log: CommandLog) -> None:
        seen = power_up(link)
        log.write("event", event="armed", joints=seen.joints.tolist())
        link.feedback.forget_trouble()
        watch = Watch(WatchLimits(tracking=config.tracking_limit))
        self.loop = ControlLoop(link, watch, log, PERIOD)
        self.loop.start(seen.joints)
        self._watch_signals()

    def _watch_signals(self) -> None:
        """Ctrl-C and SIGTERM hold the arm first, then do what they did before."""
        if threading.current_thread() is not threading.main_thread():
            return
        for number in (signal.SIGINT, signal.SIGTERM):
            self._handlers[number] = signal.getsignal(number)
            signal.signal(number, self._signalled)

    def _signalled(self, number: int, frame: FrameType | None) -> None:
        if self.loop is not None:
            self.loop.interrupt()
        before = self._handlers.get(signal.Signals(number))
        if not callable(before):
            raise KeyboardInterrupt
        before(number, frame)

    def close(self) -> None:
        """Hold, stop sending, release the lock. The arm stays powered where it is. Safe to call twice."""
        if self.loop is not None:
            self.loop.end()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()
        if self._link is not None:
            self._link.close()
        if self.log is not None:
            self.log.close()
        self._lock.release()
