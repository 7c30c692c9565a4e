"""A virtual Piper, an armed backend on its channel, and what was sent and logged."""

import itertools
import json
import time
from pathlib import Path

import numpy as np

from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Orientation, Trajectory, Waypoint
from gvla2.robot.backend import ExecutionListener
from gvla2_plugins.piper import PiperConfig, frames
from gvla2_plugins.piper.arm import HOME
from gvla2_plugins.piper.backend import Piper
from tests.plugins.synthetic_table import Scenery
from tests.plugins.virtual_piper import VirtualArm

DOWN = Orientation("grasp", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0))
SWIFT = {"speed": 0.2, "tool_speed": 0.25, "acceleration": 4.0}
NUMBERS = itertools.count()


def read_log(path: Path):
    """The entries of a command log in order; ``m`` is the monotonic clock."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def logged_frames(path: Path):
    """Identifier and data of every frame in a command log."""
    return [(int(e["id"], 16), bytes.fromhex(e["data"])) for e in read_log(path) if e["kind"] == "frame"]


def forbidden(sent):
    """Frames that stop, reset or disable an arm, in words."""
    return [f"{reason}: {i:03X} {data.hex()}" for i, data in sent if (reason := frames.ends_power(i, data))]


def waypoint(y=0.12, **changed):
    """A place to move to with the fingers as they are."""
    return Waypoint(**{"xyz": (0.24, y, 0.07), "gripper": 1.0, "stage": "go", "orientation": DOWN} | changed)


class Rig:
    """An external virtual arm and a backend on its channel, armed unless told otherwise."""

    def __init__(self, folder, answer=None, start=HOME, camera=None, **options):
        self.channel = f"rig-{folder.name}-{next(NUMBERS)}"
        self.log = folder / "log.jsonl"
        self.arm = VirtualArm("virtual", self.channel, joints=start).start()
        given = {"bus": "virtual", "channel": self.channel, "armed": True, "log": str(self.log), **options}
        camera = camera or Scenery(8)
        self.robot = Piper(PiperConfig(**given), camera, lambda question: answer or f"move {self.channel}")
        self.scene = Scene((), 0.0, self.robot.arm.workspace)

    def go(self, *waypoints, moment=lambda moment: None):
        """Move through waypoints; ``moment`` is called some times a second on the way."""
        return self.robot.execute(Trajectory(waypoints), self.scene, ExecutionListener(moment=moment))

    def sent(self):
        """All commands that reached the arm."""
        return [(i, data) for _, i, data in list(self.arm.heard)]

    def at_rest(self):
        """Whether the arm is powered and no longer moves."""
        time.sleep(0.15)
        before = self.arm.joints.copy()
        time.sleep(0.1)
        return self.arm.enabled and np.abs(self.arm.joints - before).max() < 2e-3

    def close(self):
        """End backend and arm."""
        self.robot.close()
        self.arm.stop()
