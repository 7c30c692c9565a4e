"""Table tops with known truth, ray cast into the four cameras of the Panda's table, with an arm in the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.colours import COLOURS, DISTINCT, colour_distance
from gvla2.planning.scene import Box, SceneObject

TABLE_TOP = 0.752
TABLE_RGB = (0.62, 0.52, 0.42)
WORKSPACE = Box(np.array([-0.275, -0.655, 0.752]), np.array([0.775, 0.655, 1.752]))
ROBOT_ID = 1000
LAMP_RGB = ((0.16, 0.16, 0.18), (0.20, 0.20, 0.22), (0.28, 0.27, 0.26))


@dataclass(frozen=True)
class Truth:
    """One object that was put on the table."""

    kind: str  # box, cylinder, sphere, region
    size: tuple[float, float, float]
    centre: np.ndarray
    yaw: float
    colour: str  # "" where no colour word fits
    nouns: tuple[str, ...]
    rgb: tuple[float, float, float]

    @property
    def pose(self) -> np.ndarray:
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return rigid([[c, -s, 0], [s, c, 0], [0, 0, 1]], self.centre)

    def surface(self, number: int) -> Surface:
        if self.kind == "cylinder":
            mesh = trimesh.creation.cylinder(0.5 * self.size[0], self.size[2], sections=48)
        elif self.kind == "sphere":
            mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.5 * self.size[0])
        else:
            mesh = trimesh.creation.box(self.size)
        return Surface(mesh.vertices, mesh.faces, np.array(self.rgb), number)


def put(kind, size, xy, yaw=0.0, colour="red", nouns=(), bottom=0.0, rgb=None) -> Truth:
    """An object on the table, or ``bottom`` metres above it."""
    centre = np.array([*xy, TABLE_TOP + bottom + 0.5 * size[2]])
    return Truth(kind, tuple(size), centre, yaw, colour, tuple(nouns), rgb or COLOURS[colour])


def put_region(size, xy, yaw=0.0, colour="red", nouns=("square",)) -> Truth:
    """A patch half a millimetre thick."""
    return put("region", (*size, 0.0005), xy, yaw, colour, nouns)


def put_lamp(xy, yaw, colour, scale=1.0) -> list[Truth]:
    """Base, post, shade and a push button."""
    c, s = np.cos(yaw), np.sin(yaw)

    def at(along):
        return (xy[0] + c * along * scale, xy[1] + s * along * scale)

    base, post, shade = (
        np.array([0.16, 0.08, 0.010]),
        np.array([0.014, 0.014, 0.055]),
        np.array([0.06, 0.06, 0.035]),
    )
    base, post, shade = base * [scale, scale, 1], post * scale, shade * scale
    return [
        put("box", base, xy, yaw, "", ("lamp base", "plate"), 0.0, LAMP_RGB[0]),
        put("cylinder", post, at(0.045), yaw, "", ("post",), base[2], LAMP_RGB[1]),
        put(
            "cylinder",
            shade,
            at(0.045),
            yaw,
            "",
            ("lamp shade", "disc", "cylinder"),
            base[2] + post[2],
            LAMP_RGB[2],
        ),
        put("cylinder", (0.033 * scale, 0.033 * scale, 0.014), at(-0.045), yaw, colour, ("button",), base[2]),
    ]


def cameras() -> list[Camera]:
    """The four cameras of the Panda's table."""
    fov, down = np.radians(40), (0.0, 0.0, 1.0)
    poses = [
        ("front", look_along((1.35, 0, 1.58), (-0.906, 0, -0.423), down), fov),
        ("left", look_along((-0.175, 0.2, 1.98), (0.416, -0.073, -0.906), down), fov),
        ("right", look_along((-0.175, -0.2, 1.98), (0.416, 0.073, -0.906), down), fov),
        ("wrist", look_along((0.33, -0.009, 1.50), (0, 0, -1), (1.0, 0, 0)), np.radians(60)),
    ]
    return [Camera.from_fov(f, pose, 256, 256, name) for name, pose, f in poses]


def arm() -> list[Surface]:
    """Something like a Panda at home: three capsules and a hand."""
    parts = []
    for start, end, radius in (
        ((-0.268, 0, 0.76), (-0.268, 0, 1.12), 0.07),
        ((-0.268, 0, 1.12), (-0.15, 0, 1.45), 0.06),
        ((-0.15, 0, 1.45), (0.25, 0, 1.65), 0.05),
        ((0.28, 0, 1.65), (0.28, 0, 1.56), 0.045),
    ):
        mesh = trimesh.creation.capsule(
            height=float(np.linalg.norm(np.subtract(end, start))), radius=radius, count=[12, 12]
        )
        mesh.apply_transform(look_along(start, np.subtract(end, start)))
        parts.append(Surface(mesh.vertices, mesh.faces, np.array([0.9, 0.9, 0.92]), ROBOT_ID))
    return parts


