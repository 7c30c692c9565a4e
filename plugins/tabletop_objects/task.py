"""Episodes with scanned objects: their layout and the instruction."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.robot.placing import clear, in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.scan import Scan, chosen, mesh_library, read_scan, scanned_body, spoken
from gvla2.robot.solids import lowest
from gvla2.robot.task import Body, Layout, TaskInstance, TaskSite
from gvla2_plugins.tabletop_objects import TabletopObjectsConfig
from gvla2_plugins.tabletop_objects.asking import (
    WORDINGS,
    ObjectRequest,
    interpret,
    sentence_for,
    success_check,
)

MOST = 8
GAP = 0.03
"""Metres between objects, at least."""

SPOTS = 60
"""Number of places tried for an object beside those already placed, before all are drawn again."""

LIFT = 0.20
"""Heights above the table that the hand must reach at an object's place, metres."""

DENSITY, LIGHTEST, HEAVIEST = 250.0, 0.02, 0.6
"""Kilograms per cubic metre of an object's hull, and bounds in kilograms: household objects are hollow or light."""

DROP = 0.001
"""Metres above the table from which objects settle."""


POSES = ("upright", "fallen")


class TabletopObjects:
    """Implements :class:`gvla2.robot.task.Task` for a folder of meshes; see :mod:`.asking` for what counts as done.

    Raises :class:`ConfigurationError` for an invalid folder, names or options; an unusable mesh raises when an episode
    needs it.
    """

    def __init__(self, config: TabletopObjectsConfig) -> None:
        objects = config.objects
        self._library = chosen(mesh_library(objects.root), objects.names)
        self._config, self._objects = config, objects
        count = (len(self._library) if objects.names else 1) if objects.count is None else objects.count
        if not 1 <= count <= MOST or count > len(self._library):
            raise ConfigurationError(
                f"task.objects.count is {count}; it is 1 to {MOST}, and no more than the {len(self._library)} objects "
                "there are to choose from."
            )
        if objects.pose not in POSES:
            raise ConfigurationError(
                f"task.objects.pose is '{objects.pose}'; it is one of {', '.join(POSES)}."
            )
        if config.ask not in WORDINGS:
            raise ConfigurationError(f"task.ask is '{config.ask}'; it is one of {', '.join(WORDINGS)}.")
        self._count = count
        labels = [spoken(name) for name in self._library]
        double = sorted({label for label in labels if labels.count(label) > 1})
        if double:
            raise ConfigurationError(f"Two objects are both called '{double[0]}'; rename one of their files.")

    @property
    def instructions(self) -> tuple[str, ...]:
        """The wordings of what may be asked."""
        return WORDINGS[self._config.ask]

    def sample(
        self, rng: np.random.Generator, site: TaskSite, instruction: str | None = None
    ) -> TaskInstance:
        """One episode; a given ``instruction`` decides the goal as far as it names objects on the table."""
        names = [list(self._library)[i] for i in rng.permutation(len(self._library))[: self._count]]
        turned = [self._turned(name, rng) for name in names]
        for body in turned:
            _check_size(body, site)
        asked, aside = self._asked(turned, rng), ""
        bodies = self._placed(turned, asked, rng, site)
        labels = {body.name: body.label for body in bodies}
        sentence = sentence_for(asked, labels, rng)
        if instruction is not None:
            sentence, (asked, aside) = instruction, interpret(instruction, labels, asked)
        succeeded, goal = success_check(asked, bodies, site.table_height)
        return TaskInstance(sentence, Layout(tuple(bodies)), succeeded, f"{goal}{aside}")

    def _turned(self, name: str, rng: np.random.Generator) -> Body:
        """The object at the origin, in its final orientation."""
        objects = self._objects
        path = self._library[name]
        scan = read_scan(path, objects.scale)
        mass = objects.mass if objects.mass is not None else _mass(scan)
        rotation = planar((0.0, 0.0), 0.0, float(rng.uniform(-np.pi, np.pi)))[:3, :3]
        if objects.pose == "fallen":
            rotation = fallen(scan.hull, _middle(scan), rng)
        return scanned_body(
            path,
            name,
            rigid(rotation),
            scale=objects.scale,
            mass=mass,
            friction=objects.friction,
            label=spoken(name),
        )

    def _asked(self, bodies: list[Body], rng: np.random.Generator) -> ObjectRequest:
        """A request for some of these objects."""
        lift = [ObjectRequest("lift", body.name) for body in bodies]
        offered = lift if self._config.ask == "lift" else _put_in(bodies)
        if offered:
            return offered[int(rng.integers(len(offered)))]
        there = ", ".join(body.label for body in bodies)
        raise ConfigurationError(
            f"task.ask={self._config.ask} needs an object that is open at its top, and another that fits into it; "
            f"there are only {there}. Choose other names or a larger task.objects.count."
        )

    def _placed(
        self, objects: list[Body], asked: ObjectRequest, rng: np.random.Generator, site: TaskSite
    ) -> list[Body]:
        """The objects in place."""
        radii = [_radius(body) for body in objects]
        handled = {asked.theme, asked.goal}
        widest_first = sorted(range(len(objects)), key=lambda k: -radii[k])

        def fits(k: int, spot: FloatArray, before: dict[int, FloatArray]) -> bool:
            spots = np.stack([*(root[:2, 3] for root in before.values()), spot])
            return (
                inside(site, spot, min(radii[k], 0.15))
                and clear(spots, [*(radii[j] for j in before), radii[k]], GAP)
                and (objects[k].name not in handled or in_reach(site, spot, (0.02, LIFT)))
            )

        def draw() -> list[FloatArray] | None:
            roots: dict[int, FloatArray] = {}
            for k in widest_first:
                tried = (sample_root(rng, site) for _ in range(SPOTS))
                root = next((r for r in tried if fits(k, r[:2, 3], roots)), None)
                if root is None:
                    return None
                roots[k] = root
            return [roots[k] for k in range(len(objects))]

        roots = sample_until(draw, f"{len(objects)} objects", tries=150)
        return [_set_down(body, root, site) for body, root in zip(objects, roots, strict=True)]


