"""Grasps: the ways a hand fits around an object, from the holds of its shape and from its seen surface.

A hold is a part that fits between the fingers from above: the whole object, between two of its faces, or the wall of a
hollow object, with one finger inside. Anything else (a nozzle, a neck, a handle) is found from the seen surface.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.planning.arm import Hand
from gvla2.planning.calls import GraspOptions
from gvla2.planning.contracts import Abstention
from gvla2.planning.part_hierarchy import holders, inside
from gvla2.planning.relations import ASLANT
from gvla2.planning.scene import ROUND, SceneObject
from gvla2.planning.skill import Job
from gvla2.skills.antipodal import WHENCE, antipodal, held_between, skin_of
from gvla2.skills.mechanisms import UP
from gvla2.skills.parameters import deepest
from gvla2.skills.proposals import Grasp, horizontal

LEANS = {"top": 0.0, "leaning": 0.35, "side": 0.9, "sloping": 0.35, "outward": 0.5}
"""Tilt of each family of approaches from straight down, radians: none, enough to help with the wrist's limits, enough
to come from the side, and, over a wall, with the hand outside, little or as far as walls slope."""
FAMILIES = {
    "": ("top", "leaning", "side"),
    "rim": ("top", "sloping", "outward"),
    "brim": ("sloping", "outward"),
}
"""Families of approaches for each part: beside a wall there is no room for a hand that leans along it,
and straight fingers slip off a plate's brim, which slopes."""

DEFAULT = GraspOptions()
PALM_ROOM, SHALLOWEST = 0.003, 0.006
"""Gap between the palm and a neighbour below it, and the least reach of the fingertips over an object, metres."""
TILTS = (0.12, -0.12, 0.24, -0.24)
"""Turns of such a hand about its fingertips, radians: one end of its palm rises, where it would meet what is higher."""
BRIM = 0.016
"""How much wider than a brim's edge the hand opens, metres: wider fingers would meet the table before they reach it."""
ASIDE, SHIFTS = 0.02, (0.35, -0.35)
"""A hold that may be shifted further than this, metres, is also tried off the middle, by these shares of it: where a
neighbour is in the hand's way. It turns in the fingers more easily, so that others are preferred."""
EITHER_WAY = ((1.0, ""), (-1.0, " turned round"))
YAWS, RIM_YAWS = 8, 16
YAW_ANGLES = np.pi * np.arange(36) / 36
FEWEST = 25
"""The fewest points that define a part's outline."""
STRAYS = (0.01, 0.99)
"""Quantiles of an object's points that bound its width; points beyond them are outliers."""


@dataclass(frozen=True)
class Hold:
    """Fingers closing along ``closing`` (3,) over ``width`` metres, at ``xy`` (2,).

    ``slide`` is how far it may be shifted along the hand's breadth, ``opening`` in [0, 1] the hand's greatest opening,
    ``cost`` a deduction from the preference, ``part`` "rim", a flat object's "brim", or "" for the whole object.
    """

    closing: FloatArray
    width: float
    name: str
    xy: FloatArray
    slide: float = 0.0
    opening: float = 1.0
    cost: float = 0.0
    part: str = ""


def has_hold(theme: SceneObject, hand: Hand) -> bool:
    """Whether the hand fits around the whole object, around a slimmer part of its height, or over its wall."""
    if _holds(theme, hand, DEFAULT):
        return True
    upper = theme.points[theme.points[:, 2] > theme.top - deepest(hand)]
    slim = np.ptp(spans(upper[:, :2], YAW_ANGLES), axis=0).min() if len(upper) >= FEWEST else np.inf
    return bool(slim + DEFAULT.clearance <= hand.max_width)


def _holds(theme: SceneObject, hand: Hand, options: GraspOptions) -> list[Hold]:
    """All holds that fit in the hand, those of the whole object first."""
    around = [h for h in whole(theme, hand) if h.width + options.clearance <= hand.max_width]
    return [*around, *wall(theme, hand, options)]


