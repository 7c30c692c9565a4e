"""Pick an object up, place it, or put it over a post: approach, grasp, lift, carry over everything, lower, let go.

To put a hole over a post, the fingers close on two opposite sides, which centres the hole between them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.planning.contracts import Abstention
from gvla2.planning.part_hierarchy import CLEAR
from gvla2.planning.relations import ASLANT
from gvla2.planning.scene import ROUND, SIDES, SceneObject
from gvla2.planning.skill import Job, Proposal
from gvla2.planning.trajectory import Guard, Trajectory
from gvla2.skills.grasps import grasps, standing
from gvla2.skills.mechanisms import UP
from gvla2.skills.proposals import Grasp, Path

LEANING = 0.03
"""A stuck object that leans by a smaller share of its length is lifted straight up."""
PARTLY = (0.7, 0.4, 0.0)
"""Shares of its lean by which such an object is turned upright where the arm cannot turn it all the way."""
BENT = 0.15
"""Deduction from the preference for a lift that is not straight: it takes longer."""

TURNS = (0.0, 0.5 * np.pi, -0.5 * np.pi)
"""Turns of the object on its way, radians: one may be within the wrist's limits if another is not."""
DROPS = (0.02, 0.045)
"""Metres by which an object falls into a container where the hand finds no room lower down."""
DOWNWARD = -0.8
"""The z of an approach that comes down between neighbours, at most."""
WALL = 0.015
"""Gap to the walls of a section of a container that are not seen, metres."""
FLOOR = 0.01
"""Assumed thickness of a container's floor that was not seen, metres."""
ALIKE = 1.15
"""An object whose sides differ by less than this factor may lie either way."""
ASIDE = (0.035, -0.035, 0.06, -0.06)
"""Shifts along a side, metres."""
OFF_MIDDLE = 0.015
"""How far off the middle of what carries it an object may at least stand, metres."""
SIDE_GAP = 0.03
"""Gap between objects put beside one another, metres: room for a finger."""

FILLED = 0.004
"""Distance between the points that fill a hole, metres."""
LEAST_ROOM = 0.001
"""A hole that fits is wider than the post by this much at least, metres."""
BOTTOM = Guard(force=20.0)
"""Lowering ends on contact with the bottom, or with the post's end beside the hole: more force would jam it."""
FREE_TURNS = (0.0, 0.5 * np.pi, -0.5 * np.pi, np.pi)


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
        path, touching = take(job, grasp), job.own | job.resting
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


def take(
    job: Job,
    grasp: Grasp,
    touching: frozenset[str] | None = None,
    stage: str = "grasp",
    *,
    between: bool = False,
) -> Path:
    """The stages up to the closed hand around the object, not yet lifted. ``touching`` are the allowed contacts, by
    default the theme and its parts; ``stage`` names the last motion before the hand closes. ``between``: the hand comes
    straight down between taller neighbours, to which planned motions keep more distance.
    """
    theta, theme = job.theta, job.own | job.around if touching is None else touching
    # At this distance along the approach the fingertips are a standoff away from the object's top.
    reach = job.theme.top - grasp.centre[2] + job.hand.tip_beyond_tcp if grasp.back is None else grasp.back
    depth = reach + theta["standoff"]
    path = Path(theta["speed"], theta["contact_speed"], grasp.orientation)
    start = grasp.centre - grasp.approach * depth
    if between:
        over = job.highest(job.theme.centre) + CLEAR + job.hand.tip_beyond_tcp - start[2]
        above = start + grasp.approach * max(over, 0.0) / grasp.approach[2]
        path.go("approach", above, gripper=grasp.opening)
        path.line("descend", start)
    else:
        path.go("approach", start, gripper=grasp.opening)
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
    path.line("draw", out, allowed=job.own | job.resting, slow=True)
    return np.asarray(out)