def _put_in(bodies: list[Body]) -> list[ObjectRequest]:
    mouths = {body.name: mouth(_scan(body), body.world_from_body) for body in bodies}
    return [
        ObjectRequest("put_in", body.name, goal.name)
        for goal, body in permutations(bodies, 2)
        if sorted(_scan(body).size)[1] < mouths[goal.name]
    ]


def _set_down(body: Body, root: FloatArray, site: TaskSite) -> Body:
    """The body at the place of ``root``, its lowest point on the table."""
    pose = rigid(body.world_from_body[:3, :3], (*root[:2, 3], 0.0))
    pose[2, 3] = site.table_height + DROP - lowest(_scan(body), pose)
    return replace(body, world_from_body=pose)


def _radius(body: Body) -> float:
    """Of the circle about its middle that holds it, seen from above, metres."""
    return float(np.linalg.norm(_outline(body), axis=1).max())


def _outline(body: Body) -> FloatArray:
    """(N, 2) its hull's corners seen from above, about its origin."""
    return (_scan(body).hull @ body.world_from_body[:3, :3].T)[:, :2]


def _check_size(body: Body, site: TaskSite) -> None:
    sides = np.ptp(_outline(body), axis=0)
    if min(sides) > min(site.size) or max(sides) > max(site.size):
        raise ConfigurationError(
            f"The {body.label} covers {sides[0]:.2f} x {sides[1]:.2f} m, more than the {site.size[0]:.2f} x "
            f"{site.size[1]:.2f} m of the table that the arm reaches. Choose another, or a smaller task.objects.scale."
        )


def _mass(scan: Scan) -> float:
    try:
        volume = float(ConvexHull(scan.hull).volume)
    except QhullError:
        volume = 0.0
    return float(np.clip(DENSITY * volume, LIGHTEST, HEAVIEST))


def _scan(body: Body) -> Scan:
    solid = body.solids[0]
    assert isinstance(solid, Scan)
    return solid


CELL = 0.008
"""Side of the vertical columns that are sampled, metres."""

DEEP, INNER = 0.45, 0.35
"""A vessel's bottom is lower than this share of its height; it is looked for within this share of its half width."""


