"""What each part of a record is as JSON, and the file it goes to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from gvla2.planning.contracts import Plan
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.record.contents import EpisodeRecord
from gvla2.record.conversation import kept
from gvla2.record.files import plain


def scene_json(scene: Scene) -> dict[str, Any]:
    """The scene X_t with each object's pose, size and keypoints, metres; point clouds only as their counts."""
    return {
        "perceiver": scene.perceiver,
        "table_height": scene.table_height,
        "workspace": {"low": plain(scene.workspace.low), "high": plain(scene.workspace.high)},
        "notes": list(scene.notes),
        "objects": [
            {
                "id": o.id,
                "label": o.label,
                "shape": o.shape,
                "colour": o.colour,
                "rgb": plain(o.rgb),
                "world_from_object": plain(o.world_from_object),
                "extents": plain(o.extents),
                "keypoints": plain(o.keypoints()),
                "points": len(o.points),
                "parent": o.parent,
                "confidence": o.confidence,
                "named_by": o.named_by,
                "sureness": o.sureness,
                "known": None
                if o.known is None
                else {
                    "name": o.known.name,
                    "path": o.known.path,
                    "world_from_scan": plain(o.known.world_from_scan),
                    "scale": o.known.scale,
                    "residual": o.known.residual,
                },
            }
            for o in scene.objects
        ],
    }


def plan_json(plan: Plan) -> dict[str, Any]:
    """The plan without its trajectory, which has a file of its own."""
    return {
        "skill": plan.skill,
        "roles": dict(plan.roles),
        "parameters": dict(plan.parameters),
        "scales": {name: list(scale) for name, scale in plan.scales.items()},
        "candidates": [asdict(c) for c in plan.candidates],
        "abstention": asdict(plan.abstention) if plan.abstention else None,
        "notes": list(plan.notes),
        "fallback": plan.fallback,
        "transcript": kept(plan.transcript),
        "waypoints": len(plan.trajectory) if plan.trajectory is not None else 0,
        "calls": [asdict(call) for call in plan.calls],
        "remaining": [asdict(call) for call in plan.remaining],
        "options": asdict(plan.options),
        "program": plan.program.to_json() if plan.program else None,
    }


def trajectory_json(trajectory: Trajectory) -> dict[str, Any]:
    """The paper's view tau = [(x, y, z, g)], metres and opening in [0, 1], and the full waypoints."""
    return {"frame": "world", "tau": plain(trajectory.xyzg()), "waypoints": trajectory.to_json()}


def attempt_json(attempt: EpisodeRecord) -> dict[str, Any]:
    """One of the earlier attempts, or parts of a program: what was planned, executed and found."""
    plan = attempt.plan
    return {
        **attempt.attempted(),
        "plan": plan_json(plan) if plan else None,
        "trajectory": trajectory_json(plan.trajectory) if plan and plan.trajectory is not None else None,
        "report": attempt.report.to_json() if attempt.report else None,
        "verdict": asdict(attempt.verdict) if attempt.verdict else None,
        "parts": [attempt_json(part) for part in attempt.parts],
    }


Writer = Callable[[EpisodeRecord], Any]

STAGE_FILES: tuple[tuple[str, str, Writer], ...] = (
    ("scene.json", "the perceived scene", lambda r: scene_json(r.scene) if r.scene else None),
    ("recalled.json", "what memory offered", lambda r: asdict(r.recalled) if r.recalled else None),
    ("plan.json", "skill, roles, parameters, candidates", lambda r: plan_json(r.plan) if r.plan else None),
    (
        "trajectory.json",
        "the waypoints",
        lambda r: trajectory_json(r.plan.trajectory) if r.plan and r.plan.trajectory is not None else None,
    ),
    ("checks.json", "findings of the six checks", lambda r: r.checks.to_json() if r.checks else None),
    (
        "report.json",
        "the execution, waypoint by waypoint",
        lambda r: r.report.to_json() if r.report else None,
    ),
    (
        "scene_after.json",
        "the scene perceived afterwards",
        lambda r: scene_json(r.after_scene) if r.after_scene else None,
    ),
    (
        "attempts.json",
        "the attempts before the last, each with its plan and report",
        lambda r: [attempt_json(each) for each in r.attempts] or None,
    ),
    (
        "parts.json",
        "the parts of the program before the last, each with its plan and report",
        lambda r: [attempt_json(each) for each in r.parts] or None,
    ),
    ("verdict.json", "the verifier's verdict", lambda r: asdict(r.verdict) if r.verdict else None),
    ("learned.json", "what memory learnt", lambda r: asdict(r.learned) if r.learned else None),
)
"""(file, what it is, its content or None while the record lacks it), in the order of the loop."""
