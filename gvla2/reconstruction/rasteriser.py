"""A tile-based rasteriser of Gaussians on the CPU, with gradients.

``Rasteriser.render`` gives the image and alpha of one camera; ``forward`` and ``backward`` give them with the
gradients that an optimiser needs. The kernels are numba's, compiled on first use and cached. Work is shared by plain
threads (the kernels leave Python's lock), and no result depends on how many there are: tiles are independent, and sums
over tiles are taken in a fixed order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import Gaussians
from gvla2.reconstruction import (
    rasteriser_compositing,
    rasteriser_gradients,
    rasteriser_projection,
    rasteriser_tiles,
)
from gvla2.reconstruction.compiled import Floats, cores, run_together
from gvla2.reconstruction.rasteriser_projection import CAMERA_ENTRIES, SPLAT_COLUMNS, TILE

_FRUSTUM_MARGIN = 1.3  # as in 3DGS: beyond it the projection's linearisation is taken at the margin
_FEWEST_FOR_THREADS = 2000  # below, starting a thread costs more than it saves


@dataclass(frozen=True)
class Rasteriser:
    """Paints Gaussians; the defaults are those of 3D Gaussian splatting.

    ``low_pass`` square pixels added to both variances of an ellipse; ``near`` metres, nearer centres are left
    out; ``min_alpha`` contributions below it are left out; ``max_alpha`` no Gaussian alone hides more;
    ``stop`` a pixel is finished when it lets no more than this share of light pass; ``threads`` 0 means all cores.
    Raises :class:`ConfigurationError` for values that make no sense.
    """

    low_pass: float = 0.3
    near: float = 0.01
    min_alpha: float = 1 / 255
    max_alpha: float = 0.99
    stop: float = 1e-4
    threads: int = 0

    def __post_init__(self) -> None:
        if not (
            0 < self.min_alpha < self.max_alpha <= 1
            and self.near > 0
            and self.low_pass >= 0
            and 0 <= self.stop < 1
            and self.threads >= 0
        ):
            raise ConfigurationError(
                "A rasteriser needs 0 < min_alpha < max_alpha <= 1, near > 0, low_pass >= 0, 0 <= stop < 1 and "
                f"threads >= 0, got {self}."
            )

    def render(
        self, gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (1.0, 1.0, 1.0)
    ) -> tuple[Floats, Floats]:
        """Image (H, W, 3) and alpha (H, W), both float32 in [0, 1]; the image has the background added."""
        frame = forward(gaussians, camera, background, self)
        return np.clip(frame.image, 0.0, 1.0), frame.alpha


@dataclass(frozen=True)
class Frame:
    """One rendered camera, and what :func:`backward` needs to know of it.

    ``image`` (H, W, 3) with the background, not clipped; ``alpha`` (H, W) in [0, 1]. The rest is the rasteriser's
    own: ``splats`` (N, 12) projected Gaussians, ``boxes`` (N, 4) their tiles, ``offsets`` (tiles + 1,) and
    ``members`` (entries,) each tile's Gaussians, nearest first.
    """

    gaussians: Gaussians
    camera: Camera
    rasteriser: Rasteriser
    image: Floats
    alpha: Floats
    splats: Floats
    boxes: NDArray[np.int32]
    offsets: NDArray[np.int64]
    members: NDArray[np.int32]


@dataclass(frozen=True)
class GaussianGradients:
    """A loss's gradients, each in the shape of the field of :class:`Gaussians` of the same name, float32."""

    centres: Floats
    log_scales: Floats
    rotations: Floats
    opacity_logits: Floats
    sh_dc: Floats


