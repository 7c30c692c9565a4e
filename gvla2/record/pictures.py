"""All pictures of a run, made one by one so that a failure does not affect the others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.episode.record import EpisodeRecord
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.record.drawing import Canvas, enlarged, png
from gvla2.record.overlay import perception_overlay, plan_overlay, plan_views
from gvla2.record.placement import Rect

_UNKNOWN = (96, 100, 108)

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


def depth_picture(depth: NDArray[np.float32], width: int = 512) -> Image.Image:
    """Depth (H, W), metres, as colours: yellow near, violet far, grey where nothing was measured.

    The scale runs from the 1st to the 99th percentile of the measurements and is written into the picture.
    """
    known = np.isfinite(depth)
    low, high = (float(v) for v in np.percentile(depth[known], [1, 99])) if known.any() else (0.0, 1.0)
    nearness = np.clip((high - np.where(known, depth, low)) / max(high - low, 1e-6), 0, 1)
    colours = cv2.applyColorMap(np.rint(255 * nearness).astype(np.uint8), cv2.COLORMAP_VIRIDIS)[..., ::-1]
    picture = Image.fromarray(np.where(known[..., None], colours, _UNKNOWN).astype(np.uint8))
    canvas = Canvas(np.asarray(enlarged(picture, width, how=Image.Resampling.NEAREST)), width)
    below = Rect(0, canvas.size[1], 0, canvas.size[1])
    canvas.label(f"{low:.2f} to {high:.2f} m" if known.any() else "no depth measured", below, _UNKNOWN)
    return canvas.picture()


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


def part_pictures(parts: Sequence[EpisodeRecord]) -> Shots:
    """The plans of the parts before the last, which has its own pictures."""
    return {
        f"part {k}: {part.plan.skill}": picture
        for k, part in enumerate(parts, 1)
        if part.observation is not None and part.plan is not None and part.plan.trajectory is not None
        for picture in plan_pictures(part.observation, part.plan.trajectory, part.scene, 1).values()
    }


class Shown(NamedTuple):
    """What of :class:`Pictures` is made during a run: its name in notes, and ``make``, called with ``inputs``.

    It waits until none of the inputs is None. ``file`` in the run's folder also holds it, "" for none.
    """

    called: str
    inputs: Callable[[EpisodeRecord], tuple[Any, ...]]
    make: Callable[..., bytes | Shots]
    file: str = ""


SHOWN: Mapping[str, Shown] = {
    "before": Shown("The picture before", lambda r: (r.observation,), main_picture, "before.png"),
    "plain": Shown("The cameras' pictures", lambda r: (r.observation,), plain_pictures),
    "depth": Shown("The cameras' depth", lambda r: (r.observation,), depth_pictures, "depth.png"),
    "objects": Shown(
        "The picture of the objects", lambda r: (r.observation, r.scene), object_pictures, "perception.png"
    ),
    "plan": Shown(
        "The picture of the plan",
        lambda r: (r.observation, r.plan and r.plan.trajectory, r.scene),
        plan_pictures,
        "plan.png",
    ),
    "parts": Shown("The pictures of the parts", lambda r: (r.parts or None,), part_pictures),
    "after": Shown("The picture after", lambda r: (r.after,), main_picture, "after.png"),
}
"""By the field of :class:`Pictures`, in the order in which a run makes them."""
