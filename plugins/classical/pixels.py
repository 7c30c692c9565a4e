"""Usable pixels of all views as points in the table's frame, what space they show to be free, bodies and pieces.

A body hangs together in three dimensions, whatever its colours; a piece is of one paint as well. Within an image
neighbourhood is exact, however far apart the points of a steep face lie; across views, points that lie on one another
are of one body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_dilation, binary_fill_holes, distance_transform_edt
from scipy.spatial import cKDTree

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.perception.clusters import connected
from gvla2.perception.frames import usable_views
from gvla2.perception.registration import TablePlane, find_table
from gvla2.planning.colours import LIGHTNESS_WEIGHT, appearance
from gvla2.planning.scene import Box
from gvla2_plugins.classical import ClassicalConfig

IntArray = NDArray[np.int64]

ONE_SURFACE = 0.015  # metres of depth between neighbouring pixels of one surface
COLOUR_NOISE = 12.0  # levels of 255: neighbours that differ by much less are averaged


@dataclass(frozen=True)
class TableFrame:
    """One view, ready to use, in the table's frame: its top at z = 0.

    ``image`` (H, W, 3) uint8; ``depth`` (H, W) metres, NaN where nothing is known or where the robot is;
    ``rays`` (H, W, 3) directions whose multiple by depth, added to ``origin`` (3,), is the seen point; ``points``
    (H, W, 3), NaN where depth is.
    """

    camera: Camera
    image: NDArray[np.uint8]
    depth: FloatArray
    origin: FloatArray
    rays: FloatArray
    points: FloatArray

    def project(self, points: FloatArray) -> tuple[NDArray[np.bool_], IntArray, IntArray, FloatArray]:
        """Which of points (N, 3) the picture holds, (N,), and of those the rows, columns and depths."""
        uv, depth = self.camera.project(points)
        inside = self.camera.inside(uv)
        columns, rows = uv[inside].astype(np.int64).T
        return inside, rows, columns, depth[inside]


def usable_frames(views: Views, workspace: Box, least: int) -> tuple[list[TableFrame], TablePlane, list[str]]:
    """Frames, the table, and a sentence for each view that cannot be used.

    Pixels of which fewer than ``least`` of eight neighbours are at their depth are left out. Raises
    :class:`PerceptionError` when no view is left, or without a level plane under the workspace.
    """
    usable, notes = usable_views(views)
    for _, depth, _ in usable:
        depth[_support(depth) < least] = np.nan
    clouds = [view.camera.backproject(depth)[np.isfinite(depth)] for view, depth, _ in usable]
    table = find_table(clouds, workspace)
    frames = []
    for view, depth, _ in usable:
        pose = table.frame(workspace) @ view.camera.world_from_camera
        camera = replace(view.camera, world_from_camera=pose)
        origin, rays = camera.rays()
        image = view.image
        if np.median(np.abs(np.diff(image.astype(np.int16), axis=1))) > 0:  # less sensor noise; edges stay
            image = np.asarray(cv2.bilateralFilter(image, 5, COLOUR_NOISE, 1.5))
        frames.append(TableFrame(camera, image, depth, origin, rays, origin + rays * depth[..., None]))
    return frames, table, notes


def _support(depth: FloatArray) -> IntArray:
    """(H, W) how many of a pixel's eight neighbours are at its depth: few on edges, and where most depth was lost."""
    count = np.zeros(depth.shape, dtype=np.int64)
    for shift in ((0, 1), (1, -1), (1, 0), (1, 1)):  # each neighbour is the other's neighbour
        near = np.abs(np.roll(depth, shift, axis=(0, 1)) - depth) < ONE_SURFACE
        count += np.add(near, np.roll(near, np.negative(shift), axis=(0, 1)), dtype=np.int64)
    return count


def seen_through(frames: Sequence[TableFrame], points: FloatArray, margin: float = 0.01) -> NDArray[np.bool_]:
    """(N,) bool: points (N, 3) that some camera looked through to something behind.

    A point nearer than ``margin`` metres to the surface behind it does not count.
    """
    free = np.zeros(len(points), dtype=bool)
    for frame in frames:
        inside, rows, columns, depth = frame.project(points)
        free[inside] |= frame.depth[rows, columns] > depth + margin  # NaN compares false: unknown is not free
    return free


