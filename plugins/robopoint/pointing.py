"""Points in pictures: how a model's answer is parsed, and what its points show in the scene."""

from __future__ import annotations

import ast
import io
import re
from dataclasses import dataclass

import numpy as np
from PIL import Image

from gvla2.errors import PlanningError
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Observation, View
from gvla2.planning.scene import Scene

MAX_POINTS = 200
"""Maximum number of points in an answer; more mean that the model is repeating itself."""
MAX_CHARACTERS = 20_000
AGREE = 0.01
"""Neighbouring depths that differ by less lie on one surface, metres."""
NEIGHBOURS = 9
"""Number of valid pixels used for a depth: a patch of 3 by 3 if none is missing."""
REACH = 12
"""Where depth is missing, it is taken from at most this many pixels away."""

_LIST = re.compile(r"\[\s*\([^\[\]]*\]")


@dataclass(frozen=True)
class Sighting:
    """What a pixel shows: ``point`` (3,) in the world, metres, and the id of the ``object`` there, "" for none."""

    point: FloatArray
    object: str = ""


def encoded(view: View, longest: int) -> bytes:
    """The view's image as PNG with its longer side at most ``longest`` pixels; shares of the picture stay the same."""
    image = Image.fromarray(np.asarray(view.image))
    image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


def read_points(text: str, scale: float = 1.0) -> tuple[tuple[float, float], ...]:
    """The points (u, v) of an answer's one list, in shares of the picture; :class:`ValueError` with what is wrong.

    A list is ``[(0.41, 0.52), ...]``, x to the right and y down, each from 0 to ``scale``. Text is parsed, never run.
    """
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"The answer has {len(text)} characters; give the list alone.")
    found = {*_LIST.findall(text)}
    if len(found) > 1:
        raise ValueError("There are several lists of points in the answer; give one.")
    try:
        points = [(float(u), float(v)) for u, v in ast.literal_eval("".join(found))]
    except (SyntaxError, ValueError, TypeError, RecursionError, MemoryError):
        form = "[(0.41, 0.52), (0.38, 0.47)]"
        raise ValueError(f"There is no list of points such as {form} in the answer.") from None
    if not 1 <= len(points) <= MAX_POINTS:
        raise ValueError(f"The list has more than {MAX_POINTS} points; give a few.")
    for u, v in points:
        if not (0.0 <= u <= scale and 0.0 <= v <= scale):
            raise ValueError(
                f"The point ({u:g}, {v:g}) lies outside the picture; coordinates are 0 to {scale:g}."
            )
    return tuple((u / scale, v / scale) for u, v in points)


def view_of(observation: Observation, camera: str = "") -> View:
    """The view of that name, the first one for ""; raises :class:`PlanningError` if there is none."""
    names = [view.name for view in observation.views]
    if camera and camera not in names:
        raise PlanningError(f"There is no camera '{camera}'; the observation has {', '.join(names)}.")
    return observation.views[names.index(camera) if camera else 0]


def sight(view: View, u: float, v: float, scene: Scene) -> Sighting:
    """What is seen at the shares ``u`` and ``v`` of a picture's width and height, 1 being its last pixel.

    Raises :class:`PlanningError` for a camera without depth, and if no depth was measured nearby. Pixels of the robot's
    own arm count as not measured.
    """
    camera = view.camera
    at = np.array([min(u * camera.width, camera.width - 0.5), min(v * camera.height, camera.height - 0.5)])
    ray = camera.world_from_camera[:3, :3] @ np.linalg.solve(camera.K, np.array([*at, 1.0]))
    point = np.asarray(camera.position + depth_at(view, *at) * ray)
    return Sighting(point, scene.object_at(point))


def depth_at(view: View, u: float, v: float) -> float:
    """Metres along the camera's z at a pixel: the median of the nearest measured depths on one surface.

    An isolated pixel (a flying pixel at an edge) is outvoted by its neighbours; one confirmed by some of them is used,
    so that a thin handle is not mistaken for what lies behind it.
    """
    if view.depth is None:
        raise PlanningError(f"The camera '{view.name}' measures no depth; choose one that does.")
    top, left = max(0, int(v) - REACH), max(0, int(u) - REACH)
    patch = (slice(top, int(v) + REACH + 1), slice(left, int(u) + REACH + 1))
    depths = view.depth[patch].astype(np.float64)
    known = np.isfinite(depths) & (depths > 0.0)
    if view.robot_mask is not None:
        known &= ~view.robot_mask[patch]
    rows, columns = np.nonzero(known)
    off = np.hypot(rows + top + 0.5 - v, columns + left + 0.5 - u)
    near = np.argsort(off, kind="stable")[:NEIGHBOURS]
    near = near[off[near] <= REACH]
    if not len(near):
        raise PlanningError(
            f"No depth was measured within {REACH} pixels of ({u:.0f}, {v:.0f}) in the picture of '{view.name}'."
        )
    found = depths[rows[near], columns[near]]
    beside = np.abs(found - found[0]) < AGREE
    return float(np.median(found[beside] if beside.sum() >= min(3, len(found)) else found))