def forward(
    gaussians: Gaussians,
    camera: Camera,
    background: tuple[float, float, float] = (1.0, 1.0, 1.0),
    rasteriser: Rasteriser = Rasteriser(),
) -> Frame:
    """Render, and keep what the gradients need. Raises :class:`GeometryError` for a K that is not a pinhole's."""
    count, height, width = len(gaussians), camera.height, camera.width
    across, down = -(-width // TILE), -(-height // TILE)
    tiles = across * down
    packed = _pack(camera, rasteriser)
    splats = np.empty((count, SPLAT_COLUMNS), np.float32)
    boxes = np.empty((count, 4), np.int32)
    centres, log_scales, rotations, logits, sh_dc, sh_rest = _contiguous(gaussians)
    parts = _parts(rasteriser, count)
    bounds = [count * part // parts for part in range(parts + 1)]
    counts = np.zeros((parts, tiles), np.int64)

    def project(part: int) -> None:
        rasteriser_projection.project(
            bounds[part], bounds[part + 1], packed, width, height,
            centres, log_scales, rotations, logits, sh_dc, sh_rest, splats, boxes, counts[part],
        )  # fmt: skip

    _share(project, parts)
    # Each part appends behind the one before it, so that a tile's list is in the Gaussians' order.
    ends = np.cumsum(counts.T.ravel()).reshape(tiles, parts)
    cursors = np.ascontiguousarray((ends - counts.T).T)
    offsets = np.concatenate([np.zeros(1, np.int64), ends[:, -1]])
    members = np.empty(offsets[-1], np.int32)
    depths = np.empty(offsets[-1], np.float32)

    def scatter(part: int) -> None:
        rasteriser_tiles.scatter(
            bounds[part], bounds[part + 1], across, boxes, splats, cursors[part], members, depths
        )

    _share(scatter, parts)
    image = np.empty((height, width, 3), np.float32)
    left = np.empty((height, width), np.float32)
    keys = depths.view(np.uint32)  # positive floats are ordered as their bits
    longest = int(np.diff(offsets).max(initial=0))
    colour = np.asarray(background, np.float32)

    def composite(part: int) -> None:
        rasteriser_compositing.composite(
            part, parts, across, offsets, members, keys, splats, colour,
            np.float32(rasteriser.max_alpha), np.float32(rasteriser.stop), image, left, longest,
        )  # fmt: skip

    _share(composite, parts)
    return Frame(gaussians, camera, rasteriser, image, 1 - left, splats, boxes, offsets, members)


def backward(frame: Frame, to_image: Floats, to_alpha: Floats | None = None) -> GaussianGradients:
    """Gradients of a loss from its gradients ``to_image`` (H, W, 3) and ``to_alpha`` (H, W) at a frame.

    They are those of the unclipped image, of centres in the frame of the Gaussians. Of the colour only the
    constant harmonic is differentiated: ``sh_rest`` is rendered, but neither it nor the centres' share in the
    direction of view gets a gradient. Raises :class:`GeometryError` for a gradient of another size.
    """
    gaussians, rasteriser = frame.gaussians, frame.rasteriser
    count, shape = len(gaussians), frame.alpha.shape
    to_image = np.ascontiguousarray(to_image, np.float32)
    to_alpha = np.zeros(shape, np.float32) if to_alpha is None else np.ascontiguousarray(to_alpha, np.float32)
    if to_image.shape != (*shape, 3) or to_alpha.shape != shape:
        raise GeometryError(
            f"A frame of {shape} pixels needs gradients of {(*shape, 3)} and {shape}, "
            f"got {to_image.shape} and {to_alpha.shape}."
        )
    boxes = frame.boxes
    first = np.zeros(count + 1, np.int64)
    np.cumsum((boxes[:, 1] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 2]), out=first[1:])
    sums = np.zeros((len(frame.members), rasteriser_compositing.SUMS), np.float32)
    left, across = 1 - frame.alpha, -(-shape[1] // TILE)
    parts = _parts(rasteriser, count)

    def composite_back(part: int) -> None:
        rasteriser_compositing.composite_back(
            part, parts, across, frame.offsets, frame.members, boxes, frame.splats, first,
            np.float32(rasteriser.max_alpha), np.float32(rasteriser.stop),
            frame.image, left, to_image, to_alpha, sums,
        )  # fmt: skip

    _share(composite_back, parts)
    packed = _pack(frame.camera, rasteriser)
    centres, log_scales, rotations, *_ = _contiguous(gaussians)
    found = GaussianGradients(
        *(np.zeros(size, np.float32) for size in ((count, 3), (count, 3), (count, 4), (count,), (count, 3)))
    )
    bounds = [count * part // parts for part in range(parts + 1)]

    def project_back(part: int) -> None:
        rasteriser_gradients.project_back(
            bounds[part], bounds[part + 1], packed, centres, log_scales, rotations, frame.splats, first, sums,
            found.centres, found.log_scales, found.rotations, found.opacity_logits, found.sh_dc,
        )  # fmt: skip

    _share(project_back, parts)
    return found


def _pack(camera: Camera, rasteriser: Rasteriser) -> Floats:
    """The camera as the kernels read it, see ``rasteriser_projection.ROTATION`` and the following."""
    K, pose = camera.K, camera.camera_from_world
    if K[1, 0] != 0 or not np.array_equal(K[2], [0, 0, 1]):
        raise GeometryError(
            f"Camera '{camera.name}': K must be upper triangular with last row 0 0 1, got\n{K}"
        )
    # The slopes x/z, y/z at which the image ends; the principal point need not be central, nor in the image.
    corners = np.array(
        [[0, 0, 1], [camera.width, 0, 1], [0, camera.height, 1], [camera.width, camera.height, 1]]
    )
    slopes = corners @ np.linalg.inv(K).T
    middle, half = (slopes.max(axis=0) + slopes.min(axis=0)) / 2, np.ptp(slopes, axis=0) / 2
    low, high = middle - _FRUSTUM_MARGIN * half, middle + _FRUSTUM_MARGIN * half
    packed = np.concatenate(
        [
            pose[:3, :3].ravel(),
            pose[:3, 3],
            [K[0, 0], K[0, 1], K[0, 2], K[1, 1], K[1, 2]],
            camera.position,
            [low[0], high[0], low[1], high[1]],
            [rasteriser.low_pass, rasteriser.near, rasteriser.min_alpha],
        ]
    )
    assert len(packed) == CAMERA_ENTRIES
    return packed.astype(np.float32)


def _contiguous(of: Gaussians) -> list[Floats]:
    """What the kernels read: centres, log-scales, rotations, logits, constant and higher harmonics (none: (0, 0))."""
    rest = np.zeros((0, 0), np.float32) if of.sh_rest is None else of.sh_rest
    arrays = (of.centres, of.log_scales, of.rotations, of.opacity_logits, of.sh_dc, rest)
    return [np.ascontiguousarray(array) for array in arrays]


def _parts(rasteriser: Rasteriser, count: int) -> int:
    """Into how many parts the work is cut."""
    if count < _FEWEST_FOR_THREADS:
        return 1
    return rasteriser.threads or cores()


def _share(work: Callable[[int], None], parts: int) -> None:
    run_together([partial(work, part) for part in range(parts)])
