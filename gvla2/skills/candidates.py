"""Candidates: proposals that the arm was asked about, ranked, and the first that passes every check."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import IKSolution
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Candidate, PlanRequest
from gvla2.planning.effects import Effect
from gvla2.planning.findings import CheckReport
from gvla2.skills.proposals import Proposal

LIMIT_COMFORT, EASE, ROOM = 0.5, 0.64, 0.04
"""Distance to joint limits (radians), manipulability (share of the best) and clearance (metres) that are enough."""

LEAP = 2.0
"""A joint that would turn by more than this on one straight way leaps to another of the arm's postures, radians."""


@dataclass(frozen=True)
class Ranking:
    """All candidates, best first, and the proposal to execute; None when none passed."""

    candidates: tuple[Candidate, ...]
    chosen: Proposal | None

    def reasons(self) -> str:
        """Why none passed: each different reason once, the best candidates' first."""
        seen = dict.fromkeys(c.rejected for c in self.candidates if c.rejected)
        return "; ".join(list(seen)[:3]) or "there was no candidate"


def choose(
    proposals: Sequence[Proposal],
    request: PlanRequest,
    skill: str,
    parameters: Mapping[str, float],
    tries: int,
    lengths: Mapping[str, float],
) -> Ranking:
    """Rank proposals by their geometry and the arm's ease, and check the best ones in full until one passes.

    Score = preference + 0.2 margin to joint limits + 0.1 manipulability + 0.2 clearance, each at its worst
    waypoint, relative to what is comfortable and capped there.
    After a rejection by the checks, the candidate that was answered then is passed over. Proposals kept in reserve
    are ranked by themselves when none of the others passed.
    """
    forbidden = _forbidden(request.advice.effects, skill)
    reach = _Reach(request)
    candidates: list[Candidate] = []
    chosen: Proposal | None = None
    passed_over = not request.rejections
    unreached: dict[bytes, str] = {}
    for reserve in (False, True):
        if chosen is not None:
            break  # the arm is asked about what is kept in reserve only when nothing else will do
        scored = [(*_ease(p, request, reach), p) for p in proposals if p.reserve == reserve]
        scored.sort(key=lambda item: -item[0])  # stable: equal scores keep the schema's order
        tried = 0
        for score, trouble, proposal in scored:
            rejected = next(
                (f"memory forbids {a} ({forbidden[a]})" for a in proposal.approaches if a in forbidden), ""
            )
            rejected = rejected or trouble
            poses = b"".join(pose.tobytes() for pose in proposal.trajectory.poses(request.start))
            rejected = rejected or unreached.get(poses, "")
            if not rejected and chosen is None:
                if tried < tries:
                    tried += 1
                    report = _check(proposal, request, skill, parameters, lengths)
                    rejected = " ".join(report.reasons)
                    failed = {f.check for f in report.findings if not f.passed}
                    if failed == {"kinematics"}:  # nor will the same poses with the hand opened otherwise do
                        unreached[poses] = rejected
                else:
                    rejected = f"not checked: {tries} better ones were"
                if not rejected and not passed_over:
                    passed_over, rejected = True, "rejected by the checks: " + "; ".join(request.rejections)
                if not rejected:
                    chosen = proposal
            candidates.append(
                Candidate(proposal.description, round(float(score), 4), rejected, proposal.approaches)
            )
    return Ranking(tuple(candidates), chosen)


def _forbidden(effects: Sequence[Effect], skill: str) -> dict[str, str]:
    return {
        e.parameter: e.source or "remembered"
        for e in effects
        if e.kind == "forbid" and e.skill in ("", skill)
    }


class _Reach:
    """Inverse kinematics that remembers: candidates share poses."""

    def __init__(self, request: PlanRequest) -> None:
        self._arm, self._scene = request.arm, request.scene
        self._known: dict[tuple[bytes, bytes], IKSolution | None] = {}

    def inside(self, xyz: FloatArray) -> bool:
        """Whether both workspaces have the point (3,)."""
        return bool(self._arm.workspace.contains(xyz, -1e-6) & self._scene.workspace.contains(xyz, -1e-6))

    def __call__(self, pose: FloatArray, near: FloatArray) -> IKSolution | None:
        key = (pose.tobytes(), near.tobytes())
        if key not in self._known:
            self._known[key] = self._arm.inverse(pose, near=near) if self.inside(pose[:3, 3]) else None
        return self._known[key]


def _ease(proposal: Proposal, request: PlanRequest, reach: _Reach) -> tuple[float, str]:
    """The score, and why the arm cannot do it at all ("" when it can get to every waypoint)."""
    arm, scene = request.arm, request.scene
    margin, manipulability, room = LIMIT_COMFORT, EASE, ROOM
    near, opening = request.joints, 1.0
    for waypoint, pose in zip(proposal.trajectory, proposal.trajectory.poses(request.start), strict=True):
        solution = reach(pose, near)
        if solution is None:
            xyz = ", ".join(f"{v:.2f}" for v in waypoint.xyz)
            why = "out of the arm's reach" if reach.inside(pose[:3, 3]) else "outside the workspace"
            return round(proposal.preference - 1.0, 4), f"{waypoint.stage} at ({xyz}) is {why}"
        if waypoint.motion == "linear" and np.abs(solution.joints - near).max() > LEAP:
            why = "the arm gets there in another posture only, not in a straight line"
            return round(proposal.preference - 1.0, 4), f"{waypoint.stage}: {why}"
        margin, manipulability = (
            min(margin, solution.limit_margin),
            min(manipulability, solution.manipulability),
        )
        touching = waypoint.allowed_contacts | ({waypoint.carries} if waypoint.carries else set())
        room = min(room, arm.clearance(solution.joints, opening, scene, frozenset(touching)).distance)
        near, opening = solution.joints, waypoint.gripper
    ease = (
        0.2 * max(0.0, margin) / LIMIT_COMFORT + 0.1 * manipulability / EASE + 0.2 * max(-ROOM, room) / ROOM
    )
    return round(float(proposal.preference + ease), 4), ""


def _check(
    proposal: Proposal,
    request: PlanRequest,
    skill: str,
    parameters: Mapping[str, float],
    lengths: Mapping[str, float],
) -> CheckReport:
    """What the checks say."""
    return check_trajectory(
        proposal.trajectory,
        request.scene,
        request.arm,
        request.start,
        request.joints,
        effects=request.advice.effects,
        parameters=parameters,
        skill=skill,
        lengths=lengths,
    )