@dataclass(frozen=True)
class Way:
    """How an object is taken and put down: ``straight`` up, or around what is above it; the hand coming down
    ``between`` taller neighbours; let go of ``drop`` metres higher than usual. A known one that leans is turned
    ``upright`` by that share of its lean.
    """

    straight: bool = True
    between: bool = False
    drop: float = 0.0
    upright: float = 1.0


def propose_place(job: Job) -> list[Proposal] | Abstention:
    """Each grasp with each spot and turn of the object at the goal."""
    found = grasps(job)
    if isinstance(found, Abstention):
        return found
    turns, spots = _turns(job), goal_spots(job)
    ways = [
        (Way(), spots),
        (Way(straight=False), spots),
        (Way(), _aside(job, spots)),
        (Way(between=True), spots),
    ]
    if np.linalg.norm(job.theme.righting) > ASLANT:
        ways += [(Way(upright=share), spots) for share in PARTLY]
    if job.goal is not None and job.goal.opening > 0.0:
        ways += [(Way(between=between, drop=drop), spots) for drop in DROPS for between in (False, True)]
    return [
        _place(job, grasp, spot, name, turn, way, reserve=k > 0)
        for k, (way, where) in enumerate(ways)
        for grasp in found
        if not way.between or grasp.approach[2] < DOWNWARD
        for spot, name in where
        for turn in turns
    ]


def _aside(job: Job, spots: list[tuple[FloatArray, str]]) -> list[tuple[FloatArray, str]]:
    """Further along the goal's sides, or off its middle, for where something else is there or beside it."""
    goal, theme, found = job.goal, job.theme, list[tuple[FloatArray, str]]()
    if goal is None:
        return found
    if job.relation in ("on", "in", "to"):
        if job.target is not None:
            return _nearer(job, goal, spots)
        size = float(theme.extents[:1].max() if theme.shape in ROUND else np.linalg.norm(theme.extents[:2]))
        free = 0.5 * ((goal.opening or float(goal.extents[:2].min())) - size)
        shift = 0.8 * free if job.relation == "in" else max(0.8 * free, OFF_MIDDLE)
        ways = (
            [sign * goal.world_from_object[:3, k] for k in (0, 1) for sign in (1, -1)] if shift > 0.0 else []
        )
        return [
            (spot + shift * way, f"{name}, {100 * shift:.0f} cm off the middle")
            for spot, name in spots
            for way in ways
        ]
    for spot, name in spots:
        level = (spot - goal.centre) * [1.0, 1.0, 0.0]
        along = np.cross(UP, level / np.linalg.norm(level))
        found += [(spot + shift * along, f"{name}, {100 * shift:.0f} cm aside") for shift in ASIDE]
    return found


def _nearer(job: Job, goal: SceneObject, spots: list[tuple[FloatArray, str]]) -> list[tuple[FloatArray, str]]:
    """A place in a section of the goal, half as wide as it, moved towards the arm as far as the theme has room."""
    size, axes = float(job.theme.extents[:2].max()), goal.world_from_object[:3, :2].T
    found = []
    for spot, name in spots:
        back = np.array([*(job.foot() - spot[:2]), 0.0])
        rooms = [max(0.0, 0.25 * side - 0.5 * size - WALL) for side in goal.extents[:2]]
        steps = [float(np.sign(back @ axis)) * room * axis for axis, room in zip(axes, rooms, strict=True)]
        found += [(spot + share * sum(steps), f"{name}, nearer to the arm") for share in (0.5, 1.0)]
    return found