def whole(theme: SceneObject, hand: Hand) -> Iterator[Hold]:
    """Around the whole object, even if too wide: at any yaw if it is round, else by its pairs of upright faces."""
    xy = theme.centre[:2]
    if theme.shape in ROUND:
        for k in range(YAWS):
            angle = 2 * np.pi * k / YAWS
            width = float(theme.extents[:2].max())
            yield Hold(horizontal(angle), width, f"yaw {np.degrees(angle):.0f}°", xy)
        return
    axes = theme.world_from_object[:3, :3]
    for i in (i for i in range(3) if abs(axes[2, i]) < 0.5):
        flat = axes[:, i] * [1.0, 1.0, 0.0]
        flat = flat / np.linalg.norm(flat)
        width = float(theme.extents[i])
        beside = np.array([-flat[1], flat[0], 0.0])
        slide = max(0.0, float(np.abs(beside @ axes) @ theme.extents) - hand.finger_breadth)
        for sign, flip in EITHER_WAY:
            yield Hold(sign * flat, width, f"across its {width * 1000:.0f} mm{flip}", xy, slide=slide)


def wall(theme: SceneObject, hand: Hand, options: GraspOptions) -> list[Hold]:
    """By the wall of an open round object, with one finger inside if there is room for it."""
    broad = float(theme.extents[:2].max())
    room = theme.opening - hand.finger_thickness - 0.01  # between the inner finger and the opposite wall
    if theme.opening <= 0.0 or theme.shape not in ("cylinder", "disc", "other") or room < 0.01:
        return []
    thickness = max(0.002, 0.5 * (broad - theme.opening))
    spare = BRIM if theme.shape == "disc" else 2 * options.snug + 0.012
    opening = min(1.0, (thickness + min(spare, room)) / hand.max_width)
    if thickness + options.clearance > hand.max_width * opening:
        return []
    radius, part = 0.5 * (broad - thickness), "brim" if theme.shape == "disc" else "rim"
    found = []
    for k in range(RIM_YAWS):
        angle = 2 * np.pi * k / RIM_YAWS
        out = horizontal(angle)
        xy = theme.centre[:2] + radius * out[:2]
        for sign, flip in EITHER_WAY:
            name = f"by its wall at {np.degrees(angle):.0f}°{flip}"
            found.append(Hold(sign * out, thickness, name, xy, opening=opening, cost=0.1, part=part))
    return found


def spans(points: FloatArray, angles: FloatArray) -> FloatArray:
    """(2, A) lowest and highest coordinates of points (N, 2), without outliers, along directions (A,), radians."""
    ways = np.stack([np.cos(angles), np.sin(angles)])
    return np.asarray(np.quantile(ways.T @ points.T, STRAYS, axis=1))


def grasps(job: Job) -> list[Grasp] | Abstention:
    """Grasps by every hold from above, leaning or from the side, and by the surface, that the seen points allow."""
    found = []
    for hold in _holds(job.theme, job.hand, job.grasp):
        snug = min(hold.opening, (hold.width + 2 * job.grasp.snug) / job.hand.max_width)
        grips = [(hold.opening, "")]
        if snug < hold.opening:
            grips.append((snug, ", hand opened just enough"))
        for family in FAMILIES[hold.part]:
            found += [_grasp(job, hold, family, opening, grip) for opening, grip in grips]
        if hold.slide > ASIDE:
            found += [_grasp(job, hold, "top", hold.opening, ", off its middle", shift) for shift in SHIFTS]
    found += _above_neighbours(job, found)
    if not any(inside(job.theme, holder) for holder in holders(job.theme, job.scene)):
        found = _agreeing(job, found)
    if found:
        return found
    width = 1000 * min(h.width for h in whole(job.theme, job.hand))
    clearance, opening = 1000 * job.grasp.clearance, 1000 * job.hand.max_width
    return Abstention(
        "too_wide",
        f"The {job.theme.label} is {width:.0f} mm wide at its narrowest; the hand opens {opening:.0f} mm and needs "
        f"{clearance:.0f} mm of clearance: it cannot be grasped from above.",
    )


