"""All pictures of a run, made one by one so that a failure does not affect the others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from PIL import Image

from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.record.drawing import enlarged, png
from gvla2.record.overlay import perception_overlay, plan_overlay, plan_views
from gvla2.record.sheet import depth_picture

Shots = Mapping[str, bytes]
"""PNG files by their captions, mostly cameras' names."""


@dataclass
class Pictures:
    """The page's pictures; empty if not made.

    ``plain`` are the cameras' pictures as taken, ``objects`` those with the perceived objects, ``depth`` their depth,
    ``plan`` the planned path in some of them. ``parts`` shows, where a program took several, the plan of each part in
    the main camera. ``episode`` is a GIF, ``film`` the same motion as MP4, ``model`` the scene with the plan as GLB.
    """

    plain: Shots = field(default_factory=dict)
    objects: Shots = field(default_factory=dict)
    depth: Shots = field(default_factory=dict)
    plan: Shots = field(default_factory=dict)
    parts: Shots = field(default_factory=dict)
    before: bytes = b""
    after: bytes = b""
    episode: bytes = b""
    film: bytes = b""
    model: bytes = b""


def main_picture(observation: Observation) -> bytes:
    """The picture for before and after, of a front camera if there is one, else of the first."""
    views = observation.views
    main = next((v for v in views if "front" in v.name), views[0])
    return png(enlarged(Image.fromarray(observation.shown(main).image), 512))


def plain_pictures(observation: Observation) -> Shots:
    """Each camera's picture."""
    return {view.name: png(Image.fromarray(view.image)) for view in observation.pictured()}


def depth_pictures(observation: Observation) -> Shots:
    """Each camera's depth, where it measures any."""
    return {v.name: png(depth_picture(v.depth)) for v in observation.views if v.depth is not None}


def object_pictures(observation: Observation, scene: Scene) -> Shots:
    """Each camera's picture with the perceived objects."""
    return {view.name: png(perception_overlay(view, scene)) for view in observation.pictured()}


def plan_pictures(
    observation: Observation, trajectory: Trajectory, scene: Scene | None, count: int = 2
) -> Shots:
    """The planned path in the ``count`` cameras that show it best."""
    start = observation.world_from_tcp[:3, 3]

    def drawn(view: View) -> bytes:
        return png(plan_overlay(view, trajectory, start, scene))

    return {v.name: drawn(v) for v in plan_views(observation.pictured(), trajectory, count)}