def _turns(job: Job) -> list[float]:
    """Turns of the theme on its way, radians. If it shares the goal with others, it lies across the row that they stand
    in, which leaves them the most room.
    """
    theme, goal = job.theme, job.goal
    if theme.shape in ROUND:
        return [0.0]
    level = [i for i in range(3) if abs(theme.world_from_object[2, i]) < 0.5]
    if job.share[1] == 1 or goal is None or len(level) != 2:
        return list(TURNS)
    long, short = sorted(level, key=lambda i: -theme.extents[i])
    along, line = theme.world_from_object[:2, long], goal.world_from_object[:2, 0]
    across = float(np.arctan2(line[1], line[0]) - np.arctan2(along[1], along[0]) + 0.5 * np.pi)
    quarters = range(4) if theme.extents[long] < ALIKE * theme.extents[short] else (0, 2)
    turns = [float((across + 0.5 * np.pi * k + np.pi) % (2 * np.pi) - np.pi) for k in quarters]
    return sorted(turns, key=abs)


def goal_spots(job: Job) -> list[tuple[FloatArray, str]]:
    """Spots for the theme's centre (x, y, and the support's height z), each with its description, best first."""
    table = job.scene.table_height
    if job.goal is None:
        if job.target is None:
            raise ValueError("A goal or a target is needed to place something.")
        return [(np.array([*job.target, table]), "there")]
    goal, theme = job.goal, job.theme
    if job.relation in ("on", "in", "to"):
        support = table if goal.shape == "region" else goal.top
        middle = (goal.centre + _share(job, goal))[:2] if job.target is None else job.target
        return [(np.array([*middle, support]), "onto it")]
    spots = []
    for side in SIDES:
        if job.relation in (side, "beside", ""):
            way = job.scene.side(side)
            # Half the diagonal of the theme, since it may be turned.
            outline = theme.extents[:1] if theme.shape in ROUND else theme.extents[:2]
            reach = goal.half_along(way) + 0.5 * np.linalg.norm(outline)
            spot = goal.centre + way * (reach + SIDE_GAP)
            spots.append((np.array([*spot[:2], table]), side.replace("_", " ")))
    return spots


def _share(job: Job, goal: SceneObject) -> FloatArray:
    """(3,) from the goal's middle to the place of the k-th of several objects in it."""
    rank, count = job.share
    along = 0.44 * (rank - 0.5 * (count - 1)) * (goal.opening or float(goal.extents[:2].min()))
    return np.asarray(along * goal.world_from_object[:3, 0])


def support_of(job: Job, grasp: Grasp, spot: FloatArray) -> float:
    """The height of the theme's support at the spot: inside a container, as low as the hand fits."""
    goal, theme, hand = job.goal, job.theme, job.hand
    if goal is None or spot[2] < goal.top - 1e-6 or theme.extents[:2].max() > goal.opening:
        return float(spot[2])
    local = transform_points(invert_rigid(goal.world_from_object), goal.points)
    near, reach = np.zeros(2), 0.4 * goal.opening
    if job.target is not None:
        near = transform_points(invert_rigid(goal.world_from_object), spot)[:2]
        reach = 0.5 * float(theme.extents[:2].max())
    within = goal.points[(np.abs(local[:, :2] - near) < reach).all(axis=1)] if len(local) else goal.points
    floor = float(np.median(within[:, 2])) if len(within) else goal.bottom + FLOOR
    hangs = grasp.centre[2] - theme.bottom
    palm = goal.top + 0.01 - (hand.finger_length - hand.tip_beyond_tcp) - hangs
    aside = float(np.abs(spot[:2] - goal.centre[:2]).max())
    spread = 0.5 * hand.max_width * release_opening(job, grasp) + hand.finger_thickness + 0.01
    tips = goal.top + 0.004 + hand.tip_beyond_tcp - hangs if aside + spread > 0.5 * goal.opening else floor
    return float(min(goal.top, max(floor, palm, tips)))


