"""A connection to one arm for one run: opened, checked, armed on request, and closed with the arm still held."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from gvla2.errors import RobotError
from gvla2_plugins.piper import PiperConfig, frames
from gvla2_plugins.piper.arm import HIGH, LOW, SLACK, Bounds
from gvla2_plugins.piper.feedback import Snapshot, Watch
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.loop import ControlLoop
from gvla2_plugins.piper.writer import CommandLog, WriterLock, default_log

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
    outside = np.maximum(LOW - seen.joints, seen.joints - HIGH)
    drift = float(np.abs(seen.joints - first.joints).max())
    why = ""
    if seen.zeros:
        why = (
            "all six joints read exactly 0, as firmware without data reports. Power-cycle the arm (hold it!)"
        )
    elif seen.foreign:
        why = f"another program commands it (frame {seen.foreign}). End that program first"
    elif seen.unbelievable:
        why = f"its measurements can't be believed: {seen.unbelievable}"
    elif seen.joint_age > 0.1:
        why = f"its joint feedback is {1e3 * seen.joint_age:.0f} ms old"
    elif wrong := Watch.condition(seen, armed=False):
        why = f"{wrong}. Clear it with the maker's tool while somebody holds the arm"
    elif outside.max() > SLACK:
        why = f"joint {int(outside.argmax()) + 1} is {outside.max():.3f} rad outside its limits"
    elif drift > STILL:
        why = f"it moved by {drift:.3f} rad while listening: another program commands it, or somebody moves it manually"
    if why:
        raise RobotError(f"Nothing was sent to the arm: {why}.")
    return seen


def ask_person(question: str) -> str:
    """The answer typed on the terminal; raises :class:`RobotError` without a terminal."""
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
    link.feedback.forget_trouble()
    link.gate.open_gate()
    asked = time.monotonic()
    link.ask()
    why = ""
    while link.feedback.snapshot().answered < asked and not why:
        if time.monotonic() - asked > ANSWER_SECONDS:
            why = f"it did not answer a query within {1e3 * ANSWER_SECONDS:.0f} ms: frames are late or lost"
        time.sleep(0.002)
    began = time.monotonic()
    while not why:
        seen = link.feedback.snapshot()
        if all(seen.enabled) and seen.control == frames.CAN_CONTROL:
            return seen
        elapsed = time.monotonic() - began
        if not all(seen.enabled):
            link.enable(everything=elapsed > 1.0)
        else:
            # The measured pose is sent before CAN control is taken, so the arm cannot move to an older target.
            link.move_joints(seen.joints)
            link.joint_mode()
            link.move_joints(seen.joints)
        time.sleep(0.02)
        why = seen.foreign or seen.unbelievable or link.gate.trouble
        if elapsed > ENABLE_SECONDS:
            off = [i + 1 for i, on in enumerate(seen.enabled) if not on]
            why = f"the motors of joints {off} stayed off" if off else "no CAN control"
    link.gate.shut_gate()
    raise RobotError(f"The arm could not be armed: {why}. Nothing was moved.")


class Session:
    """Opens in the constructor; ``loop`` is the running control loop of an armed arm, None in a dry run.

    ``ask`` gets the arming question and returns what was typed.
    """

    def __init__(self, config: PiperConfig, ask: Callable[[str], str] = ask_person) -> None:
        self.loop: ControlLoop | None = None
        self._handlers: dict[signal.Signals, Any] = {}
        bus, channel, log = config.bus, config.channel, None
        bounds = Bounds(config.speed, config.grip_effort)
        with ExitStack() as opened:
            if config.armed:
                lock = WriterLock(bus, channel)
                opened.callback(lock.release)
                lock.acquire()
                log = CommandLog(Path(config.log) if config.log else default_log(bus, channel))
                opened.callback(log.close)
                log.write("session", bus=bus, channel=channel, percent=bounds.percent)
            self.link = PiperLink(bus, channel, bounds, log)
            opened.callback(self.link.close)
            check_health(self.link)
            if log is not None:
                confirm(channel, bounds.percent, ask)
                seen = power_up(self.link)
                log.write("event", event="armed", joints=seen.joints.tolist())
                self.link.feedback.forget_trouble()
                self.loop = ControlLoop(self.link, Watch(config.tracking_limit), log)
                self.loop.start(seen.joints)
                opened.callback(self.loop.end)
                self._watch_signals()
            self._opened = opened.pop_all()

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
        self._opened.close()
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()