BEYOND = 0.015
"""How far the upright box of what leans reaches beyond its own, about, metres."""
SQUARE = 0.9
"""Least cosine between surface and fingers if a box or can is grasped by its surface: chords of a can too wide for the
hand, and corners of a box, would
squeeze it out. Exempt are plates, whose boxes say little about their outlines, and rims."""


def _agreeing(job: Job, boxed: list[Grasp]) -> list[Grasp]:
    """The box's grasps that agree with the object's surface: some of it between the fingers, none in their way.

    Irregular objects, those that lean, and those for which none agrees also have grasps by their surface.
    """
    skin, hand = skin_of(job.theme), job.hand

    def fits(grasp: Grasp) -> bool:
        opening = grasp.opening * hand.max_width
        return skin is None or held_between(skin, grasp.rotation, grasp.centre, opening, hand)

    found = [grasp for grasp in boxed if fits(grasp)]
    if np.linalg.norm(job.theme.righting) > ASLANT:
        return [*found, *_as_if_standing(job), *_by_surface(job)]
    if job.theme.shape in ("other", "bar"):
        return [*found, *_by_surface(job)]
    rim = job.theme.shape == "plate" or job.theme.opening > 0.0
    return found or _by_surface(job, 0.0 if rim else SQUARE) or boxed


def _by_surface(job: Job, square: float = 0.0) -> list[Grasp]:
    """Grasps by the object's surface, either way round, whose sides face the fingers by this cosine at least."""
    found, facing = list[Grasp](), max(square, job.grasp.facing)
    for one in antipodal(job.theme, job.hand, job.scene.table_height, job.outward(), facing):
        found += [one, replace(one, description=f"{one.description} turned round", closing=-one.closing)]
    return found


def _as_if_standing(job: Job) -> list[Grasp]:
    """Grasps by the surface of what leans, as they would be if it stood, turned with it."""
    upright, about = standing(job.theme)
    back = invert_rigid(about)
    return [
        replace(
            one, description=f"{one.description}, leaning with it", centre=transform_points(back, one.centre),
            closing=back[:3, :3] @ one.closing, approach=back[:3, :3] @ one.approach,
            back=(one.back or 0.0) + BEYOND,
        )
        for one in _by_surface(replace(job, theme=upright))
    ]  # fmt: skip


def standing(theme: SceneObject, share: float = 1.0) -> tuple[SceneObject, FloatArray]:
    """A known object that leans, turned upright about its middle by a share of its lean, and that motion (4, 4).

    Let go of, it falls upright about its lowest point: the middle of its box is where it will be then.
    """
    if np.linalg.norm(theme.righting) < ASLANT or (skin := skin_of(theme)) is None:
        return theme, np.eye(4)
    turn, fall = (Rotation.from_rotvec(part * theme.righting) for part in (share, 1.0 - share))
    about = rigid(turn.as_matrix(), theme.centre - turn.apply(theme.centre))
    axes = theme.world_from_object[:3, :3]
    surface = transform_points(about, skin.points) @ axes
    low, high = surface.min(axis=0), surface.max(axis=0)
    middle, foot = axes @ (0.5 * (low + high)), axes @ surface[surface[:, 2].argmin()]
    box = rigid(axes, [*(foot + fall.apply(middle - foot))[:2], middle[2]])
    return replace(theme.moved(about), world_from_object=box, extents=high - low), about


