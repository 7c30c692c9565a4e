"""Candidates: proposals ranked by their geometry and the arm, and the first that passes every check."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.arm import IKSolution
from gvla2.planning.checks import check_trajectory
from gvla2.planning.contracts import Candidate, PlanRequest
from gvla2.planning.effects import Ban, sides_of
from gvla2.planning.findings import CheckReport
from gvla2.planning.skill import Job, Proposal

LIMIT_COMFORT, EASE, ROOM = 0.5, 0.64, 0.04
"""Distance to joint limits (radians), manipulability and clearance (metres) beyond which more is no better."""

OVERLAP, LIKELY_BLOCKED = 0.3, 0.25
"""Deduction for postures in which the arm overlaps the scene, and the share of a try that checking them counts: the
postures of the checks may differ, but seldom do."""

LEAP = 2.0
"""A joint that turns further during one straight motion has changed to another posture of the arm, radians."""


@dataclass(frozen=True)
class Ranking:
    """All candidates, best first, and the proposal to execute; None if none passed."""

    candidates: tuple[Candidate, ...]
    chosen: Proposal | None

    def reasons(self) -> str:
        """Why none passed: the three first different reasons, best candidates first."""
        seen = dict.fromkeys(c.rejected for c in self.candidates if c.rejected)
        return "; ".join(list(seen)[:3]) or "there was no candidate"


def choose(proposals: Sequence[Proposal], request: PlanRequest, job: Job, tries: int) -> Ranking:
    """Rank proposals for a job by their geometry and the arm, and check the best ones in full until one passes.

    Score = preference + 0.2 margin to joint limits + 0.1 manipulability + 0.2 clearance, each at its worst
    waypoint, relative to a comfortable value and capped there; less if the arm overlaps the scene.
    If the request has rejections, the first candidate that passes is skipped: it was the previous answer. What failed
    earlier in the episode is not chosen again. Reserve
    proposals are ranked separately if none of the others passed.

    Inverse kinematics are solved only as far as needed to find the best. Candidates that were not followed to the end
    say so, with an upper bound of their score. But a feasible one with another approach is looked for among the next
    ``tries``, because memory forbids an approach only if there is an alternative.
    """
    forbidden = {
        e.parameter: e.source or "remembered"
        for e in request.advice.effects
        if isinstance(e, Ban) and e.skill in ("", job.skill)
    }
    reach = _Reach(request)
    candidates: list[Candidate] = []
    unreached: dict[bytes, str] = {}
    blocked: dict[tuple[object, ...], str] = {}  # by their first waypoints, which others may share
    passed_over = not request.rejections
    for reserve in (False, True):  # the reserve is for when nothing else is feasible
        walks = [_Walk(p, request, reach, forbidden) for p in proposals if p.reserve == reserve]
        tried = 0.0
        for walk in _ranked(walks):
            rejected = walk.trouble or unreached.get(walk.poses(), "")
            rejected = rejected or next((blocked[b] for b in walk.beginnings() if b in blocked), "")
            if not rejected and tried >= tries:
                rejected = f"not checked: {tries} better ones were"
            elif not rejected:
                tried += 1.0 if walk.clear else LIKELY_BLOCKED
                report = _check(walk.proposal, request, job)
                rejected = " ".join(report.reasons)
                if {f.check for f in report.findings if not f.passed} == {"kinematics"}:
                    unreached[walk.poses()] = rejected  # whatever the opening of the hand
                elif rejected:
                    first = [f.index for f in report.findings if not f.passed and f.check == "clearance"]
                    blocked[walk.beginnings()[min(first, default=-1)]] = rejected
                if not rejected and not passed_over:
                    passed_over, rejected = True, "rejected by the checks: " + "; ".join(request.rejections)
            candidates.append(walk.candidate(rejected))
            if not rejected:
                return Ranking((*candidates, *_others(walk.proposal, walks, tries)), walk.proposal)
    return Ranking(tuple(candidates), None)


def _others(chosen: Proposal, walks: Sequence[_Walk], tries: int) -> list[Candidate]:
    """The candidates after the chosen one: followed until one is feasible that avoids an approach of it."""
    instead = [
        walk
        for walk in walks
        if not walk.ranked and not (chosen.approaches and {*chosen.approaches} <= {*walk.proposal.approaches})
    ]
    found: list[Candidate] = []
    for walk in islice(_ranked(instead), tries):
        found.append(walk.candidate(walk.trouble))
        if not walk.trouble:
            break
    left = sorted((walk for walk in walks if not walk.ranked), key=lambda walk: -walk.score)
    why = "not followed to its end: it is no better"
    return [*found, *(walk.candidate(walk.trouble or why) for walk in left)]


class _Reach:
    """Inverse kinematics and clearance, cached because candidates share poses."""

    def __init__(self, request: PlanRequest) -> None:
        self._arm, self._scene = request.arm, request.scene
        self._known: dict[tuple[bytes, bytes], IKSolution | None] = {}
        self._room: dict[tuple[bytes, float, frozenset[str]], float] = {}

    def inside(self, xyz: FloatArray) -> bool:
        """Whether a point (3,) is in both workspaces."""
        return bool(self._arm.workspace.contains(xyz, -1e-6) & self._scene.workspace.contains(xyz, -1e-6))

    def __call__(self, pose: FloatArray, near: FloatArray) -> IKSolution | None:
        key = (pose.tobytes(), near.tobytes())
        if key not in self._known:
            self._known[key] = self._arm.inverse(pose, near=near) if self.inside(pose[:3, 3]) else None
        return self._known[key]

    def room(self, joints: FloatArray, opening: float, touching: frozenset[str]) -> float:
        """Clearance at joints (dof,) from everything except ``touching``, metres."""
        key = (joints.tobytes(), opening, touching)
        if key not in self._room:
            self._room[key] = self._arm.clearance(joints, opening, self._scene, touching).distance
        return self._room[key]


class _Walk:
    """A proposal that is rated waypoint by waypoint.

    ``score`` is an upper bound, exact at the last waypoint; ``trouble`` is why it is infeasible, "" as long as it is
    not known to be; ``ranked``: it was the best of those left.
    """

    def __init__(
        self, proposal: Proposal, request: PlanRequest, reach: _Reach, forbidden: Mapping[str, str]
    ) -> None:
        self.proposal, self.ranked, self.clear = proposal, False, True
        names = (f"memory forbids {a} ({forbidden[a]})" for a in proposal.approaches if a in forbidden)
        self.trouble = next(names, "")
        self._poses: list[FloatArray] = []
        self._rate(LIMIT_COMFORT, EASE, ROOM)
        self._steps = self._ways(request, reach)

    def step(self) -> bool:
        """Go on to the next waypoint; False at the end."""
        return not self.trouble and next(self._steps, False)

    def poses(self) -> bytes:
        """All tool poses so far, as a key."""
        return b"".join(pose.tobytes() for pose in self._poses)

    def beginnings(self) -> list[tuple[object, ...]]:
        """Keys of the first 1, 2, ... of its waypoints."""
        keys = [
            (pose.tobytes(), w.gripper, w.motion, w.carries, w.allowed_contacts)
            for pose, w in zip(self._poses, self.proposal.trajectory, strict=False)
        ]
        return [tuple(keys[: k + 1]) for k in range(len(keys))]

    def candidate(self, rejected: str) -> Candidate:
        """Its entry in the plan."""
        return Candidate(self.proposal.description, self.score, rejected, self.proposal.approaches)

    def _rate(self, margin: float, manipulability: float, room: float) -> None:
        ease = 0.2 * max(0.0, margin) / LIMIT_COMFORT + 0.1 * manipulability / EASE
        self.clear = room >= 0.0
        ease += 0.2 * max(-ROOM, room) / ROOM - (0.0 if self.clear else OVERLAP)
        self.score = round(float(self.proposal.preference + ease), 4)

    def _fails(self, why: str) -> None:
        self.trouble, self.score = why, round(self.proposal.preference - 1.0, 4)

    def _ways(self, request: PlanRequest, reach: _Reach) -> Iterator[bool]:
        """Rates the proposal by one more waypoint each time."""
        margin, manipulability, room = LIMIT_COMFORT, EASE, ROOM
        near, opening, trajectory = request.joints, 1.0, self.proposal.trajectory
        if request.advice.tried:
            poses = trajectory.poses(request.start)
            if any(tried.repeated(poses, trajectory) for tried in request.advice.tried):
                self._fails("an earlier attempt of this episode failed with it")
                return
        for waypoint, pose in zip(trajectory, trajectory.each_pose(request.start), strict=True):
            self._poses.append(pose)
            solution = reach(pose, near)
            if solution is None:
                xyz = ", ".join(f"{v:.2f}" for v in waypoint.xyz)
                why = "out of the arm's reach" if reach.inside(pose[:3, 3]) else "outside the workspace"
                self._fails(f"{waypoint.stage} at ({xyz}) is {why}")
                return
            if waypoint.motion == "linear" and np.abs(solution.joints - near).max() > LEAP:
                why = "the arm can get there only in another posture, not in a straight line"
                self._fails(f"{waypoint.stage}: {why}")
                return
            margin = min(margin, solution.limit_margin)
            manipulability = min(manipulability, solution.manipulability)
            touching = waypoint.allowed_contacts | ({waypoint.carries} if waypoint.carries else set())
            room = min(room, reach.room(solution.joints, opening, touching))
            self._rate(margin, manipulability, room)
            near, opening = solution.joints, waypoint.gripper
            yield True


def _ranked(walks: Iterable[_Walk]) -> Iterator[_Walk]:
    """The walks, best first, in their given order at equal scores; each is followed only as far as needed.

    A walk's score never rises, so that a completed one above the bounds of all others is the best of them.
    """
    waiting = [(-walk.score, k, walk) for k, walk in enumerate(walks)]
    heapq.heapify(waiting)
    while waiting:
        _, k, walk = waiting[0]
        if walk.step() or -walk.score > waiting[0][0]:
            heapq.heapreplace(waiting, (-walk.score, k, walk))
        else:
            heapq.heappop(waiting)
            walk.ranked = True
            yield walk


def _check(proposal: Proposal, request: PlanRequest, job: Job) -> CheckReport:
    return check_trajectory(
        proposal.trajectory,
        request.scene,
        request.arm,
        request.start,
        request.joints,
        effects=request.advice.effects,
        parameters=job.theta,
        skill=job.skill,
        lengths=sides_of(job.theme),
    )
