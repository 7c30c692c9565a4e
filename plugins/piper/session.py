"""A connection to one arm for one run: opened, checked, armed on request, and closed with the arm still held."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from gvla2.errors import ConfigurationError
from gvla2_plugins.piper import PiperConfig
from gvla2_plugins.piper.arming import ask_person, check_health, confirm, power_up
from gvla2_plugins.piper.command_log import CommandLog, default_log
from gvla2_plugins.piper.limits import HIGHEST_GRIP_EFFORT, HIGHEST_SPEED_SHARE, Bounds
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.lock import WriterLock
from gvla2_plugins.piper.loop import ControlLoop
from gvla2_plugins.piper.virtual_arm import VirtualArm
from gvla2_plugins.piper.watch import Watch, WatchLimits

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

    ``virtual`` is the simulated arm on ``bus=virtual``; that one moves without asking. ``ask`` gets the arming question
    and returns what was typed.
    """

    def __init__(self, config: PiperConfig, ask: Callable[[str], str] = ask_person) -> None:
        self.virtual: VirtualArm | None = None
        self.link: PiperLink | None = None
        self.loop: ControlLoop | None = None
        self.log: CommandLog | None = None
        self._handlers: dict[signal.Signals, Any] = {}
        own = config.bus == "virtual" and config.channel == PiperConfig.channel
        channel = f"gvla2-piper-{os.getpid()}" if own else config.channel
        self._lock = WriterLock(config.bus, channel)
        try:
            bounds = bounds_of(config)
            if config.armed:
                self._lock.acquire()
                self.log = CommandLog(
                    Path(config.log) if config.log else default_log(config.bus, config.channel)
                )
                self.log.session(
                    bus=config.bus, channel=channel, percent=bounds.percent, effort=bounds.grip_effort
                )
            if own:
                self.virtual = VirtualArm("virtual", channel).start()
            self.link = PiperLink(config.bus, channel, bounds, self.log)
            check_health(self.link)
            if config.armed:
                if not own:
                    confirm(channel, bounds.percent, ask)
                self._arm(config)
        except BaseException:
            self.close()
            raise

    def _arm(self, config: PiperConfig) -> None:
        assert self.link is not None
        assert self.log is not None
        seen = power_up(self.link)
        assert seen.joints is not None
        self.log.event("armed", joints=seen.joints.tolist())
        self.link.feedback.forget_trouble()
        watch = Watch(WatchLimits(tracking=config.tracking_limit))
        self.loop = ControlLoop(self.link, watch, self.log, PERIOD)
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
        if self.link is not None:
            self.link.close()
        if self.virtual is not None:
            self.virtual.stop()
        if self.log is not None:
            self.log.close()
        self._lock.release()
