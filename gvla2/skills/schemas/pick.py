"""Pick: approach, reach around it, close, lift."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.contracts import Abstention
from gvla2.planning.trajectory import Orientation, Trajectory, grasp_rotation
from gvla2.skills.antipodal import antipodal, held_between, skin_of
from gvla2.skills.holds import EITHER_WAY, GRASP_PLAY, SNUG, Hold, holds, whole
from gvla2.skills.proposals import Job, Path, Proposal, pointing
from gvla2.skills.wholes import CLEAR, holders, inside

LEANS = {"top": 0.0, "leaning": 0.35, "side": 0.9}
"""Tilt of each family of approaches from straight down, radians: none, enough to help with the wrist's limits, and
enough to come from the side."""
STEEP = 0.7
"""A hand whose unit approach has a smaller downward component comes from the side."""
LEANING = 0.03
"""A stuck object that leans by a smaller share of its length is lifted straight up."""
BENT = 0.15
"""Deduction from the preference for a lift that is not straight: it takes longer."""
FAMILIES = {"": ("top", "leaning", "side"), "top": ("top", "leaning"), "rim": ("top",)}
"""Families of approaches for each part: a leaning hand needs room that there is none of beside a wall."""
WHENCE = {"top": "from above", "leaning": "from above, leaning", "side": "from the side"}


@dataclass(frozen=True)
class Grasp:
    """One way to grasp: fingers closing along ``closing`` (3,), the hand opened to ``opening`` in [0, 1] before.

    ``approach`` (3,) is the direction of the hand, ``centre`` (3,) the position of the tool centre point. ``back`` is
    how far along the approach the fingertips reach over the thing, metres; None for its height above the tool.
    """

    description: str
    family: str
    closing: FloatArray
    approach: FloatArray
    centre: FloatArray
    opening: float
    preference: float
    back: float | None = None

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
    """Proposals for each grasp; ``too_wide`` if the hand does not fit around the object anywhere."""
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    return [_pick(job, grasp, straight) for straight in (True, False) for grasp in found]


def _pick(job: Job, grasp: Grasp, straight: bool) -> Proposal:
    """Lift in one ``straight`` motion; or, where the arm cannot go straight up far, a short straight motion and then a
    planned one.
    """
    free_at = job.rise + CLEAR
    drawn = free_at > CLEAR  # out of something: no higher than needed
    lift = min(job.theta["lift_height"], free_at) if drawn else job.theta["lift_height"]
    wanted = grasp.centre[2] + lift
    height = min(wanted, job.ceiling())

    def way() -> Trajectory:
        path, touching = take(job, grasp), job.own() | job.resting()
        start = draw_out(job, path, grasp)
        up = np.array([*start[:2], max(height, start[2])])
        if straight:
            path.line("lift", up, allowed=touching)
        else:
            out = np.array([*up[:2], min(grasp.centre[2] + max(job.theta["standoff"], free_at), height)])
            path.line("lift", out, allowed=touching).go("raise", up)
        return path.trajectory()

    notes = () if height > wanted - 1e-6 else (f"The lift ends at the workspace's ceiling, {height:.3f} m.",)
    how = grasp.description + ("" if straight else ", raised by a planned move")
    preference = grasp.preference - (0.0 if straight else BENT)
    return Proposal(how, grasp.approaches, preference, way, notes)


def take(job: Job, grasp: Grasp, touching: frozenset[str] | None = None, stage: str = "grasp") -> Path:
    """The stages up to the closed hand around the object, not yet lifted. ``touching`` are the allowed contacts, by
    default the theme and its parts; ``stage`` names the last motion before the hand closes.
    """
    theta, theme = job.theta, job.own() if touching is None else touching
    # At this distance along the approach the fingertips are a standoff away from the object's top.
    reach = job.theme.top - grasp.centre[2] + job.hand.tip_beyond_tcp if grasp.back is None else grasp.back
    depth = reach + theta["standoff"]
    path = Path(theta["speed"], theta["contact_speed"], grasp.orientation)
    path.go("approach", grasp.centre - grasp.approach * depth, gripper=grasp.opening)
    path.line(stage, grasp.centre, allowed=theme, slow=True)
    path.line("close", grasp.centre, gripper=0.0, allowed=theme, slow=True)
    path.carries = job.theme.id
    return path


def let_go(
    path: Path,
    at: FloatArray,
    away: FloatArray,
    opening: float,
    touching: frozenset[str],
    *,
    dwell: float = 0.0,
) -> None:
    """Open the hand at ``at`` (3,) and retreat to ``away`` (3,), with ``dwell`` seconds there."""
    path.line("release", at, gripper=opening, allowed=touching, slow=True)
    path.carries = ""
    path.line("retreat", away, allowed=touching, dwell=dwell)


def draw_out(job: Job, path: Path, grasp: Grasp) -> FloatArray:
    """Draw the theme straight out of what it is stuck in; returns the tool's position (3,) then."""
    way, far = job.way_out, job.rise
    if far == 0.0 or np.hypot(*way[:2]) < LEANING:
        return grasp.centre
    out = grasp.centre + way * far / way[2]
    path.line("draw", out, allowed=job.own() | job.resting(), slow=True)
    return np.asarray(out)


