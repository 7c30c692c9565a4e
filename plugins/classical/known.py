"""Known objects among connected bodies, before any body is taken apart into pieces and solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.transform import invert_rigid, transform_points
from gvla2.geometry.views import Views
from gvla2.perception.clusters import without_specks
from gvla2.perception.fitting import sights_of
from gvla2.perception.gallery import Gallery, Recognised
from gvla2.perception.labels import Labeller
from gvla2.planning.scene import SceneObject
from gvla2_plugins.classical.naming import MOST_POINTS
from gvla2_plugins.classical.pixels import TableFrame, choose
from gvla2_plugins.classical.segmentation import bodies_of, groups
from gvla2_plugins.classical.solids import evenly

LAYERS = 2  # how often bodies are looked at: what one known object leaves unexplained may be another
WHOLE = 0.8  # share of a body's pixels on a scan from which the rest are its edges


def known_objects(
    labellers: Sequence[Labeller],
    frames: Sequence[TableFrame],
    raised: Sequence[NDArray[np.bool_]],
    views: Views,
    height: float,
    jump: float,
    reach: float,
    least: int,
) -> tuple[list[SceneObject], Sequence[NDArray[np.bool_]]]:
    """The gallery's objects among the ``raised`` pixels, (H, W) a frame, in the world, and the pixels that are left.

    ``height`` is the table's; ``jump``, ``reach`` and ``least`` are those of :func:`bodies_of`.
    """
    known: list[SceneObject] = []
    gallery = next((one for one in labellers if isinstance(one, Gallery)), None)
    if gallery is None:
        return known, raised
    sights, left = sights_of(views), [mask.copy() for mask in raised]
    for layer in range(LAYERS + 1):
        pixels = choose(frames, left)
        points = transform_points(invert_rigid(frames[0].frame_from_world), pixels.points)
        explained = np.zeros(len(points), dtype=bool)
        found: list[tuple[Recognised, NDArray[np.bool_]]] = []
        if layer == 0:
            for one in gallery.fixtures(points, pixels.rgb, sights, height):
                found.append((one, one.explains(points)))
        else:
            for members in groups(bodies_of(frames, pixels, jump, reach, least), least):
                body = gallery.recognise(points[members], pixels.rgb[members], sights, height)
                if body is None or _within(body.object, known):
                    continue
                own, mine = body.explains(points), np.zeros(len(points), dtype=bool)
                mine[members] = own[members] | (not body.stacked and own[members].mean() > WHOLE)
                found.append((body, mine))
                explained |= own | mine
        for one, mine in found:
            explained |= one.explains(points)
            whole = replace(one.object, id=f"known{len(known)}", points=evenly(points[mine], MOST_POINTS))
            ids = {one.object.id: whole.id} | {p.id: f"{whole.id}.{k}" for k, p in enumerate(one.parts)}
            known.append(whole)
            known += [replace(part, id=ids[part.id], parent=ids[part.parent]) for part in one.parts]
        if layer and not explained.any():
            break
        for number, mask in enumerate(left):
            gone = explained & (pixels.view == number)
            mask[pixels.row[gone], pixels.column[gone]] = False
    return known, [without_specks(mask) for mask in left]


def _within(obj: SceneObject, known: Sequence[SceneObject]) -> bool:
    """Whether an object lies inside a solid one that is known already: it is a remainder of that."""
    return any(o.known is not None and not o.opening and o.distances(obj.centre) == 0.0 for o in known)
