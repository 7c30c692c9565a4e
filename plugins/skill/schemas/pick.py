"""Pick: approach, reach around it, close, lift."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.trajectory import Orientation
from gvla2_plugins.skill.proposals import Job, Path, Proposal, horizontal, pointing

GRASP_PLAY = 0.006
"""The opened hand must be wider than the object by this much, metres: 2 mm of perceived width and 2 mm a side."""
SNUG = 0.008
"""Room on each side of a hand that is not opened fully, metres."""
LEANS = {"top": 0.0, "leaning": 0.35, "side": 0.9}
"""Further lean of each family of approaches, radians: none; enough for the wrist's limits; and enough to come from
the side, which is no longer from the top."""
STEEP = 0.7
"""A hand whose pointing direction goes down by less than this share comes from the side."""
BENT = 0.15
"""What a lift that is not straight costs of the preference: more time with the object in the air."""
YAWS = 8


@dataclass(frozen=True)
class Grasp:
    """A way to take hold: fingers closing along ``closing`` (3,) over ``width`` metres, hand opened to ``opening``.

    ``approach`` (3,) is the direction of the hand; ``centre`` (3,) where the tool centre point goes.
    """

    description: str
    family: str
    closing: FloatArray
    approach: FloatArray
    centre: FloatArray
    width: float
    opening: float
    preference: float

    @property
    def approaches(self) -> tuple[str, ...]:
        """The names by which memory may forbid it."""
        whence = "top" if -self.approach[2] > STEEP else "side"
        return tuple(dict.fromkeys((f"approach:{whence}", f"approach:{self.family}")))

    @property
    def orientation(self) -> Orientation:
        """The hand's orientation."""
        return pointing(self.closing, self.approach)


def propose_pick(job: Job) -> list[Proposal] | Abstention:
    """One proposal a grasp; ``too_wide`` when the hand does not fit around the object anywhere."""
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    return [_pick(job, grasp, straight) for straight in (True, False) for grasp in found]


def _pick(job: Job, grasp: Grasp, straight: bool) -> Proposal:
    """Lifted in one straight move; or, close to the arm's foot where such a line is short, out straight and then
    by a planned move.
    """
    path, touching = take(job, grasp), frozenset({job.theme.id, "table"})
    wanted = grasp.centre[2] + job.theta["lift_height"]
    height = min(wanted, job.ceiling())
    up = np.array([*grasp.centre[:2], height])
    if straight:
        path.line("lift", up, allowed=touching)
    else:
        out = np.array([*up[:2], min(grasp.centre[2] + job.theta["standoff"], height)])
        path.line("lift", out, allowed=touching).go("raise", up)
    notes = () if height > wanted - 1e-6 else (f"The lift ends at the workspace's ceiling, {height:.3f} m.",)
    how = grasp.description + ("" if straight else ", raised by a planned move")
    preference = grasp.preference - (0.0 if straight else BENT)
    return Proposal(how, grasp.approaches, preference, path.trajectory(), notes)


def take(job: Job, grasp: Grasp) -> Path:
    """The stages that end with the object in the closed hand, not yet lifted."""
    theta, theme = job.theta, frozenset({job.theme.id})
    # So far back along the approach that the fingertips' end is a standoff above the object's top.
    depth = (job.theme.top - grasp.centre[2]) + job.hand.tip_beyond_tcp + theta["standoff"]
    path = Path(theta["speed"], theta["contact_speed"], grasp.orientation)
    path.go("approach", grasp.centre - grasp.approach * depth, gripper=grasp.opening)
    path.line("grasp", grasp.centre, allowed=theme, slow=True)
    path.line("close", grasp.centre, gripper=0.0, allowed=theme, slow=True)
    path.carries = job.theme.id
    return path


def grasps(job: Job) -> list[Grasp] | Abstention:
    """Grasps from above across each pair of faces that the hand fits around; any yaw for round things."""
    sides = list(_sides(job))
    fitting = [s for s in sides if s[1] + GRASP_PLAY <= job.hand.max_width]
    if not fitting:
        width = min(s[1] for s in sides)
        return Abstention(
            "too_wide",
            f"The {job.theme.label} is {width * 1000:.0f} mm wide at its narrowest, with {GRASP_PLAY * 1000:.0f} mm of "
            f"play the hand opens {job.hand.max_width * 1000:.0f} mm: it cannot be grasped from above.",
        )
    found = []
    for closing, width, name in fitting:
        for family, lean in LEANS.items():
            tilt = min(job.theta["approach_tilt"] + lean, 0.5 * np.pi)
            for opening, grip in ((1.0, ""), (_snug(job, width), ", hand opened just enough")):
                found.append(_grasp(job, closing, width, name, family, tilt, opening, grip))
    return found


def _snug(job: Job, width: float) -> float:
    return min(1.0, (width + 2 * SNUG) / job.hand.max_width)


def _sides(job: Job) -> Iterator[tuple[FloatArray, float, str]]:
    """Closing direction (3,), width and name of each way to turn the hand about the vertical."""
    theme = job.theme
    if theme.shape in ("cylinder", "disc", "sphere"):
        for k in range(YAWS):
            angle = 2 * np.pi * k / YAWS
            yield horizontal(angle), float(theme.extents[:2].max()), f"yaw {np.degrees(angle):.0f}°"
        return
    axes = theme.world_from_object[:3, :3]
    level = [i for i in range(3) if abs(axes[2, i]) < 0.5]
    for i in level:
        flat = axes[:, i] * [1.0, 1.0, 0.0]
        flat = flat / np.linalg.norm(flat)
        for sign, flip in ((1.0, ""), (-1.0, " turned round")):
            yield sign * flat, float(theme.extents[i]), f"across its {theme.extents[i] * 1000:.0f} mm{flip}"


def _grasp(
    job: Job,
    closing: FloatArray,
    width: float,
    name: str,
    family: str,
    tilt: float,
    opening: float,
    grip: str,
) -> Grasp:
    theme, theta = job.theme, job.theta
    beside = np.array([-closing[1], closing[0], 0.0])  # level, across the closing direction
    if beside @ job.outward() < 0:
        beside = -beside
    approach = np.array([0.0, 0.0, -np.cos(tilt)]) + np.sin(tilt) * beside
    along = 0.0
    if theme.shape not in ("cylinder", "disc", "sphere"):
        # The other level side of the box: along it the hand may slide.
        length = abs(beside @ theme.world_from_object[:3, :3]) @ theme.extents
        along = (theta["grasp_fraction"] - 0.5) * max(0.0, length - job.hand.finger_breadth)
    spread = max(0.0, job.hand.tip_beyond_tcp * np.cos(tilt) + 0.5 * job.hand.finger_breadth * np.sin(tilt))
    lowest = job.lowest_tcp() - job.hand.tip_beyond_tcp + spread
    height = max(theme.top - theta["grasp_depth"], lowest)
    centre = np.array([*theme.centre[:2], height]) + along * beside
    preference = 0.9 - 0.3 * width / job.hand.max_width - 0.5 * LEANS[family] - 0.1 * (opening < 1.0)
    where = {"top": "from above", "leaning": "from above, leaning", "side": "from the side"}[family]
    return Grasp(
        f"grasp {where}, {name}{grip}", family, closing, approach, centre, width, opening, preference
    )