def grasps(job: Job) -> list[Grasp] | Abstention:
    """Grasps by every hold from above, leaning or from the side, and by the surface, that the seen points allow."""
    found = []
    for hold in holds(job.theme, job.hand):
        snug = min(hold.opening, (hold.width + 2 * SNUG) / job.hand.max_width)
        grips = [(hold.opening, "")]
        if snug < hold.opening:
            grips.append((snug, ", hand opened just enough"))
        for family in FAMILIES[hold.part]:
            found += [_grasp(job, hold, family, opening, grip) for opening, grip in grips]
    if not any(inside(job.theme, holder) for holder in holders(job.theme, job.scene)):
        found = by_what_is_there(job, found)
    if found:
        return found
    width = min(h.width for h in whole(job.theme, job.hand))
    return Abstention(
        "too_wide",
        f"The {job.theme.label} is {width * 1000:.0f} mm wide at its narrowest, with {GRASP_PLAY * 1000:.0f} mm of "
        f"play the hand opens {job.hand.max_width * 1000:.0f} mm: it cannot be grasped from above.",
    )


SQUARE = 0.9
"""Least cosine between surface and fingers if a box or can is grasped by its surface: chords of a can too wide for the
hand, and corners of a box, would squeeze it out. Plates are exempt: their boxes say little about their outlines."""


def by_what_is_there(job: Job, boxed: list[Grasp]) -> list[Grasp]:
    """The box's grasps that agree with the object's surface. Irregular objects, and those for which none agrees, also
    have grasps by their surface.
    """
    found, irregular = felt(job, boxed), job.theme.shape in ("other", "bar")
    if irregular:
        return [*found, *by_surface(job)]
    return found or by_surface(job, 0.0 if job.theme.shape == "plate" else SQUARE) or boxed


def felt(job: Job, found: list[Grasp]) -> list[Grasp]:
    """The box's grasps with some of the object's surface between the fingers and none in their way."""
    skin = skin_of(job.theme)
    if skin is None:
        return found

    def fits(grasp: Grasp) -> bool:
        rotation, opening = grasp_rotation(grasp.approach, grasp.closing), grasp.opening * job.hand.max_width
        return held_between(skin, rotation, grasp.centre, opening, job.hand)

    return [grasp for grasp in found if fits(grasp)]


def by_surface(job: Job, square: float = 0.0) -> list[Grasp]:
    """Grasps by the object's surface, either way round, whose sides face the fingers by this cosine at least."""
    hand, found = job.hand, []
    for grasp in antipodal(job.theme, hand, job.scene.table_height, job.outward()):
        if grasp.facing < square:
            continue
        size = 1000 * grasp.width
        at = ", ".join(f"{1000 * v:.0f}" for v in (grasp.centre - job.theme.centre)[:2])
        closing = grasp.rotation[:, 1]
        yaw = np.degrees(np.arctan2(closing[1], closing[0]))
        how = f"grasp {WHENCE[grasp.family]}, {size:.0f} mm of its surface at ({at}) mm, yaw {yaw:.0f}°"
        approach, opening = grasp.rotation[:, 2], min(1.0, grasp.opening / hand.max_width)
        found += [
            Grasp(
                how + flip,
                grasp.family,
                sign * closing,
                approach,
                grasp.centre,
                opening,
                grasp.worth,
                grasp.back,
            )
            for sign, flip in EITHER_WAY
        ]
    return found


def _grasp(job: Job, hold: Hold, family: str, opening: float, grip: str) -> Grasp:
    theme, theta, closing = job.theme, job.theta, hold.closing
    tilt = min(theta["approach_tilt"] + LEANS[family], 0.5 * np.pi)
    beside = np.array([-closing[1], closing[0], 0.0])  # level, across the closing direction
    if beside @ job.outward() < 0:
        beside = -beside
    approach = np.array([0.0, 0.0, -np.cos(tilt)]) + np.sin(tilt) * beside
    along = (theta["grasp_fraction"] - 0.5) * hold.slide
    spread = max(0.0, job.hand.tip_beyond_tcp * np.cos(tilt) + 0.5 * job.hand.finger_breadth * np.sin(tilt))
    lowest = job.lowest_tcp() - job.hand.tip_beyond_tcp + spread
    height = max(theme.top - min(theta["grasp_depth"], hold.depth), lowest)
    centre = np.array([*hold.xy, height]) + along * beside
    snug = 0.1 * (opening < hold.opening)
    preference = 0.9 - 0.3 * hold.width / job.hand.max_width - 0.5 * LEANS[family] - snug - hold.cost
    how = f"grasp {WHENCE[family]}, {hold.name}{grip}"
    return Grasp(how, family, closing, approach, centre, opening, preference)
