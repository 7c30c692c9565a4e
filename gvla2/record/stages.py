"""The JSON and the file of each part of a record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

from gvla2.episode.memory_reporting import kept
from gvla2.episode.record import EpisodeRecord
from gvla2.io.files import plain
from gvla2.planning.contracts import Plan
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory


def _fields(thing: Any, *without: str) -> dict[str, Any]:
    return {f.name: plain(getattr(thing, f.name)) for f in fields(thing) if f.name not in without}


def scene_json(scene: Scene) -> dict[str, Any]:
    """The scene X_t with each object's pose, size and keypoints, metres; point clouds only as their counts."""
    things = [
        {**_fields(o, "points"), "points": len(o.points), "keypoints": plain(o.keypoints())}
        for o in scene.objects
    ]
    return {**_fields(scene, "objects"), "objects": things}


def plan_json(plan: Plan) -> dict[str, Any]:
    """The plan without its trajectory, which has its own file."""
    return {
        **_fields(plan, "trajectory", "transcript", "program"),
        "transcript": kept(plan.transcript),
        "waypoints": len(plan.trajectory) if plan.trajectory is not None else 0,
        "program": plan.program.to_json() if plan.program else None,
    }


def trajectory_json(trajectory: Trajectory) -> dict[str, Any]:
    """The paper's view tau = [(x, y, z, g)], metres and opening in [0, 1], and the full waypoints."""
    return {"frame": "world", "tau": plain(trajectory.xyzg()), "waypoints": trajectory.to_json()}


def attempt_json(attempt: EpisodeRecord) -> dict[str, Any]:
    """One of the earlier attempts, or parts of a program: what was planned, executed and found."""
    parts = ("plan.json", "trajectory.json", "report.json", "verdict.json")
    made = {name.removesuffix(".json"): STAGE_FILES[name](attempt) for name in parts}
    return {**attempt.attempted(), **made, "parts": [attempt_json(part) for part in attempt.parts]}


Writer = Callable[[EpisodeRecord], Any]


def _of(name: str, write: Callable[[Any], Any] = plain) -> Writer:
    """The field of the record of that name ("plan.trajectory") as JSON; None while it is empty."""

    def content(record: EpisodeRecord) -> Any:
        made: Any = record
        for part in name.split("."):
            made = getattr(made, part, None)
        return write(made) if made is not None and made != () else None

    return content


STAGE_FILES: Mapping[str, Writer] = {
    "scene.json": _of("scene", scene_json),
    "recalled.json": _of("recalled"),
    "plan.json": _of("plan", plan_json),
    "trajectory.json": _of("plan.trajectory", trajectory_json),
    "checks.json": _of("checks", lambda checks: checks.to_json()),
    "report.json": _of("report", lambda report: report.to_json()),
    "scene_after.json": _of("after_scene", scene_json),
    "attempts.json": _of("attempts", lambda records: list(map(attempt_json, records))),
    "parts.json": _of("parts", lambda records: list(map(attempt_json, records))),
    "verdict.json": _of("verdict"),
    "learned.json": _of("learned"),
}
"""The content of each file, None while the record lacks it, in the order of the loop."""
