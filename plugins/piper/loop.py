"""The control loop: one thread that alone sends targets, and holds the arm at the first sign of trouble."""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from gvla2.errors import RobotError
from gvla2.geometry.transform import FloatArray
from gvla2_plugins.piper.arm import PERIOD
from gvla2_plugins.piper.feedback import Watch
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.writer import CommandLog, be_urgent

SILENT_AFTER = 1.0
"""Seconds of repeated hold frames after a stop; then nothing, so as not to fight a person or a program."""

HEARTBEAT, LATENESS = 0.25, 0.1
"""How long the controlling program may be silent, and how late a tick of the loop itself may be, seconds."""

_IDLE_EVERY, _MODE_EVERY, _GRIP_EVERY = 5, 20, 10  # ticks
_LOOK = 0.02  # seconds between heartbeats of the waiting caller
_NAP = 0.02  # seconds of delay from which on a resting arm is patient
_FRESH, _FRESH_WITHIN = 0.05, 1.0
"""Seconds: how old feedback may be when a motion begins, and the wait for it."""


class SafetyStopError(RobotError):
    """The arm was brought to a hold and stays there; the message says why."""


class ControlLoop:
    """Sends one joint target every :data:`PERIOD` seconds while the arm moves, fewer while it rests.

    :meth:`move` blocks its caller and takes the caller's patience as the heartbeat. :meth:`hold` stops a motion.
    A reason found by the watch stops the arm for good: ``stopped`` holds it, ``stopped_at`` and ``held_at``
    are when it was found and when the first hold frame was out (monotonic seconds); every later motion raises
    :class:`SafetyStopError`. Nothing here resets or disables an arm.
    """

    def __init__(self, link: PiperLink, watch: Watch, log: CommandLog) -> None:
        self._link, self._watch, self._log = link, watch, log
        self._lock = threading.RLock()
        self._samples: FloatArray | None = None
        self._index = 0
        self._target: FloatArray = np.zeros(6)
        self._width: float | None = None
        self._beat = 0.0
        self._idle = threading.Event()
        self._end = threading.Event()
        self._interrupted = False
        self._thread = threading.Thread(target=self._run, name="piper-control", daemon=True)
        self._ticks, self._looked = 0, 0.0
        self._patience = 0.0  # seconds by which feedback may be older, since this process itself was late
        self._switch_interval = sys.getswitchinterval()
        self.stopped = ""
        self.stopped_at = self.held_at = 0.0

    def start(self, target: FloatArray) -> None:
        """Hold at ``target`` (6,), the measured joints, from now on; the motors are on already."""
        self._target = target.copy()
        self._looked = time.monotonic()
        # Other threads of this process yield sooner, or the loop would wait 5 ms for each of them.
        sys.setswitchinterval(1e-3)
        self._thread.start()

    def move(self, samples: FloatArray, watcher: Callable[[], None] = lambda: None) -> None:
        """Go through joint targets (T, 6), one a period, and wait; ``watcher`` is called some times per second.

        Any exception that passes through here (Ctrl-C, one of ``watcher``) holds the arm first.
        """
        self.check()
        self.rest(_FRESH_WITHIN, self._awake)
        if len(samples):
            with self._lock:
                self._samples, self._index, self._beat = samples, 0, time.monotonic()
                self._idle.clear()
            self._wait(self._idle.wait, watcher)
        self.check()

    def grip(self, width: float) -> None:
        """Set the gripper's target, metres; it stays commanded."""
        self.check()
        with self._lock:
            self._width = width
            self._link.move_gripper(width)

    def rest(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Stay at the target for ``seconds``, or until a condition holds, under the watch."""
        end = time.monotonic() + seconds

        def pause(look: float) -> bool:
            time.sleep(look)
            return until() or time.monotonic() >= end

        self._wait(pause, lambda: None)
        self.check()

    def hold(self, why: str = "asked to") -> None:
        """Stop at the last measured joints, now; works at any time, from any thread, and twice."""
        with self._lock:
            self._halt()
            self._link.move_joints(self._target)
            with contextlib.suppress(RobotError):
                self._log.write("event", event="hold", why=why)

    def interrupt(self) -> None:
        """A signal came: the next tick holds the arm, and the waiting or next caller gets a KeyboardInterrupt.

        For a signal handler, which must not wait for locks. The exception that the handler raises itself may be
        swallowed by a library whose callback it lands in; the arm is still held.
        """
        self._interrupted = True

    @property
    def target(self) -> FloatArray:
        """(6,) what is commanded now, radians."""
        with self._lock:
            return self._target.copy()

    @property
    def moving(self) -> bool:
        """Whether a motion is in progress."""
        return self._samples is not None

    def end(self) -> None:
        """Hold and end the thread; the arm stays powered and where it is. Safe to call twice."""
        if self._thread.is_alive():
            self.hold("end of the session")
            self._end.set()
            self._thread.join(1.0)
            sys.setswitchinterval(self._switch_interval)

    def _wait(self, wait: Callable[[float], bool], watcher: Callable[[], None]) -> None:
        try:
            while not wait(_LOOK):
                self._beat = time.monotonic()
                if self._interrupted:
                    raise KeyboardInterrupt
                if self._beat - self._looked > 2 * HEARTBEAT:
                    self._stop("the control loop has died", self._beat)
                if self.stopped:
                    return
                watcher()
        except BaseException as error:
            self._interrupted = False
            self.hold(f"{type(error).__name__}: {error}".rstrip(": "))
            raise

    def _awake(self) -> bool:
        return self._link.feedback.snapshot().joint_age < _FRESH and self._patience < _NAP

    def check(self) -> None:
        """Raise :class:`SafetyStopError` if the arm was stopped, KeyboardInterrupt if one was swallowed."""
        if self._interrupted:
            self._interrupted = False
            raise KeyboardInterrupt
        if self.stopped:
            raise SafetyStopError(
                f"The arm is held: {self.stopped}. It stays powered where it is. Inspect it before you start again; "
                f"the commands are in {self._log.path}."
            )

    def _run(self) -> None:
        be_urgent()
        due = time.monotonic()
        try:
            while not self._end.is_set():
                now = time.monotonic()
                self._tick(now, now - due)
                due += PERIOD
                left = due - time.monotonic()
                if left > 0:
                    time.sleep(left)
                else:
                    due = time.monotonic()
        except BaseException as error:
            self._stop(f"the control loop failed ({type(error).__name__}: {error})", time.monotonic())
            raise

    def _tick(self, now: float, late: float) -> None:
        seen = self._link.feedback.snapshot()
        with self._lock:
            self._ticks, self._looked = self._ticks + 1, now
            # After a long call into a library that lets no other thread run, a resting arm is patient for as long.
            self._patience = max(late if late > _NAP else 0.0, self._patience - PERIOD)
            if not self.stopped:
                asleep = 0.0 if self.moving else self._patience
                reason = self._watch.trouble(seen, self._target, self._link.gate.trouble, asleep)
                if not reason and self.moving:
                    reason = self._absence(now, late)
                if reason:
                    self._stop(reason, now)
                    return
                if self._interrupted and self.moving:
                    self.hold("interrupted")
            self._send(now)

    def _absence(self, now: float, late: float) -> str:
        if now - self._beat > HEARTBEAT:
            return f"the program that moves the arm was silent for {1e3 * (now - self._beat):.0f} ms"
        if late > LATENESS:
            return f"the control loop is {1e3 * late:.0f} ms late: this computer is too busy"
        return ""

    def _send(self, now: float) -> None:
        if self.stopped:
            if now - self.stopped_at < SILENT_AFTER:
                self._link.move_joints(self._target)
            return
        if self._samples is not None:
            self._target = self._samples[self._index]
            self._link.move_joints(self._target)
            self._index += 1
            if self._index >= len(self._samples):
                self._samples = None
                self._idle.set()
        elif self._ticks % _IDLE_EVERY == 0:
            self._link.move_joints(self._target)
        if self._ticks % _MODE_EVERY == 0:
            self._link.joint_mode()
        if self._width is not None and self._ticks % _GRIP_EVERY == 0:
            self._link.move_gripper(self._width)

    def _stop(self, reason: str, found: float) -> None:
        """Hold for good. The reason is logged after the first frame is out: the frame is urgent."""
        with self._lock:
            if self.stopped:
                return
            self.stopped, self.stopped_at = reason, found
            self._halt()
            self._link.move_joints(self._target)
            self.held_at = time.monotonic()
            with contextlib.suppress(RobotError):
                self._log.write("event", event="stop", why=reason, found=found, held=self.held_at)

    def _halt(self) -> None:
        measured = self._link.feedback.joints()
        if measured is not None:
            self._target = measured
        self._samples = None
        self._watch.forget()
        self._idle.set()