@dataclass(frozen=True)
class Pixels:
    """N pixels: ``view``, ``row``, ``column`` (N,); ``points`` (N, 3) metres; ``rgb`` (N, 3)
    in [0, 1]; ``look`` (N, 3) colour coordinates (see ``gvla2.planning.colours``); ``maps`` one (H, W) a view, the
    pixel's place in the list or -1.
    """

    view: IntArray
    row: IntArray
    column: IntArray
    points: FloatArray
    rgb: FloatArray
    look: FloatArray
    maps: tuple[IntArray, ...]

    def __len__(self) -> int:
        return len(self.view)

    def neighbours(self, jump: float) -> IntArray:
        """(E, 2) pairs of chosen pixels that touch along a side in one image, less than ``jump`` metres apart."""
        pairs = []
        for index in self.maps:
            for one, other in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
                both = (one >= 0) & (other >= 0)
                pairs.append(np.stack([one[both], other[both]], axis=1))
        touching: IntArray = np.concatenate(pairs)
        return np.asarray(touching[np.linalg.norm(np.subtract(*self.points[touching.T]), axis=1) < jump])


def choose(
    frames: Sequence[TableFrame], masks: Sequence[NDArray[np.bool_]], *, on_plane: bool = False
) -> Pixels:
    """The pixels of ``masks``, one (H, W) a frame.

    With ``on_plane`` their points are where the rays cross z = 0: the noise of the depth then has no say.
    """
    spots = [np.nonzero(mask) for mask in masks]
    starts = np.cumsum([0, *(len(rows) for rows, _ in spots)])
    maps = tuple(np.full(mask.shape, -1, dtype=np.int64) for mask in masks)
    for index, spot, start, end in zip(maps, spots, starts, starts[1:], strict=False):
        index[spot] = np.arange(start, end)
    shown = list(zip(frames, spots, strict=True))
    points = [plane_crossings(frame, at[0], at[1]) if on_plane else frame.points[at] for frame, at in shown]
    rgb = np.concatenate([frame.image[at] for frame, at in shown]) / 255.0
    view = np.repeat(np.arange(len(spots)), np.diff(starts))
    row, column = np.concatenate(spots, axis=1)
    return Pixels(view, row, column, np.concatenate(points), rgb, appearance(rgb), maps)


def plane_crossings(frame: TableFrame, rows: IntArray, columns: IntArray, height: float = 0.0) -> FloatArray:
    """(N, 3) points where the pixels' rays cross z = ``height`` of the frame's frame."""
    rays = frame.rays[rows, columns]
    slope = np.where(np.abs(rays[:, 2]) > 1e-6, rays[:, 2], np.nan)
    return np.asarray(frame.origin + rays * ((height - frame.origin[2]) / slope)[:, None])


LIKE = 14.0  # hues of pieces of one object differ by less
SHADED = 0.62  # L* + 16 of an object's darkest face, over that of its lightest, is more
LEAST = 3  # pixels of a piece; fewer are specks
DEEP = 3  # pixels that a mask grows down
MOST = 9000  # points that are searched for neighbours across views


def pieces_in_views(pixels: Pixels, jump: float, colour_step: float) -> IntArray:
    """(N,) piece of each pixel: connected within its image, without a jump of depth or colour."""
    pairs = pixels.neighbours(jump)
    change = np.linalg.norm(pixels.look[pairs[:, 0]] - pixels.look[pairs[:, 1]], axis=1)
    return connected(len(pixels), pairs[change < colour_step])


