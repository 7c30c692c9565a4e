"""A table with shapes on it, seen by ray casting, and a segmenter that needs no weights."""

from functools import partial

import numpy as np
import pytest
import trimesh

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.perception.clicks import Segments
from gvla2.planning.scene import Box

TABLE = 0.5
WORKSPACE = Box(np.array([-0.1, -0.4, TABLE]), np.array([0.6, 0.4, TABLE + 0.6]))


def cameras(size=160):
    target = np.array([0.25, 0.0, TABLE])
    places = (
        [0.9, 0.1, TABLE + 0.7],
        [0.0, 0.6, TABLE + 0.8],
        [0.0, -0.6, TABLE + 0.8],
        [0.25, 0.02, TABLE + 0.9],
    )
    return [
        Camera.from_fov(0.6, look_along(p, target - np.array(p)), size, size, f"camera_{i}")
        for i, p in enumerate(places)
    ]


def bottle(rgb=(0.1, 0.3, 0.8)):
    """A body of two cylinders: of no symmetry upside down."""
    low = trimesh.creation.cylinder(0.035, 0.10, sections=24)
    high = trimesh.creation.cylinder(0.015, 0.06, sections=24)
    high.apply_translation([0, 0, 0.08])
    whole = trimesh.util.concatenate([low, high])
    whole.visual.vertex_colors = np.array([*(255 * np.array(rgb)), 255], dtype=np.uint8)
    return whole


def brick(size=(0.12, 0.07, 0.04), rgb=(0.85, 0.2, 0.1)):
    whole = trimesh.creation.box(size).subdivide().subdivide()
    colours = np.tile([*(255 * np.array(rgb)), 255], (len(whole.vertices), 1)).astype(np.uint8)
    colours[whole.vertices[:, 0] > 0.3 * size[0]] = (240, 230, 60, 255)  # one end is painted
    whole.visual.vertex_colors = colours
    return whole


def surface(mesh, pose, index):
    colours = np.asarray(mesh.visual.face_colors)[:, :3] / 255.0
    placed = trimesh.transform_points(mesh.vertices, pose)
    return Surface(placed, np.asarray(mesh.faces), colours, index)


def standing(mesh, x, y, yaw=0.0):
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return rigid(turn, (x, y, TABLE - mesh.bounds[0, 2]))


class Seen:
    """``observation`` and, one a view, the truth (H, W): 0 the table, 1, 2, ... the placed meshes."""

    def __init__(self, placed, size=160, noise=0.0, seed=0):
        plane = Surface(
            np.array([[-2.0, -2, TABLE], [2, -2, TABLE], [2, 2, TABLE], [-2, 2, TABLE]]),
            np.array([[0, 1, 2], [0, 2, 3]]), np.array([0.62, 0.55, 0.45]), 0,
        )  # fmt: skip
        rng = np.random.default_rng(seed)
        caster = RayCaster([plane, *(surface(m, p, i + 1) for i, (m, p) in enumerate(placed))])
        self.truth, views = [], []
        for camera, seen in zip(cameras(size), caster.cast(cameras(size), {}), strict=True):
            depth = (seen.depth + noise * rng.standard_normal(seen.depth.shape)).astype(np.float32)
            views.append(View(camera, seen.image, depth, robot_mask=np.zeros(depth.shape, dtype=bool)))
            self.truth.append(seen.ids)
        self.observation = Observation(Views(tuple(views)), np.eye(4), np.zeros(7), 1.0, 0.08)


class ByColour:
    """A segmenter without weights: what has the colour of the clicked pixel, in the box, connected or not."""

    def __init__(self, tolerance=90.0):
        self.tolerance = tolerance

    def encode(self, image):
        return partial(self._segment, image.astype(float))

    def _segment(self, image, prompts):
        masks = []
        for prompt in prompts:
            mask = np.zeros(image.shape[:2], dtype=bool)
            for u, v in prompt.points:
                mask |= np.linalg.norm(image - image[int(v), int(u)], axis=-1) < self.tolerance
            if prompt.box is not None:
                rows, columns = np.indices(mask.shape)
                left, top, right, bottom = prompt.box
                mask &= (columns >= left - 1) & (columns <= right) & (rows >= top - 1) & (rows <= bottom)
            masks.append(mask[None])
        return Segments(np.array(masks), np.full((len(prompts), 1), 0.9))


@pytest.fixture
def world():
    """The module's makers, for tests that lay out a table of their own."""
    from types import SimpleNamespace

    return SimpleNamespace(
        TABLE=TABLE,
        WORKSPACE=WORKSPACE,
        Seen=Seen,
        ByColour=ByColour,
        bottle=bottle,
        brick=brick,
        standing=standing,
    )


@pytest.fixture
def two(world):
    """A brick and a bottle, apart."""
    b, c = world.brick(), world.bottle()
    return world.Seen(
        [(b, world.standing(b, 0.2, -0.1, 0.5)), (c, world.standing(c, 0.3, 0.12))], noise=0.0008
    )
