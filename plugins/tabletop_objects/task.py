"""Episodes with scanned objects: their layout and the instruction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from gvla2.errors import ConfigurationError
from gvla2.geometry.transform import FloatArray, rigid
from gvla2.planning.colours import COLOURS
from gvla2.robot.placing import clear, in_reach, inside, planar, sample_root, sample_until
from gvla2.robot.scan import Mesh, Scan, chosen, mesh_library, spoken
from gvla2.robot.solids import tray
from gvla2.robot.task import Body, Layout, TaskInstance, TaskSite
from gvla2_plugins.tabletop_objects import TabletopObjectsConfig
from gvla2_plugins.tabletop_objects.asking import WORDINGS, Request, interpret, sentence_for, success_check
from gvla2_plugins.tabletop_objects.meshes import fallen, mouth

MOST = 8
GAP = 0.03
"""Metres between objects, at least."""

SPOTS = 60
"""Places that are tried for an object, those before it lying where they lie, until all are drawn anew."""

LIFT = 0.20
"""Heights above the table that the hand must reach at an object's place, metres."""

DENSITY, LIGHTEST, HEAVIEST = 250.0, 0.02, 0.6
"""Kilograms a cubic metre of an object's hull, and bounds in kilograms: household objects are hollow or light."""

DROP = 0.001
"""Metres above the table from which objects settle."""

TRAY, WALL = (0.30, 0.22, 0.05), 0.008

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
        if config.ask not in (*WORDINGS, "any"):
            raise ConfigurationError(
                f"task.ask is '{config.ask}'; it is one of {', '.join(WORDINGS)} or any."
            )
        self._count = count
        labels = [spoken(name) for name in self._library]
        double = sorted({label for label in labels if labels.count(label) > 1})
        if double:
            raise ConfigurationError(f"Two objects are both called '{double[0]}'; rename one of their files.")

    @property
    def instructions(self) -> tuple[str, ...]:
        """The wordings of what may be asked."""
        kinds = WORDINGS if self._config.ask == "any" else (self._config.ask,)
        return tuple(template for kind in kinds for template in WORDINGS[kind])

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
        notes = [f"; {body.label}: {note}" for body in turned for note in _scan(body).notes]
        return TaskInstance(
            sentence,
            Layout(tuple(bodies)),
            succeeded,
            f"{goal}{aside}{''.join(notes)}",
            keep_clear=_beside(asked, bodies),
        )

    def _turned(self, name: str, rng: np.random.Generator) -> Body:
        """The object at the origin, in its final orientation."""
        objects = self._objects
        mesh = Mesh(self._library[name], objects.scale, friction=objects.friction)
        scan = _scan(mesh.body(name, np.eye(4)))
        mass = objects.mass if objects.mass is not None else _mass(scan)
        rotation = planar((0.0, 0.0), 0.0, float(rng.uniform(-np.pi, np.pi)))[:3, :3]
        if objects.pose == "fallen":
            rotation = fallen(scan.hull, _middle(scan), rng)
        mesh = Mesh(self._library[name], objects.scale, mass, objects.friction)
        return mesh.body(name, rigid(rotation), label=spoken(name))

    def _asked(self, bodies: list[Body], rng: np.random.Generator) -> Request:
        """The request for these objects; for "any", one of the kinds that they allow."""
        kinds = list(WORDINGS) if self._config.ask == "any" else [self._config.ask]
        offers: dict[str, Callable[[], list[Request]]] = {
            "lift": lambda: [Request("lift", (body.name,)) for body in bodies],
            "put_in": lambda: _put_in(bodies),
            "left_of": lambda: [Request("left_of", (a.name,), b.name) for a, b in permutations(bodies, 2)],
            "sort": lambda: _sort(bodies),
        }
        while kinds:
            kind = kinds.pop(int(rng.integers(len(kinds))))
            offered = offers[kind]()
            if offered:
                return offered[int(rng.integers(len(offered)))]
        needs = {
            "put_in": "an object that is open at its top, and another that fits into it",
            "left_of": "two objects",
        }
        raise ConfigurationError(
            f"task.ask={self._config.ask} needs {needs.get(self._config.ask, 'other objects')}; there are only "
            f"{', '.join(body.label for body in bodies)}. Choose other names or a larger task.objects.count."
        )

    def _undone(self, asked: Request, objects: list[Body], roots: list[FloatArray], site: TaskSite) -> bool:
        """Whether there is still something to do: an object to put left lies on the right."""
        if asked.kind != "left_of":
            return True
        place = {body.name: root[:2, 3] for body, root in zip(objects, roots, strict=True)}
        theme, goal = place[asked.themes[0]], place[asked.goal]
        wide = sum(_radius(body) for body in objects if body.name in (asked.themes[0], asked.goal))
        beside = goal + np.array([0.0, wide + GAP])
        room = all(
            np.linalg.norm(root[:2, 3] - beside) > _radius(body) + 0.5 * wide
            for body, root in zip(objects, roots, strict=True)
            if body.name not in (asked.themes[0], asked.goal)
        )
        return bool(theme[1] < goal[1]) and room and in_reach(site, beside, (0.02, LIFT))

    def _placed(
        self, turned: list[Body], asked: Request, rng: np.random.Generator, site: TaskSite
    ) -> list[Body]:
        """The objects in place, and the tray if needed."""
        walls = tray(TRAY, WALL, COLOURS["gray"])
        container = Body("tray", walls, np.eye(4), fixed=True, label="gray tray", shape="box")
        objects = [*turned, *([container] if asked.kind == "sort" else [])]
        radii = [_radius(body) for body in objects]
        handled = {*asked.themes, asked.goal}
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
            placed = [roots[k] for k in range(len(objects))]
            return placed if self._undone(asked, objects, placed, site) else None

        roots = sample_until(draw, f"{len(objects)} objects", tries=150)
        return [_set_down(body, root, site) for body, root in zip(objects, roots, strict=True)]