def _place(
    job: Job, grasp: Grasp, spot: FloatArray, where: str, turn: float, how: Way, *, reserve: bool
) -> Proposal:
    """Take the theme, carry it over the spot (3,), and put it down."""

    def way() -> Trajectory:
        upright, held = righted(job, grasp, how.upright)
        over = over_spot(upright, held, spot, turn)
        path = brought(job, grasp, over, how)
        put_down(upright, path, held, over, spot, how.drop)
        return path.trajectory()

    named = f"{grasp.description}; put down {where}" + (f", turned {np.degrees(turn):.0f}°" if turn else "")
    preference = grasp.preference - 0.05 * (turn != 0.0) - how.drop - 0.5 * (1.0 - how.upright)
    if job.share[1] > 1 and job.goal is not None:  # fingers between the objects need room, too
        closing = Rotation.from_euler("z", turn).apply(grasp.closing)
        preference -= 0.1 * abs(float(closing @ job.goal.world_from_object[:3, 0]))
    named += "" if how.straight else ", around what is above it"
    named += ", from between its neighbours" if how.between else ""
    named += f", dropped by {1e3 * how.drop:.0f} mm" if how.drop else ""
    named += f", turned upright by {100 * how.upright:.0f} %" if how.upright < 1.0 else ""
    return Proposal(named, grasp.approaches, preference, way, reserve=reserve)


def righted(job: Job, grasp: Grasp, share: float = 1.0) -> tuple[Job, Grasp]:
    """The job and the grasp as they are when the hand has turned a theme that leans upright, by a share of its lean."""
    upright, about = standing(job.theme, share)
    closing, approach = about[:3, :3] @ grasp.closing, about[:3, :3] @ grasp.approach
    held = replace(grasp, centre=transform_points(about, grasp.centre), closing=closing, approach=approach)
    return replace(job, theme=upright), held


def brought(job: Job, grasp: Grasp, over: Grasp, how: Way = Way()) -> Path:
    """The path from the approach to the grasp ``over`` the spot."""
    path = take(job, grasp, between=how.between)
    out = draw_out(job, path, grasp)
    up = np.array([*out[:2], over.centre[2]])
    if not how.straight:  # back the way that the hand came, unless the theme stands in something
        up = out + (job.rise + 2 * CLEAR) * (UP if job.rise > 0.0 else -grasp.approach)
    path.line("lift", up, allowed=job.own | job.resting)
    carry(path, over)
    return path


def over_spot(job: Job, grasp: Grasp, spot: FloatArray, turn: float) -> Grasp:
    """The grasp when the theme, turned by ``turn``, is over the spot (3,) and above everything."""
    theme = job.theme
    hangs = grasp.centre[2] - theme.bottom  # from the tool down to the object's underside
    height = min(max(job.highest(spot), theme.bottom) + job.theta["transit_clearance"] + hangs, job.ceiling())
    rotation = Rotation.from_euler("z", turn)
    offset = rotation.apply(grasp.centre - theme.centre)
    over = np.array([*(spot + offset)[:2], height])
    closing, approach = rotation.apply(grasp.closing), rotation.apply(grasp.approach)
    return replace(grasp, centre=over, closing=closing, approach=approach)


def carry(path: Path, over: Grasp) -> None:
    """Turn the hand to its orientation at the goal, and go over it."""
    path.orientation = over.orientation
    path.go("transit", over.centre)


def put_down(job: Job, path: Path, grasp: Grasp, over: Grasp, spot: FloatArray, drop: float = 0.0) -> None:
    """From over the spot (3,): lower, let go ``drop`` metres above where it would stand, retreat along the approach."""
    theta, hangs = job.theta, grasp.centre[2] - job.theme.bottom
    height = support_of(job, grasp, spot) + theta["place_height"] + drop + hangs
    down = np.array([*over.centre[:2], max(height, job.lowest_tcp())])
    touching = job.own | {"table"}
    if job.goal is not None:
        touching |= job.scene.family(job.goal.id)
    path.line("place", down, allowed=touching, slow=True)
    away = down - over.approach * (theta["standoff"] + theta["grasp_depth"])
    let_go(path, down, away, release_opening(job, grasp), touching)


