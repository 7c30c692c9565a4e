"""A table top with known objects, its camera, and scenes to compare with them."""

from collections.abc import Callable

import numpy as np
import pytest

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2.robot.task import Body, Layout, Primitive

TABLE = 0.0
WORKSPACE = Box(np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 1.0]))


def cube(
    name: str, x: float, y: float = 0.0, *, size=(0.1, 0.1, 0.1), label: str = "red cube", **more
) -> Body:
    solid = Primitive("box", size, (1.0, 0.0, 0.0))
    return Body(name, (solid,), rigid(translation=(x, y, size[2] / 2)), label=label, **more)


def seen_as(body: Body, points: np.ndarray | None = None, **changes) -> SceneObject:
    """The body's first solid, as a perceiver would describe it."""
    solid = body.solids[0]
    what = {
        "id": body.name, "label": body.label, "shape": "box", "colour": "red",
        "world_from_object": body.world_from_body @ solid.body_from_shape,
        "extents": np.array(solid.size), "points": np.zeros((0, 3)) if points is None else points,
    }  # fmt: skip
    return SceneObject(**{**what, **changes})


class World:
    """Implements ``Segmented`` for boxes seen from above and from aside."""

    def __init__(self, *bodies: Body, size: int = 96) -> None:
        self.layout = Layout(bodies)
        poses = [((0.0, 0.0, 1.6), (0.001, 0.0, -1.0)), ((1.2, 0.0, 1.0), (-0.77, 0.0, -0.64))]
        cameras = [
            Camera.from_fov(0.7, look_along(at, to), size, size, f"camera{i}")
            for i, (at, to) in enumerate(poses)
        ]
        surfaces, self._names, where = [], [], {}
        for body in bodies:
            named = {i: label for label, numbers in body.parts for i in numbers}
            for i, solid in enumerate(body.solids):
                name = f"{body.name}/{named[i]}" if i in named else body.name
                if name not in self._names:
                    self._names.append(name)
                where[len(surfaces)] = body.world_from_body @ solid.body_from_shape
                surfaces.append(_box(solid.size, self._names.index(name)))
        where[len(surfaces)] = rigid(translation=(0, 0, -0.01))
        surfaces.append(_box((3.0, 3.0, 0.02), 99))
        seen = RayCaster(surfaces).cast(cameras, where)
        self.ids = [np.where(image.ids == 99, -1, image.ids).astype(np.int32) for image in seen]
        views = Views(
            tuple(View(c, image.image, image.depth) for c, image in zip(cameras, seen, strict=True))
        )
        self.observation = Observation(views, np.eye(4), np.zeros(7), 1.0, 0.08)

    def true_scene(self) -> Scene:
        objects = []
        for body in self.layout.bodies:
            objects.append(seen_as(body))
            for label, (number, *_) in body.parts:
                part = seen_as(
                    Body("", (body.solids[number],), body.world_from_body), id=f"{body.name}/{label}"
                )
                objects.append(part)
        return Scene(tuple(objects), TABLE, WORKSPACE)

    def true_masks(self, observation: Observation) -> tuple[tuple[str, ...], list[np.ndarray]]:
        assert observation is self.observation
        return tuple(self._names), self.ids


def _box(size: tuple[float, float, float], number: int) -> Surface:
    import trimesh

    mesh = trimesh.creation.box(extents=size)
    return Surface(mesh.vertices, mesh.faces, np.array([0.8, 0.1, 0.1]), number)


@pytest.fixture
def world() -> Callable[..., World]:
    return World


@pytest.fixture
def body() -> Callable[..., Body]:
    return cube


@pytest.fixture
def perceived() -> Callable[..., SceneObject]:
    return seen_as


@pytest.fixture
def scene_of() -> Callable[..., Scene]:
    return lambda *objects: Scene(tuple(objects), TABLE, WORKSPACE)
