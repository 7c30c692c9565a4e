"""Episodes with scanned objects: their layout and the instruction."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.perception.objects import opening_of
from gvla2.robot.scan import Scan, mesh_library, read_scan, scanned_body, spoken
from gvla2.robot.solids import body_points, clear, lowest, planar, sample_root, sample_until
from gvla2.robot.task import Body, Layout, Profile, TaskInstance, TaskSite, WorldState
from gvla2_plugins.tabletop_objects import TabletopObjectsConfig

LIFTED, LIFTED_WELL = 0.03, 0.08
"""Metres between a lifted object's lowest point and the table: relaxed and strict."""

WORDINGS = {
    "lift": (
        "lift the {x}",
        "pick up the {x}",
        "raise the {x} off the table",
        "grab the {x} and hold it up",
        "take the {x} and lift it into the air",
    ),
    "put_in": (
        "put the {x} in the {y}",
        "place the {x} into the {y}",
        "pick up the {x} and put it in the {y}",
        "drop the {x} into the {y}, please",
    ),
}
"""Templates of each kind; ``{x}`` is the object, ``{y}`` the other object."""


@dataclass(frozen=True)
class ObjectRequest:
    """The request: its kind, the object ``theme`` and the other object ``goal``: bodies' names, "" for no other."""

    kind: str
    theme: str
    goal: str = ""


def interpret(sentence: str, labels: dict[str, str], own: ObjectRequest) -> tuple[ObjectRequest, str]:
    """The objects named by a given sentence's words, and a remark for the goal when it names none."""
    said = " ".join(re.findall(r"[a-z0-9]+", sentence.lower()))
    places = {name: _place(said, label) for name, label in labels.items()}
    named = sorted((n for n, at in places.items() if at >= 0), key=lambda n: places[n])
    if len(named) >= 2 and re.search(r"\b(in|into|inside)\b", said):
        return ObjectRequest("put_in", named[0], named[1]), ""
    if len(named) == 1:
        return ObjectRequest("lift", named[0]), ""
    return own, "; the sentence names none of the objects by its name, so the seed's own goal is judged"


def _place(said: str, label: str) -> int:
    found = re.search(rf"\b{re.escape(label)}s?\b", said)
    return found.start() if found else -1


def success_check(asked: ObjectRequest, bodies: Sequence[Body], table: float) -> tuple[Checks, str]:
    """The predicates of both profiles, and their description; ``table`` is world z, metres."""
    by_name = {body.name: body for body in bodies}
    theme = by_name[asked.theme]
    if asked.kind == "lift":
        return _lifting(theme, table), (
            f"relaxed: no part of the {theme.label} is lower than {LIFTED} m above the table; "
            f"strict: than {LIFTED_WELL} m, and the fingers hold it"
        )
    goal = by_name[asked.goal]
    return _inside(theme, goal), (
        f"relaxed: the {theme.label} is over the {goal.label} and lower than its rim; strict: at rest there, let go "
        f"of, and the {goal.label} still stands"
    )


Checks = dict[Profile, Callable[[WorldState], bool]]


def _lifting(body: Body, table: float) -> Checks:
    def clearance(world: WorldState) -> float:
        return float(body_points(body, world.pose(body.name))[:, 2].min() - table)

    return {
        "relaxed": lambda world: clearance(world) > LIFTED,
        "strict": lambda world: clearance(world) > LIFTED_WELL and world.held(body.name),
    }


def _inside(body: Body, goal: Body) -> Checks:
    def relaxed(world: WorldState) -> bool:
        mine, theirs = (body_points(one, world.pose(one.name)) for one in (body, goal))
        low, high, middle = (
            theirs.min(axis=0),
            theirs.max(axis=0),
            0.5 * (mine.min(axis=0) + mine.max(axis=0)),
        )
        over = bool(((middle > low) & (middle < high))[:2].all())
        return over and bool(mine[:, 2].min() < high[2]) and not world.held(body.name)

    def strict(world: WorldState) -> bool:
        upright = goal.fixed or bool(world.pose(goal.name)[2, 2] > 0.8 * goal.world_from_body[2, 2])
        lying = world.resting(body.name) and "table" not in world.touching(body.name)
        return relaxed(world) and upright and lying

    return {"relaxed": relaxed, "strict": strict}


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
    """Implements :class:`gvla2.robot.task.Task` for a folder of meshes; :func:`success_check` says what counts as done.

    Raises :class:`ConfigurationError` for an invalid folder, names or options; an unusable mesh raises when an episode
    needs it.
    """

    def __init__(self, config: TabletopObjectsConfig) -> None:
        objects = config.objects
        if not objects.root:
            raise ConfigurationError(
                "task=tabletop_objects needs task.objects.root=FOLDER, a folder of meshes."
            )
        self._library = mesh_library(objects.root, objects.names)
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
        template = self.instructions[int(rng.integers(len(self.instructions)))]
        sentence = template.format(x=labels[asked.theme], y=labels.get(asked.goal, ""))
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
            mesh = scan.textured.mesh  # of even walls: its weight is the surface's
            middles = mesh.vertices[mesh.faces].mean(axis=1)
            rotation = fallen(scan.hull, np.average(middles, axis=0, weights=mesh.areas), rng)
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
                site.inside(spot, min(radii[k], 0.15))
                and clear(spots, [*(radii[j] for j in before), radii[k]], GAP)
                and (objects[k].name not in handled or site.in_reach(spot, 0.02, LIFT))
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
    mouths = {body.name: _mouth(body) for body in bodies}
    return [
        ObjectRequest("put_in", body.name, goal.name)
        for goal, body in permutations(bodies, 2)
        if sorted(_scan(body).size)[1] < mouths[goal.name]
    ]


def _mouth(body: Body) -> float:
    """Width of the opening at its top, metres; 0 if it is closed."""
    points, _ = _scan(body).textured.mesh.sample(20_000, np.random.default_rng(0))
    return opening_of(transform_points(body.world_from_body, points))


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


def fallen(hull: FloatArray, centre: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A rotation (3, 3), its z axis up, in which an object dropped at random comes to rest on a plane.

    ``hull`` (N, 3) are the corners of its convex hull and ``centre`` (3,) its centre of mass, one frame, metres. Its
    faces are drawn by their quasi-static probabilities, without momentum (Goldberg et al. 1999, "Part pose
    statistics"); any rotation about z is equally likely.
    """
    solid = trimesh.convex.convex_hull(hull)
    turns, chances = trimesh.poses.compute_stable_poses(solid, center_mass=centre, n_samples=1)
    chosen = turns[rng.choice(len(turns), p=chances / chances.sum()), :3, :3]
    return np.asarray(planar((0.0, 0.0), 0.0, float(rng.uniform(-np.pi, np.pi)))[:3, :3] @ chosen)