def _beside(asked: Request, bodies: list[Body]) -> tuple[tuple[float, float, float], ...]:
    """The target circle on the table to the left of an object."""
    if asked.kind != "left_of":
        return ()
    near = {body.name: body for body in bodies}
    theme, goal = near[asked.themes[0]], near[asked.goal]
    x, y = goal.world_from_body[:2, 3].tolist()
    return ((x, y + _radius(theme) + _radius(goal) + GAP, _radius(theme)),)


def _put_in(bodies: list[Body]) -> list[Request]:
    mouths = {body.name: mouth(_scan(body), body.world_from_body) for body in bodies}
    return [
        Request("put_in", (body.name,), goal.name)
        for goal, body in permutations(bodies, 2)
        if sorted(_scan(body).size)[1] < mouths[goal.name]
    ]


def _sort(bodies: list[Body]) -> list[Request]:
    """Objects that share the last word of their names, or all of them."""
    nouns: dict[str, list[str]] = {}
    for body in bodies:
        if max(sorted(_scan(body).size)[:2]) < min(TRAY[:2]) - 2 * WALL:
            nouns.setdefault(body.label.split()[-1], []).append(body.name)
    shared = [(word, names) for word, names in nouns.items() if len(names) > 1]
    if shared:
        return [Request("sort", tuple(names), "tray", _plural(word)) for word, names in shared]
    everything = tuple(name for names in nouns.values() for name in names)
    return [Request("sort", everything, "tray", "objects")] if len(everything) == len(bodies) else []


def _plural(word: str) -> str:
    return word + ("es" if word.endswith(("s", "x", "ch", "sh")) else "s")


def _set_down(body: Body, root: FloatArray, site: TaskSite) -> Body:
    """The body at the place of ``root``, its lowest point on the table."""
    if not isinstance(body.solids[0], Scan):
        return replace(body, world_from_body=root)
    pose = rigid(body.world_from_body[:3, :3], (*root[:2, 3], 0.0))
    pose[2, 3] = site.table_height + DROP - _scan(body).lowest(pose)
    return replace(body, world_from_body=pose)


def _radius(body: Body) -> float:
    """Of the circle about its middle that holds it, seen from above, metres."""
    if not isinstance(body.solids[0], Scan):
        return float(np.hypot(*TRAY[:2])) / 2
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


def _middle(scan: Scan) -> FloatArray:
    """(3,) the mean of its surface: where the weight of an object of even walls is."""
    mesh = scan.textured.mesh
    return np.asarray(np.average(mesh.vertices[mesh.faces].mean(axis=1), axis=0, weights=mesh.areas))


def _scan(body: Body) -> Scan:
    solid = body.solids[0]
    assert isinstance(solid, Scan)
    return solid
