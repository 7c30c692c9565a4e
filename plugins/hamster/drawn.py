"""From a path drawn into one picture to points in the scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, takewhile

import numpy as np
from skimage.measure import approximate_polygon

from gvla2.errors import PlanningError
from gvla2.geometry.views import View
from gvla2.planning.contracts import PlanRequest
from gvla2.planning.pictures import Stroke
from gvla2.planning.pixels import Pixel, Sighting, object_near, path_in_air, pixel_at, sight
from gvla2.skills.path_lifting import PathPoint

MOST = 10
"""Most points kept of a path; between them it is nearly straight in the picture."""
MISSED = 0.03
"""A hand that closes this near to an object, in shares of the picture's width, should close on it."""


def drawn(
    strokes: Sequence[Stroke], view: View, request: PlanRequest, travel: float, *, level: bool = False
) -> list[PathPoint]:
    """The path's points in the world; raises :class:`ValueError` with what is wrong with a path.

    Where the hand opens or closes, depth gives the place; a hand that stays closed presses or pushes, and depth gives
    where it touches. The rest is a path through the air, at least ``travel`` metres above the table, exactly that with
    ``level``.
    """
    closes = next((k for k, s in enumerate(strokes) if s.gripper < 0.5), None)
    if closes is None or len(strokes) < 2:
        raise ValueError("The hand closes nowhere on this path; give two points at least, and the actions.")
    if sum(s.event and s.gripper < 0.5 for s in strokes) > 1:
        raise ValueError("The hand closes more than once on this path; handle one object, the first.")
    touching = not _takes(strokes[closes], view, request)
    if touching:
        # Closed in free space, it will push or press: any way there will do.
        strokes = list(takewhile(lambda s: s.gripper < 0.5, strokes[closes:]))
    kept = thinned(strokes)
    pixels = [pixel_at(view, s.u, s.v) for s in kept]
    seen: dict[int, Sighting] = {}
    for index, (stroke, pixel) in enumerate(zip(kept, pixels, strict=True)):
        if stroke.event or touching:
            try:
                seen[index] = _met(pixel, view, request)
            except PlanningError as error:
                if not touching:
                    raise ValueError(f"At ({stroke.u:.3g}, {stroke.v:.3g}): {error}") from None
    if not seen:
        raise ValueError("The closed hand meets nothing on this path.")
    scene = request.scene
    anchors = {index: sighting.point for index, sighting in seen.items()}
    way = path_in_air(view.camera, pixels, anchors, scene, request.start[:3, 3])
    points = []
    for index, (stroke, xyz) in enumerate(zip(kept, way, strict=True)):
        if not np.isfinite(xyz).all():
            continue  # beside the workspace, on the way: the hand goes straight on
        x, y, z = (float(v) for v in xyz)
        low = scene.table_height + travel
        z = z if index in seen or touching else low if level else max(z, low)
        points.append(PathPoint((x, y, z), stroke.gripper, seen[index].object if index in seen else ""))
    return points


def thinned(strokes: Sequence[Stroke]) -> list[Stroke]:
    """The path with all its events and as many bends as allowed, the sharpest first."""
    cuts = sorted({0, len(strokes) - 1, *(i for i, s in enumerate(strokes) if s.event)})
    tolerance = 0.01
    while True:
        kept = []
        for begin, end in pairwise(cuts):
            stretch = np.array([[s.u, s.v] for s in strokes[begin : end + 1]])
            bends = {tuple(p) for p in approximate_polygon(stretch, tolerance)[1:-1]}  # type: ignore[no-untyped-call]
            inner = [s for s in strokes[begin + 1 : end] if (s.u, s.v) in bends]
            kept += [strokes[begin], *inner]
        kept.append(strokes[cuts[-1]])
        if len(kept) <= MOST:
            return kept
        tolerance *= 1.5


def _takes(stroke: Stroke, view: View, request: PlanRequest) -> bool:
    """Whether the hand closes on something there; assumed if unknown."""
    try:
        return stroke.event and _met(pixel_at(view, stroke.u, stroke.v), view, request).object != ""
    except PlanningError:
        return True


def _met(pixel: Pixel, view: View, request: PlanRequest) -> Sighting:
    """The point that the hand meets at a pixel; raises :class:`PlanningError` for unreachable places."""
    scene = request.scene
    seen = sight(pixel, request.observation, scene)
    if not seen.object:
        seen = replace(seen, object=object_near(pixel, view, scene, MISSED * view.camera.width))
    if not scene.workspace.contains(seen.point, -0.02):
        raise PlanningError("what the picture shows there is beyond the robot's reach.")
    return seen