def release_opening(job: Job, grasp: Grasp) -> float:
    """How far the hand opens to let go, in [0, 1]: in a container no further than it must."""
    inside = job.goal is not None and job.goal.opening > 0.0 and grasp.width > 0.0
    least = (grasp.width + 2 * job.grasp.snug) / job.hand.max_width
    return min(grasp.opening, least) if inside else grasp.opening


def fits_over(obj: SceneObject, post: SceneObject) -> bool:
    """Whether a flat object's hole is wider than a post that is taller than the object."""
    flat = obj.extents[2] < 0.6 * float(obj.extents[:2].min())
    slim = float(np.sort(post.extents[:2])[1]) + LEAST_ROOM < obj.opening
    return flat and obj.opening > 0.0 and slim and post.extents[2] > obj.extents[2]


def propose_insert(job: Job) -> list[Proposal] | Abstention:
    """Each grasp from above with each turn that aligns the hole with the post."""
    if job.goal is None or not fits_over(job.theme, job.goal):
        what = "anything" if job.goal is None else f"the {job.goal.label}"
        return Abstention("other", f"The {job.theme.label} has no hole that fits over {what}.")
    found = grasps(replace(job, theme=_filled(job.theme)))
    if isinstance(found, Abstention):
        return found
    turns = aligning_turns(job.theme, job.goal)
    return [_insert(job, grasp, job.goal, turn) for grasp in found if grasp.family == "top" for turn in turns]


def _filled(theme: SceneObject) -> SceneObject:
    """The theme with its hole filled, for grasps without a finger where the post is to go."""
    steps = np.linspace(-0.5, 0.5, 2 + int(theme.opening / FILLED))
    around = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    around = theme.opening * around[np.linalg.norm(around, axis=1) <= 0.5]
    heights = theme.extents[2] * np.array([0.1, 0.49])
    layers = [np.column_stack([around, np.full(len(around), height)]) for height in heights]
    points = transform_points(theme.world_from_object, np.concatenate(layers))
    return replace(theme, points=np.concatenate([theme.points, points]), opening=0.0)


def aligning_turns(theme: SceneObject, post: SceneObject) -> list[float]:
    """Turns about the vertical, radians, that make the hole's sides parallel to the post's; smallest first."""
    if post.shape in ROUND or theme.shape in ROUND:
        return list(FREE_TURNS)
    (a, b) = (float(np.arctan2(o.world_from_object[1, 0], o.world_from_object[0, 0])) for o in (theme, post))
    turns = [float((b - a + quarter + np.pi) % (2 * np.pi) - np.pi) for quarter in FREE_TURNS]
    return sorted(turns, key=abs)


def _insert(job: Job, grasp: Grasp, post: SceneObject, turn: float) -> Proposal:
    def way() -> Trajectory:
        over = over_spot(job, grasp, post.centre, turn)
        path = brought(job, grasp, over)
        lower_over(job, path, grasp, over.centre)
        return path.trajectory()

    how = f"{grasp.description}; over the {post.label}, turned {np.degrees(turn):.0f}°"
    preference = grasp.preference - 0.05 * abs(turn) / np.pi
    return Proposal(how, grasp.approaches, preference, way)


def lower_over(job: Job, path: Path, grasp: Grasp, above: FloatArray) -> None:
    """From ``above`` (3,), with the theme's hole over the goal, a post: align, lower, let go, retreat."""
    theme, post = job.theme, job.goal
    assert post is not None
    hangs = grasp.centre[2] - theme.bottom
    touching = job.own | job.scene.family(post.id)
    down = np.array([*above[:2], max(post.top - job.theta["insert_depth"] + hangs, job.lowest_tcp())])
    path.line("align", np.array([*above[:2], post.top + 0.01 + hangs]), allowed=touching)
    path.line("insert", down, allowed=touching, slow=True, guard=BOTTOM)
    let_go(path, down, above, grasp.opening, touching)