def render(
    truths: list[Truth],
    *,
    noise: float = 0.0,
    seed: int = 0,
    robot: list[Surface] | None = None,
    table_rgb: tuple[float, float, float] = TABLE_RGB,
    blind: tuple[str, ...] = (),
    holes: float = 0.0,
    yaw: float = 0.0,
) -> Observation:
    """What the cameras see; ``noise`` metres, ``holes`` share of pixels without depth, ``yaw`` turns all objects
    about the point (0.25, 0).
    """
    rng = np.random.default_rng(seed)
    board = trimesh.creation.box((1.5, 2.2, 0.04))
    robot = arm() if robot is None else robot
    surfaces = [Surface(board.vertices, board.faces, np.array(table_rgb), 0)]
    surfaces += [t.surface(1 + k) for k, t in enumerate(truths)] + robot
    pivot = np.array([0.25, 0.0, 0.0])
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    turned = rigid(turn, pivot - turn @ pivot)
    poses = {0: rigid(translation=(0.35, 0, TABLE_TOP - 0.02))}
    poses |= {1 + k: turned @ t.pose for k, t in enumerate(truths)}
    views = []
    rig = cameras()
    for camera, seen in zip(rig, RayCaster(surfaces).cast(rig, poses), strict=True):
        depth, image = seen.depth.copy(), seen.image
        depth += rng.normal(0, noise, depth.shape).astype(np.float32) if noise else np.float32(0)
        if holes:
            depth[rng.random(depth.shape) < holes] = np.nan
        if camera.name in blind:
            depth, image = np.full_like(depth, np.nan), np.zeros_like(image)
        views.append(View(camera, image, depth, robot_mask=seen.ids == ROBOT_ID))
    return Observation(
        Views(tuple(views)),
        rigid([[1, 0, 0], [0, -1, 0], [0, 0, -1]], (0.28, 0, 1.47)),
        np.zeros(7),
        1.0,
        0.08,
    )


KINDS = ("cube", "cube", "cube", "box", "cylinder", "ball", "disc", "plate", "bottle", "region", "lamp")


def random_scene(rng: np.random.Generator) -> list[Truth]:
    """Two to six objects, 2.5 cm or more apart, of colours that differ from the table's."""
    names = [n for n, rgb in COLOURS.items() if colour_distance(np.array(TABLE_RGB), rgb) > 20]
    placed: list[Truth] = []
    taken: list[tuple[np.ndarray, float]] = []
    lamp = False
    for _ in range(int(rng.integers(2, 7))):
        kind = str(rng.choice(KINDS))
        if kind == "lamp" and lamp:
            continue
        lamp |= kind == "lamp"
        scale = rng.uniform(0.8, 1.2)
        radius = {"box": 0.07, "plate": 0.10, "region": 0.09, "lamp": 0.11}.get(kind, 0.055)
        for _ in range(40):
            xy = np.array([0.25, 0]) + rng.uniform(-0.5, 0.5, 2) * [0.5, 0.8]
            if all(np.linalg.norm(xy - other) > radius + reach + 0.025 for other, reach in taken):
                break
        else:
            continue
        taken.append((xy, radius))
        placed += _make(kind, xy, rng.uniform(-np.pi, np.pi), str(rng.choice(names)), scale, rng)
    return placed


def _make(kind, xy, yaw, colour, scale, rng) -> list[Truth]:
    side = float(rng.uniform(0.045, 0.07))
    if kind == "cube":
        return [put("box", (side,) * 3, xy, yaw, colour, ("cube",))]
    if kind == "box":
        size = scale * np.array([0.11, 0.05, 0.06])
        return [put("box", size, xy, yaw, colour, ("box",))]
    if kind == "cylinder":
        return [put("cylinder", (side, side, 1.3 * side), xy, 0.0, colour, ("cylinder",))]
    if kind == "ball":
        return [put("sphere", (side,) * 3, xy, 0.0, colour, ("ball",))]
    if kind == "disc":
        return [put("cylinder", (0.08 * scale, 0.08 * scale, 0.02), xy, 0.0, colour, ("disc",))]
    if kind == "plate":
        return [put("box", (0.16 * scale, 0.11 * scale, 0.015), xy, yaw, colour, ("plate",))]
    if kind == "bottle":
        return [put("cylinder", (0.07 * scale, 0.07 * scale, 0.2 * scale), xy, 0.0, colour, ("bottle",))]
    if kind == "region":
        return [put_region((0.1 * scale, 0.1 * scale), xy, yaw, colour)]
    apart = [n for n, rgb in COLOURS.items() if (colour_distance(np.array(LAMP_RGB), rgb) > DISTINCT).all()]
    return put_lamp(xy, yaw, colour if colour in apart else str(rng.choice(apart)), scale)


def yaw_error(truth: Truth, seen: SceneObject) -> float:
    """Degrees, modulo the rectangle's symmetry."""
    period = np.pi / 2 if min(truth.size[:2]) > 0.9 * max(truth.size[:2]) else np.pi
    axis = seen.world_from_object[:2, 0]
    yaw = np.arctan2(axis[1], axis[0])
    difference = (yaw - truth.yaw + period / 2) % period - period / 2
    return float(np.degrees(abs(difference)))