def mouth(scan: Scan, pose: FloatArray) -> float:
    """Width of the opening at the top of the object, posed at ``pose`` (4, 4), metres; 0 if it is closed or shallow.

    Seen from straight above: the lowest surface in sight about its middle is its bottom, and the wall rises all
    about it. A plate counts: what lies on it lies in it.
    """
    points, _ = scan.textured.mesh.sample(20_000, np.random.default_rng(0))
    points = transform_points(pose, points)
    low, high = points.min(axis=0), points.max(axis=0)
    half, middle = 0.5 * (high - low)[:2], 0.5 * (high + low)[:2]
    columns = np.floor((points[:, :2] - low[:2]) / CELL).astype(int)
    key = columns[:, 0] * 10_000 + columns[:, 1]
    order = np.lexsort((points[:, 2], key))
    tops = order[np.flatnonzero(np.diff(key[order], append=-1))]  # the highest of each column
    seen, height = points[tops], float(high[2] - low[2])
    level = (seen[:, 2] - low[2]) / max(height, 1e-9)
    out = np.abs(seen[:, :2] - middle) / half
    inner = (out < INNER).all(axis=1)
    if not inner.any() or np.median(level[inner]) > DEEP:
        return 0.0
    away = seen[:, :2] - middle
    turn = np.floor((np.arctan2(away[:, 1], away[:, 0]) + np.pi) / (np.pi / 6)).astype(int) % 12
    reach = np.linalg.norm(away, axis=1)
    walls = [reach[(turn == k) & (level > 0.75)] for k in range(12)]
    if any(len(wall) == 0 for wall in walls):
        return 0.0
    nearest = np.array([wall.min() for wall in walls])
    return float(2.0 * nearest.min())


def fallen(hull: FloatArray, centre: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A rotation (3, 3), its z axis up, in which an object dropped at random comes to rest on a plane.

    ``hull`` (N, 3) are the corners of its convex hull and ``centre`` (3,) its centre of mass, one frame, metres. It
    lands on some face and rolls over the edge beyond which its centre lies, until its centre is above the face:
    quasi-static, without momentum (Goldberg et al. 1999, "Part pose statistics"). Any rotation about z is equally
    likely.
    """
    turn = Rotation.random(random_state=rng).as_matrix()
    try:
        solid = ConvexHull(hull)
    except QhullError:  # flat: it lies on one side or the other
        _, _, axes = np.linalg.svd(hull - hull.mean(axis=0), full_matrices=False)
        down = axes[2] * (1.0 if rng.random() < 0.5 else -1.0)
        return _standing(down, turn)
    normals, offsets = solid.equations[:, :3], solid.equations[:, 3]
    slope = normals @ (-turn[2])
    height = -(offsets + normals @ centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        face = int(np.argmin(np.where(slope > 1e-9, height / slope, np.inf)))
    for _ in range(len(normals)):
        corners = solid.points[solid.simplices[face]]
        foot = centre + height[face] * normals[face]
        over = _edge_beyond(corners, foot, normals[face])
        if over is None:
            break
        beyond = int(solid.neighbors[face][over])
        if height[beyond] > height[face] + 1e-12:
            break
        face = beyond
    return _standing(normals[face], turn)


def _edge_beyond(corners: FloatArray, foot: FloatArray, normal: FloatArray) -> int | None:
    """The number of the corner whose opposite edge the point ``foot`` (3,) lies farthest beyond; None when inside."""
    worst, found = 1e-9, None
    for k in range(3):
        apex, a, b = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
        aside = np.cross(b - a, normal)
        aside = aside / max(float(np.linalg.norm(aside)), 1e-12)
        if (apex - a) @ aside > 0:
            aside = -aside
        if (foot - a) @ aside > worst:
            worst, found = float((foot - a) @ aside), k
    return found


def _standing(down: FloatArray, turn: FloatArray) -> FloatArray:
    """The rotation that brings an object's direction ``down`` (3,) to -z, turned about z at random by ``turn``."""
    aligned, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [down])
    yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    return np.asarray((Rotation.from_euler("z", yaw) * aligned).as_matrix())


def _middle(scan: Scan) -> FloatArray:
    """(3,) the mean of its surface: where the weight of an object of even walls is."""
    mesh = scan.textured.mesh
    return np.asarray(np.average(mesh.vertices[mesh.faces].mean(axis=1), axis=0, weights=mesh.areas))
