"""Known objects among connected bodies, before any body is taken apart into pieces and solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree

from gvla2.geometry.transform import FloatArray, transform_points
from gvla2.geometry.views import Views
from gvla2.perception.clusters import without_specks
from gvla2.perception.fitting import Sights, sights_of
from gvla2.perception.fixtures import spread
from gvla2.perception.gallery import AROUND, FLOATS, MOSTLY, PLAIN, Gallery, Recognised, likelihood, on_scan
from gvla2.perception.labels import Labeller
from gvla2.perception.objects import MOST_POINTS
from gvla2.planning.scene import SceneObject
from gvla2_plugins.classical.pixels import TableFrame, bodies_of, choose, groups
from gvla2_plugins.classical.solids import evenly

LAYERS = 2  # how often bodies are looked at: what one known object leaves unexplained may be another
APART = 0.05  # metres between two pieces of one object, and between their heights
FEW = 0.15  # share of two objects' pixels that may be on neither
WHOLE = 0.8  # share of a body's pixels on a scan from which the rest are its edges


def known_objects(
    labellers: Sequence[Labeller],
    frames: Sequence[TableFrame],
    world_from_table: FloatArray,
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
    accepted: list[Recognised] = []
    for layer in range(LAYERS + 1):
        before = list(accepted)
        pixels = choose(frames, left)
        points = transform_points(world_from_table, pixels.points)
        explained = np.zeros(len(points), dtype=bool)
        found: list[tuple[Recognised, NDArray[np.bool_]]] = []
        if layer == 0:
            for one in gallery.fixtures(points, pixels.rgb, sights, height):
                found.append((one, one.explains(points)))
                accepted.append(one)
        else:
            bodies = groups(bodies_of(frames, pixels, jump, reach, least), least)
            unknown: list[NDArray[np.int64]] = []
            while bodies:
                members = bodies.pop(0)
                body = gallery.recognise(points[members], pixels.rgb[members], sights, height)
                if body is None or _remainder(body.object, points[members], accepted):
                    # Of a bowl seen at a slant only two opposite walls may be seen, of a box under a bowl its ends.
                    other = next(
                        (m for m in unknown if _beside(points[members], points[m], height, accepted)), None
                    )
                    if other is not None:
                        unknown = [m for m in unknown if m is not other]
                        bodies.insert(0, np.concatenate([members, other]))
                        continue
                    pair = _two(gallery, points[members], pixels.rgb[members], sights, height)
                    if not pair:
                        unknown.append(members)
                else:
                    pair = [(body, np.ones(len(members), dtype=bool))]
                    if body.stacked and body.fit.odds < PLAIN:  # or it leans on what stands beside it
                        pair = _two(gallery, points[members], pixels.rgb[members], sights, height) or pair
                for one, of_it in pair:
                    own, mine = one.explains(points), np.zeros(len(points), dtype=bool)
                    its = members[of_it]
                    mine[its] = own[its] | (not one.stacked and own[its].mean() > WHOLE)
                    found.append((one, mine))
                    accepted.append(one)
        found = [(one, mine) for one, mine in found if not any(_displaces(other, one) for other in accepted)]
        accepted = [*before, *(one for one, _ in found)]
        for one, mine in found:
            explained |= one.explains(points) | mine
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


def _remainder(obj: SceneObject, points: FloatArray, known: Sequence[Recognised]) -> bool:
    """Whether an object of points (N, 3) is only what a known one left: inside a solid one, or along its surface."""
    return any(_within(obj, one) or on_scan(one.fit, points, AROUND).mean() > MOSTLY for one in known)


def _within(obj: SceneObject, known: Recognised) -> bool:
    """Whether an object's middle is inside a known solid one, where nothing else can be."""
    solid = known.object.known is not None and not known.object.opening
    return solid and known.object.distances(obj.centre) == 0.0


def _displaces(one: Recognised, other: Recognised) -> bool:
    """Whether two objects are in the same place, and the first is the likelier one."""
    return one is not other and _within(other.object, one) and likelihood(one.fit) > likelihood(other.fit)


def _two(
    gallery: Gallery, points: FloatArray, rgb: FloatArray, sights: Sights, table: float
) -> list[tuple[Recognised, NDArray[np.bool_]]]:
    """Two known objects that touch and together explain a body: points (N, 3), and which (N,) are of each; or none."""
    plan = spread(points)[:, :2]
    if len(plan) < 2:  # as small as that it is one
        return []
    middle = plan.mean(axis=0)
    along = np.linalg.svd(plan - middle, full_matrices=False)[2][0] * plan.std()
    ends = kmeans2(plan, np.stack([middle - along, middle + along]), minit="matrix")[0]
    nearer = np.linalg.norm(points[:, None, :2] - ends, axis=2).argmin(axis=1)
    for part in (nearer == 0, nearer == 1):
        one = gallery.recognise(points[part], rgb[part], sights, table)
        if one is None:
            continue
        of_one = one.explains(points)
        rest = ~of_one
        other = gallery.recognise(points[rest], rgb[rest], sights, table) if rest.mean() > FEW else None
        if other is not None and (rest & ~other.explains(points)).mean() < FEW:
            return [(one, of_one), (other, rest)]
    return []


def _beside(one: FloatArray, other: FloatArray, table: float, known: Sequence[Recognised]) -> bool:
    """Whether points (N, 3) and (M, 3) above the table may be of one object that stands on something else, or on which
    something known stands.
    """
    heights = [np.percentile(points[:, 2], [5.0, 95.0]) for points in (one, other)]
    floats = min(low for low, _ in heights) >= table + FLOATS
    if np.abs(heights[0] - heights[1]).max() > APART or not (floats or _carry(one, other, table, known)):
        return False
    gap = cKDTree(one).query(other[:: max(1, len(other) // 200)])[0]
    return bool(np.min(gap) < APART)


def _carry(one: FloatArray, other: FloatArray, table: float, known: Sequence[Recognised]) -> bool:
    """Whether a known object that is not on the table stands over the gap between points (N, 3) and (M, 3)."""
    above = [each.object for each in known if each.object.bottom > table + FLOATS]

    def under(points: FloatArray, obj: SceneObject) -> bool:
        reach = 0.5 * float(obj.extents[:2].max()) + FLOATS
        return float(np.linalg.norm(points[:, :2] - obj.centre[:2], axis=1).min()) < reach

    return any(under(one, obj) and under(other, obj) for obj in above)