def _above_neighbours(job: Job, found: list[Grasp]) -> list[Grasp]:
    """Grasps from straight above whose palm would hit lower neighbours, as high as these require."""
    theme, hand = job.theme, job.hand
    reach = 0.5 * (hand.palm_breadth + float(theme.extents[:2].max()))
    palm = hand.finger_length - hand.tip_beyond_tcp  # from the tool up to it
    near = [
        o.top + PALM_ROOM - palm
        for o in job.scene.obstacles(job.own)
        if theme.top < o.top and float(o.distances([*theme.centre[:2], o.centre[2]])) < reach
    ]
    highest = theme.top - SHALLOWEST + hand.tip_beyond_tcp
    most = highest + 0.5 * hand.palm_breadth * np.sin(max(TILTS))
    wanted = max((height for height in near if height < most), default=-np.inf)
    blocked = [one for one in found if one.family == "top" and one.centre[2] < min(wanted, highest)]
    raised = [
        replace(
            grasp,
            description=f"{grasp.description}, above its neighbours",
            centre=np.array([*grasp.centre[:2], min(wanted, highest)]),
            preference=grasp.preference - 0.1,
        )
        for grasp in blocked
    ]
    tilts = TILTS if wanted > highest - PALM_ROOM else ()
    return [*raised, *(_tilted(grasp, tilt, wanted, highest, hand) for grasp in blocked for tilt in tilts)]


def _tilted(grasp: Grasp, tilt: float, wanted: float, highest: float, hand: Hand) -> Grasp:
    """The grasp turned about its fingertips, radians, which raises one end of the palm: so it holds deeper than at the
    height of the tool that is ``wanted`` for an upright palm, and never above the ``highest``, metres.
    """
    slope = abs(np.sin(tilt))
    lowest = grasp.centre[2] + slope * (0.5 * grasp.opening * hand.max_width + hand.finger_thickness)
    height = min(highest, max(lowest, wanted - slope * 0.5 * hand.palm_breadth))
    closing = np.cos(tilt) * grasp.closing + np.sin(tilt) * UP
    approach = np.cos(tilt) * grasp.approach + np.sin(tilt) * grasp.closing
    centre = np.array([*grasp.centre[:2], height]) + hand.tip_beyond_tcp * (grasp.approach - approach)
    return replace(
        grasp,
        description=f"{grasp.description}, tilted by {np.degrees(tilt):.0f}° over its neighbours",
        closing=closing,
        approach=approach,
        centre=centre,
        preference=grasp.preference - 0.15 - 10.0 * (height - grasp.centre[2]),
    )


def _grasp(job: Job, hold: Hold, family: str, opening: float, grip: str, shift: float = 0.0) -> Grasp:
    theme, theta, closing = job.theme, job.theta, hold.closing
    tilt = min(theta["approach_tilt"] + LEANS[family], 0.5 * np.pi)
    beside = np.array([-closing[1], closing[0], 0.0])  # level, across the closing direction
    if beside @ job.outward() < 0:
        beside = -beside
    over_wall = family in ("sloping", "outward")
    if over_wall:  # along the closing direction instead
        beside = np.array([*(theme.centre[:2] - hold.xy), 0.0])
        beside = beside / np.linalg.norm(beside)
    approach = np.array([0.0, 0.0, -np.cos(tilt)]) + np.sin(tilt) * beside
    along = (min(1.0, max(0.0, theta["grasp_fraction"] + shift)) - 0.5) * hold.slide
    aside = 0.5 * job.hand.finger_breadth
    if over_wall:
        aside = 0.5 * opening * job.hand.max_width + job.hand.finger_thickness
    spread = max(0.0, job.hand.tip_beyond_tcp * np.cos(tilt) + aside * np.sin(tilt))
    lowest = job.lowest_tcp() - job.hand.tip_beyond_tcp + spread
    height = max(theme.top - theta["grasp_depth"], lowest)
    # The hand's axis goes through the rim.
    inward = (theme.top - height) * np.tan(tilt) if over_wall else along
    centre = np.array([*hold.xy, height]) + inward * beside
    snug = 0.1 * (opening < hold.opening) + 0.5 * abs(shift)
    preference = 0.9 - 0.3 * hold.width / job.hand.max_width - 0.5 * LEANS[family] - snug - hold.cost
    how = f"grasp {WHENCE[family]}, {hold.name}{grip}"
    return Grasp(how, family, closing, approach, centre, opening, preference, width=hold.width)
