"""Replay of a command log in simulation: the arm's commands, executed by a virtual arm.

    python -m gvla2_plugins.piper.replay LOG [--session N] [--film FILE.gif] [--robot sapien_piper]

A real log shows how far the real arm was from an ideal one; a changed limit or a new URDF can be tried on old logs.
With a simulated robot the same commands move an arm that has mass and drives.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import Gvla2Error, RobotError
from gvla2.geometry.transform import FloatArray
from gvla2.plugins.registry import load_plugins
from gvla2.robot.playback import Playback
from gvla2_plugins.piper.command_log import LogEntry, read_log
from gvla2_plugins.piper.virtual_arm import RATE, VirtualArm

TARGET_PERIOD = 0.01
"""Seconds of the log's time between targets that a simulated robot is sent."""

FILM_RATE = 5.0
"""Pictures a second of the log's time."""


@dataclass(frozen=True)
class ReplayedSession:
    """One session, replayed. ``times`` (N,) seconds from its first joints, at which the arm was measured; ``measured``
    and ``simulated`` (N, 6) radians; ``widths`` (N,) the simulated gripper, metres; ``frames`` how many commands there
    were; ``events`` what happened, in words. ``targets`` (M, 6) and ``target_widths`` (M,) are the arm's commands,
    :data:`TARGET_PERIOD` apart; ``target_rows`` (N,) the rows of them that were in force at ``times``.
    """

    times: FloatArray
    measured: FloatArray
    simulated: FloatArray
    widths: FloatArray
    frames: int
    events: tuple[str, ...]
    targets: FloatArray
    target_widths: FloatArray
    target_rows: NDArray[np.intp]

    @property
    def deviation(self) -> FloatArray:
        """(6,) largest distance of each joint between the two, radians."""
        return np.abs(self.measured - self.simulated).max(axis=0) if len(self.times) else np.zeros(6)


def sessions(path: Path) -> list[list[LogEntry]]:
    """The log cut at its session entries."""
    parts: list[list[LogEntry]] = []
    for entry in read_log(path):
        if entry.kind == "session" or not parts:
            parts.append([])
        parts[-1].append(entry)
    return parts


def replay(entries: Sequence[LogEntry]) -> ReplayedSession:
    """Carry out a session's frames at their times; raises :class:`RobotError` for one in which nothing was armed."""
    armed = next((e for e in entries if e.fields.get("event") == "armed"), None)
    if armed is None:
        raise RobotError("Nothing was armed in this session: there is nothing to replay.")
    arm = VirtualArm("virtual", f"replay-{id(entries)}", joints=armed.fields["joints"])
    now = entries[0].time
    times, measured, simulated, widths, events = [], [], [], [], []
    targets, target_rows, next_target = [], [], now
    try:
        for entry in entries:
            while now < entry.time:
                step = min(1.0 / RATE, entry.time - now)
                now += step
                arm.step(step, now)
                if now >= next_target - 1e-9:
                    targets.append(arm.targets)
                    next_target += TARGET_PERIOD
            if entry.kind == "frame":
                arm.hear(entry.arbitration_id, entry.data, entry.time)
            elif entry.kind == "event":
                events.append(f"{entry.fields['event']}: {entry.fields.get('why', '')}".rstrip(": "))
            elif entry.kind == "joints":
                times.append(entry.time)
                measured.append(entry.fields["joints"])
                simulated.append(arm.joints.copy())
                widths.append(arm.width)
                target_rows.append(max(0, len(targets) - 1))
    finally:
        arm.stop()
    count = len(times)
    return ReplayedSession(
        times=np.array(times) - (times[0] if times else 0.0),
        measured=np.array(measured).reshape(count, 6),
        simulated=np.array(simulated).reshape(count, 6),
        widths=np.array(widths),
        frames=sum(e.kind == "frame" for e in entries),
        events=tuple(events),
        targets=np.array([joints for joints, _ in targets]).reshape(len(targets), 6),
        target_widths=np.array([width for _, width in targets]),
        target_rows=np.array(target_rows, dtype=np.intp),
    )


