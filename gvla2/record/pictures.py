"""All pictures of a run, made one by one so that a failure does not affect the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from PIL import Image

from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.record.drawing import png
from gvla2.record.overlay import perception_overlay, plan_overlay, plan_views
from gvla2.record.sheet import depth_picture


@dataclass(frozen=True)
class CameraPictures:
    """One camera's pictures as PNG files: as taken, with the perceived objects, and its depth."""

    name: str
    plain: bytes = b""
    objects: bytes = b""
    depth: bytes = b""


@dataclass
class Pictures:
    """The page's pictures; empty if not made.

    ``episode`` is a GIF, ``film`` the same motion as MP4, ``model`` the scene with the plan as GLB.

    ``parts`` shows, where a program took several, the plan of each part in the main camera, with its caption.
    """

    cameras: tuple[CameraPictures, ...] = ()
    plan: tuple[tuple[str, bytes], ...] = ()
    before: bytes = b""
    after: bytes = b""
    episode: bytes = b""
    film: bytes = b""
    model: bytes = b""
    parts: tuple[tuple[str, bytes], ...] = ()


def main_view(observation: Observation) -> View:
    """The view for before and after: a front camera if there is one, else the first."""
    views = observation.pictured()
    return next((v for v in views if "front" in v.name), views[0])


def plain_picture(view: View, width: int = 512) -> Image.Image:
    """The camera's plain picture, enlarged smoothly by an integer factor to about ``width`` pixels."""
    picture = Image.fromarray(view.image)
    scale = max(1, round(width / picture.width))
    return picture.resize((picture.width * scale, picture.height * scale), Image.Resampling.LANCZOS)


def camera_pictures(observation: Observation) -> tuple[CameraPictures, ...]:
    """Each camera's picture and depth, without objects yet."""
    return tuple(
        CameraPictures(
            view.name,
            plain=png(Image.fromarray(fine.image)),
            depth=png(depth_picture(view.depth)) if view.depth is not None else b"",
        )
        for view, fine in zip(observation.views, observation.pictured(), strict=True)
    )


def with_objects(
    pictures: Sequence[CameraPictures], observation: Observation, scene: Scene
) -> tuple[CameraPictures, ...]:
    """The cameras' pictures plus those of the perceived objects."""
    return tuple(
        replace(camera, objects=png(perception_overlay(view, scene)))
        for camera, view in zip(pictures, observation.pictured(), strict=True)
    )


def plan_pictures(
    observation: Observation, trajectory: Trajectory, scene: Scene | None, count: int = 2
) -> tuple[tuple[str, bytes], ...]:
    """(camera, PNG) of the planned path in the cameras that show it best."""
    start = observation.world_from_tcp[:3, 3]
    return tuple(
        (view.name, png(plan_overlay(view, trajectory, start, scene)))
        for view in plan_views(observation.pictured(), trajectory, count)
    )
