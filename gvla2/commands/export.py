"""``gvla2 export lerobot RUNS... to=FOLDER``: runs as a data set for training."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.errors import Gvla2Error, MissingDependencyError, reading
from gvla2.io.files import visible_files
from gvla2.record.text import count

if TYPE_CHECKING:
    from gvla2.record.lerobot import Demonstration

MOST_LISTED = 5
"""How many unreadable episodes are listed."""

NO_NAME = "main"
"""A camera whose name is not known."""

USAGE = "gvla2 export lerobot RUN... to=FOLDER [only=success|failure|all]"
DESCRIPTION = """\
Write the episodes of runs as a data set of LeRobot (layout v3.0): the arm's joints and opening as state and action,
the film of each camera, the instruction; and as columns of meta/episodes the seed, the run, success, the verifier's
verdict, and stage and kind of a failure. A RUN is the folder of a run, of a sweep, or any folder above them.
only=success, the default, takes the episodes that the success check, or without one the verifier, calls a success.
Runs for training: gvla2 run -m +experiment=demonstrations task=... 'seed=range(50)'. Needs gvla2[export].
"""


def main(argv: Sequence[str]) -> int:
    """Write the data set; returns 1 when that fails, 2 for wrong usage."""
    parser = argparse.ArgumentParser("gvla2 export", usage=USAGE, description=DESCRIPTION)
    parser.add_argument("format", choices=["lerobot"])
    parser.add_argument("runs", nargs="+", metavar="RUN")
    options = dict(word.split("=", 1) for word in argv if word.startswith(("to=", "only=")))
    asked = parser.parse_args([word for word in argv if not word.startswith(("to=", "only="))])
    only = options.get("only", "success")
    if not options.get("to") or only not in ("success", "failure", "all"):
        parser.error("to=FOLDER is required, and only= is success, failure or all")
    try:
        print(export([Path(run) for run in asked.runs], Path(options["to"]), only))
    except Gvla2Error as error:
        from gvla2.commands.hydra_job import report

        return report(error)
    return 0


def export(runs: Sequence[Path], target: Path, only: str = "success") -> str:
    """Write the data set of all episodes below ``runs``; returns a sentence on what it holds and what was left out."""
    if find_spec("pyarrow") is None:
        raise MissingDependencyError("pyarrow", "gvla2 export", "pip install 'gvla2[export]'")
    from gvla2.record.lerobot import write_dataset

    episodes: list[Demonstration] = []
    left: Counter[str] = Counter()
    broken: list[str] = []
    for run in runs:
        if not run.is_dir():
            raise Gvla2Error(f"There is no folder '{run}'.")
    results = {file.resolve(): file for run in runs for file in visible_files(run, "result.json")}
    for file in results.values():
        try:
            with reading("an episode", file.parent, Gvla2Error):
                found = _episode(file.parent, only)
        except Gvla2Error as error:
            broken.append(str(error))
            continue
        if isinstance(found, str):
            left[found] += 1
        elif found is not None:
            episodes.append(found)
    reasons = ", ".join(f"{count} {why}" for why, count in left.items())
    if broken:
        listed = " ".join(broken[:MOST_LISTED])
        reasons = f"{f'{reasons}, ' if reasons else ''}{len(broken)} unreadable: {listed}"
    if not episodes:
        why = reasons.rstrip(".") or "no episodes"
        raise Gvla2Error(f"Nothing to export below {', '.join(map(str, runs))}: {why}.")
    write_dataset(target, sorted(episodes, key=lambda one: (one.labels["seed"], one.labels["run"])))
    frames = sum(len(episode.states) for episode in episodes)
    left_out = f"; left out: {reasons}" if reasons else ""
    return f"{count(len(episodes), 'episode')}, {frames} frames: {target}{left_out}"


def _episode(folder: Path, only: str) -> Demonstration | str | None:
    """The episode of a run's folder, or why it is left out; None for a summary above several."""
    import numpy as np

    from gvla2.io.foreign import read_arrays
    from gvla2.record.lerobot import Demonstration, VideoFile
    from gvla2.record.motion import FILM, STATES

    result = json.loads((folder / "result.json").read_text(encoding="utf-8-sig"))
    if not isinstance(result, dict) or "episode" not in result:
        return None
    judged = result.get("success")
    succeeded = result.get("verdict") == "verified_success" if judged is None else judged
    if only not in ("all", "success" if succeeded else "failure"):
        return "succeeded" if succeeded else "not succeeded"
    for name, what in ((FILM, "without a film"), (STATES, "without states")):
        if not (folder / name).is_file():
            return what
    if not -(2**63) <= int(result.get("seed", -1)) < 2**63:
        return "with a seed of more than 64 bits"
    if len(result.get("attempts", ())) > 1:  # the arm goes home in between, unfilmed
        return "in several attempts"
    arrays = ("joints", "gripper_width", "fps", "command")
    kept = read_arrays(folder / STATES, "the states", arrays, Gvla2Error)
    states = np.column_stack([kept["joints"], kept["gripper_width"]]).astype(np.float32)
    commands = kept["command"].astype(np.float32) if "command" in kept else None
    urdf, cameras = _source(folder, result)
    failure = result.get("failure") or {}
    labels = {
        "seed": int(result.get("seed", -1)),
        "environment": result.get("task") or "",
        "run": "/".join(folder.absolute().parts[-2:]),
        "success": bool(succeeded),
        "verdict": result.get("verdict") or "",
        "failure_stage": failure.get("stage", ""),
        "failure": failure.get("kind", ""),
    }
    film = VideoFile.read(folder / FILM, cameras)
    return Demonstration(
        states,
        float(kept["fps"]),
        film,
        str(result["instruction"]).encode(errors="replace").decode(),  # of a command line that was not UTF-8
        str(result["robot"]),
        urdf,
        commands,
        labels,
    )


def _source(folder: Path, result: Mapping[str, Any]) -> tuple[str, tuple[str, ...]]:
    """The arm's file, and the cameras that filmed it."""
    from omegaconf import OmegaConf

    config = folder / "config.yaml"
    found = OmegaConf.load(config) if config.is_file() else OmegaConf.create()
    options: Any = OmegaConf.to_container(found)  # unresolved: another's file may name our environment
    robot = options.get("robot") or result.get("robot_options") or {}
    cameras = list(robot.get("cameras") or ())[:1]
    if robot.get("video_cameras") and not result.get("policy"):  # a policy is filmed by the first camera
        cameras = list(robot["video_cameras"])
    urdf = f"urdf {robot['urdf']}" if robot.get("urdf") else ""
    return urdf, tuple(cameras) or (NO_NAME,)