def simulate(replayed: ReplayedSession, robot_name: str) -> FloatArray:
    """(6,) largest distance of each measured joint from a simulated robot's that got the same targets, radians.

    Raises :class:`RobotError` for a robot that plays no targets, and for a session without any.
    """
    component = load_plugins().get("robot", robot_name)
    if component.needs:
        raise RobotError(f"robot={robot_name} is not a simulation that can play a log; sapien_piper is.")
    robot = component.build(component.config(name=robot_name))
    if not isinstance(robot, Playback):
        raise RobotError(f"robot={robot_name} is not a simulation that can play a log; sapien_piper is.")
    if not len(replayed.targets) or not len(replayed.times):
        raise RobotError("The session has no measured joints: there is nothing to compare.")
    played = robot.play(replayed.targets, replayed.target_widths, TARGET_PERIOD)
    return np.asarray(np.abs(replayed.measured - played[replayed.target_rows]).max(axis=0))


def film(replayed: ReplayedSession, path: Path) -> None:
    """An animated GIF of the simulated arm; raises :class:`gvla2.errors.OutputError`."""
    import io

    from PIL import Image

    from gvla2.io.files import write_whole
    from gvla2.planning.scene import Box, Scene
    from gvla2_plugins.piper.arm import TCP_OFFSET
    from gvla2_plugins.piper.looks import ArmLooks, Preview

    scene = Scene((), 0.0, Box(np.zeros(3), np.ones(3)))
    preview = Preview(ArmLooks(np.eye(4), TCP_OFFSET), np.eye(4), scene, 240)
    wanted = np.arange(0.0, replayed.times[-1] if len(replayed.times) else 0.0, 1.0 / FILM_RATE)
    rows = np.unique(np.searchsorted(replayed.times, wanted).clip(0, max(0, len(replayed.times) - 1)))
    pictures = [
        Image.fromarray(preview.picture(replayed.simulated[i], float(replayed.widths[i]))) for i in rows
    ]
    if not pictures:
        raise RobotError("The session has no measured joints: there is nothing to film.")
    stream = io.BytesIO()
    pictures[0].save(
        stream, "GIF", save_all=True, append_images=pictures[1:], duration=int(1000 / FILM_RATE), loop=0
    )
    write_whole(path, stream.getvalue())


def main(argv: Sequence[str] | None = None) -> int:
    """Replay a session (the last one by default) and report the result."""
    parser = argparse.ArgumentParser(prog="python -m gvla2_plugins.piper.replay", description=__doc__)
    parser.add_argument("log", type=Path)
    parser.add_argument("--session", type=int, default=-1, help="which session of the log, from 0")
    parser.add_argument("--film", type=Path, help="write the simulated motion as a GIF")
    parser.add_argument("--robot", help="a simulated robot that carries the commands out too: sapien_piper")
    options = parser.parse_args(argv)
    try:
        found = sessions(options.log)
        if not found or not -len(found) <= options.session < len(found):
            raise RobotError(f"{options.log} has {len(found)} sessions, not number {options.session}.")
        replayed = replay(found[options.session])
        if options.film is not None:
            film(replayed, options.film)
        physical = None if options.robot is None else simulate(replayed, options.robot)
    except Gvla2Error as error:
        print(f"replay: {error}", file=sys.stderr)
        return 1
    seconds = replayed.times[-1] if len(replayed.times) else 0.0
    print(f"{replayed.frames} frames, {seconds:.1f} s")
    for event in replayed.events:
        print(f"  {event}")
    print("largest distance of simulated from measured, by joint, rad:", replayed.deviation.round(4).tolist())
    if physical is not None:
        print(
            f"largest distance of {options.robot} from measured, by joint, rad:", physical.round(4).tolist()
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
