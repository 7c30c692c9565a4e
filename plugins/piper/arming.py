"""From a listening connection to an arm that may move: checks, a typed word, power, and a hold."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from gvla2.errors import RobotError
from gvla2_plugins.piper.arm import HIGH, LOW
from gvla2_plugins.piper.feedback import Snapshot
from gvla2_plugins.piper.link import PiperLink
from gvla2_plugins.piper.watch import Watch

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
    assert first.joints is not None
    assert seen.joints is not None
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
            assert seen.joints is not None
            link.move_joints(seen.joints)
            link.joint_mode()
            link.move_joints(seen.joints)
        time.sleep(0.02)