def join_across_views(pixels: Pixels, pieces: IntArray, reach: float, *, looks: bool = True) -> IntArray:
    """(N,) object of each pixel, -1 for specks: pieces of several views whose points lie within ``reach`` metres of
    one another, and that look alike, unless ``looks`` are to have no say.
    """
    sizes = np.bincount(pieces)
    keep = np.nonzero(sizes[pieces] >= LEAST)[0]
    if len(keep) == 0:
        return np.full(len(pixels), -1, dtype=np.int64)
    sample = keep[:: max(1, -(-len(keep) // MOST))]
    sampled = np.bincount(pieces[sample], minlength=len(sizes))
    pairs = cKDTree(pixels.points[sample]).query_pairs(reach, output_type="ndarray")
    a, b = sample[pairs[:, 0]], sample[pairs[:, 1]]
    across = (pieces[a] != pieces[b]) & (pixels.view[a] != pixels.view[b])
    a, b = a[across], b[across]
    # A vote is a point of one piece with some neighbour in the other, counted once.
    count = len(sizes)
    votes = np.unique(np.concatenate([a * count + pieces[b], b * count + pieces[a]]))
    keys, counts = np.unique(pieces[votes // count] * count + votes % count, return_counts=True)
    keys = np.stack([keys // count, keys % count], axis=1)
    small = np.minimum(sampled[keys[:, 0]], sampled[keys[:, 1]])
    like = np.ones(len(keys), dtype=bool)
    if looks:
        own = piece_looks(pixels, pieces)
        like = alike(own[keys[:, 0]], own[keys[:, 1]])
    joined = keys[like & (counts >= np.maximum(2, (0.12 if looks else 0.08) * small))]
    objects = connected(len(sizes), joined)[pieces]
    objects[sizes[pieces] < LEAST] = -1
    return objects


def join_in_bodies(pixels: Pixels, objects: IntArray, bodies: IntArray) -> IntArray:
    """(N,) objects (N,) of one body (N,) and one paint made one, the larger ones' names kept.

    Noise at rims tears the two sides of a wall apart: no image shows them as neighbours.
    """
    named = objects.copy()
    leaders: list[tuple[int, int, FloatArray]] = []  # body, object, look
    order = np.argsort(-np.bincount(objects[objects >= 0], minlength=1), kind="stable")
    for k in order:
        mine = np.nonzero(objects == k)[0]
        own = bodies[mine][bodies[mine] >= 0]
        if not len(own):
            continue
        body, look = int(np.bincount(own).argmax()), np.median(pixels.look[mine], axis=0)
        leader = next((t for b, t, other in leaders if b == body and alike(look, other)), -1)
        if leader < 0:
            leaders.append((body, int(k), look))
        else:
            named[mine] = leader
    return named


def piece_looks(pixels: Pixels, pieces: IntArray) -> FloatArray:
    """(P, 3) mean look of each piece."""
    sizes = np.maximum(1, np.bincount(pieces))
    return np.stack([np.bincount(pieces, weights=pixels.look[:, k]) / sizes for k in range(3)], axis=1)


def alike(one: FloatArray, other: FloatArray) -> NDArray[np.bool_]:
    """(...,) bool: looks (..., 3) that differ by light alone: one hue, lightness within what slope can do."""
    hue = np.linalg.norm(one[..., :2] - other[..., :2], axis=-1)
    lightness = [look[..., 2] / LIGHTNESS_WEIGHT + 16.0 for look in (one, other)]
    return np.asarray((hue < LIKE) & (np.minimum(*lightness) > SHADED * np.maximum(*lightness)))


def grow_down(
    frames: Sequence[TableFrame],
    masks: Sequence[NDArray[np.bool_]],
    low: Sequence[NDArray[np.bool_]],
    different: Sequence[NDArray[np.bool_]],
    colour_step: float,
) -> list[NDArray[np.bool_]]:
    """The masks (H, W) with the lowest pixels of each object, too near to the table to be separated by height.

    A pixel of ``low`` that looks ``different`` from the table joins a mask at most :data:`DEEP` pixels off, where it
    looks like the nearest pixel there: paint beside an object is left alone.
    """
    grown = []
    for frame, mask, near, other in zip(frames, masks, low, different, strict=True):
        # What looks unlike the table inside a raised rim is the floor of a plate or a bowl.
        current = mask | (binary_fill_holes(binary_closing(mask)) & near & other)
        fresh = binary_dilation(current, iterations=DEEP, mask=current | (near & other)) & ~current
        nearest = distance_transform_edt(~current, return_distances=False, return_indices=True)
        looks = [appearance(frame.image[at] / 255.0) for at in (fresh, tuple(nearest[:, fresh]))]
        fresh[fresh] = np.linalg.norm(looks[0] - looks[1], axis=1) < 0.5 * colour_step
        grown.append(current | fresh)
    return grown


def groups(labels: IntArray, least: int) -> list[IntArray]:
    """The indices of each label in (N,), -1 for none, that at least ``least`` have."""
    members = (np.nonzero(labels == k)[0] for k in np.unique(labels[labels >= 0]))
    return [one for one in members if len(one) >= least]


FRAGMENT = 0.3  # of a body's points: what is smaller, near, and not seen to be apart, is a piece of it
NEAR, HIDDEN = 0.02, 0.05  # metres between a body and its fragment; the latter where nothing else carries it
APART = 0.006  # metres behind a gap's middle where free space separates two bodies
HANGING = 0.01  # metres above the table: a fragment that is no lower rests on its body
SAME_PAINT = 2.5  # neighbouring pixels of one paint differ by less, in look, where pictures have no noise
FEWEST = 100  # least pairs of neighbours to judge how a body is painted


def bodies_of(
    frames: Sequence[TableFrame], pixels: Pixels, jump: float, reach: float, least: int
) -> IntArray:
    """(N,) body of each pixel, -1 for specks: neighbours in an image within ``jump`` metres of one another, and
    points of different views within ``reach``.
    """
    pieces = connected(len(pixels), pixels.neighbours(jump))
    labels = join_across_views(pixels, pieces, reach, looks=False)
    return _with_fragments(frames, pixels, labels, least)


def _with_fragments(frames: Sequence[TableFrame], pixels: Pixels, labels: IntArray, least: int) -> IntArray:
    """Fragments given to the body beside them, where no camera saw through the gap; small ones left are specks."""
    labels = labels.copy()
    sizes = np.bincount(labels[labels >= 0], minlength=1)
    order = np.argsort(sizes)
    for k in order:
        mine = np.nonzero(labels == k)[0]
        if not len(mine):
            continue
        rest = np.nonzero((labels >= 0) & (labels != k))[0]
        rest = rest[sizes[labels[rest]] * FRAGMENT > len(mine)] if len(rest) else rest
        low, high = pixels.points[mine].min(axis=0) - HIDDEN, pixels.points[mine].max(axis=0) + HIDDEN
        at = pixels.points[rest]
        rest = rest[((at > low) & (at < high)).all(axis=1)]
        if len(rest):
            distance, nearest = map(np.asarray, cKDTree(pixels.points[rest]).query(pixels.points[mine]))
            closest = np.argsort(distance)[:5]
            one, other = pixels.points[mine[closest]], pixels.points[rest[nearest[closest]]]
            gap = np.concatenate([one + share * (other - one) for share in (0.3, 0.5, 0.7)])
            hangs = pixels.points[mine, 2].min() > HANGING
            apart = seen_through(frames, gap, APART).any()
            if distance.min() < (HIDDEN if hangs else NEAR) and (hangs or not apart):
                host = labels[rest[nearest[closest[0]]]]
                labels[mine] = host
                sizes[host] += len(mine)
                continue
        if len(mine) < least:
            labels[mine] = -1
    return labels


def textured(pixels: Pixels, labels: IntArray, jump: float, noise: float, least: float) -> NDArray[np.bool_]:
    """(B,) bool by label: bodies of whose neighbouring pixels many differ in look by more than ``noise`` explains.

    ``least`` is that share; ``noise`` is what neighbouring pixels of one paint differ by, in colour from 0 to 1.
    """
    pairs = pixels.neighbours(jump)
    one, other = pairs[(np.diff(labels[pairs], axis=1) == 0)[:, 0] & (labels[pairs[:, 0]] >= 0)].T
    differ = np.linalg.norm(pixels.look[one] - pixels.look[other], axis=1) > SAME_PAINT
    # In the dark a little noise is much of hue.
    differ &= np.linalg.norm(pixels.rgb[one] - pixels.rgb[other], axis=1) > 3.0 * noise
    count = int(labels.max(initial=-1)) + 1
    pairs_of = np.bincount(labels[one], minlength=count)
    share = np.bincount(labels[one], differ, minlength=count) / np.maximum(1, pairs_of)
    return np.asarray((share > least) & (pairs_of >= FEWEST))


LAYER = (0.5, 2.0)  # of the least height: layers whose middle lies between these are judged as wholes
UP = 0.75  # of the least height: a layer whose middle is higher is an object

Masks = list[NDArray[np.bool_]]


def settle_layers(
    frames: Sequence[TableFrame],
    raised: Masks,
    paint: Masks,
    rise: float,
    reach: float,
    config: ClassicalConfig,
) -> tuple[Masks, Masks]:
    """``raised`` and ``paint``, one (H, W) a frame, with all pixels of a low layer of one paint in one of them.

    A pixel's height errs, the middle of a whole layer's does not. ``rise`` is the height from which one pixel counts
    as raised, ``reach`` as of :func:`join_across_views`, in metres.
    """
    pixels = choose(frames, [up | flat for up, flat in zip(raised, paint, strict=True)])
    side = np.zeros(len(pixels) + 1)  # the last is that of no pixel
    pieces = pieces_in_views(pixels, config.jump, config.colour_step)
    for members in groups(join_across_views(pixels, pieces, reach), config.min_points):
        middle = float(np.median(pixels.points[members, 2])) / rise
        if LAYER[0] < middle < LAYER[1]:
            side[members] = 1.0 if middle > UP else -1.0
    sides = [side[at] for at in pixels.maps]
    return (
        [(mask | (side > 0)) & (side >= 0) for mask, side in zip(raised, sides, strict=True)],
        [(mask | (side < 0)) & (side <= 0) for mask, side in zip(paint, sides, strict=True)],
    )
