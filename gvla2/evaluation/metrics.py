"""How far a reconstruction is from the truth: Chamfer distances, PSNR and SSIM. LPIPS has a module of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray

SURFACE_SAMPLES = 100_000
SSIM_WINDOW = 7


@dataclass(frozen=True)
class Truth:
    """An object's true shape, prepared for many comparisons.

    ``surface`` (N, 3) area-weighted samples in the calibrated frame; ``vertices`` (V, 3) all vertices of the true mesh,
    scaled to their own unit box; the trees hold the same points.
    """

    surface: FloatArray
    vertices: FloatArray
    surface_tree: cKDTree
    vertex_tree: cKDTree

    @classmethod
    def of(cls, mesh: TriangleMesh, samples: int = SURFACE_SAMPLES, seed: int = 0) -> Truth:
        """Sample a true mesh that lies in the calibrated frame."""
        surface, _ = mesh.sample(samples, np.random.default_rng(seed))
        vertices = unit_box(mesh.vertices)
        return cls(surface, vertices, cKDTree(surface), cKDTree(vertices))


def surface_points(
    mesh: TriangleMesh | None, centres: FloatArray | None, samples: int = SURFACE_SAMPLES, seed: int = 1
) -> tuple[FloatArray, str]:
    """Points (N, 3) that represent a reconstruction's surface, and their kind: ``mesh`` or ``centres``.

    Area-weighted samples of its mesh if it has one with faces, else all Gaussian centres as they are.
    Raises :class:`GeometryError` when it has neither.
    """
    if mesh is not None and len(mesh.faces):
        return mesh.sample(samples, np.random.default_rng(seed))[0], "mesh"
    if centres is not None and len(centres):
        return np.asarray(centres, dtype=np.float64), "centres"
    raise GeometryError("The reconstruction has neither a mesh nor Gaussians: no Chamfer distance.")


def chamfer(points: FloatArray, truth: FloatArray, tree: cKDTree | None = None, workers: int = -1) -> float:
    """Symmetric Chamfer distance, in thousandths of the frame's unit.

    1000 * (mean distance of points (N, 3) to the nearest truth (M, 3) + mean distance the other way) / 2, Euclidean,
    not squared. ``tree`` is the truth's k-d tree, if already built; ``workers`` threads, -1 for all cores.
    """
    there, _ = (cKDTree(truth) if tree is None else tree).query(points, workers=workers)
    back, _ = cKDTree(points).query(truth, workers=workers)
    return float(500.0 * (np.mean(there) + np.mean(back)))


def cd_surface(points: FloatArray, truth: Truth, workers: int = -1) -> float:
    """Chamfer distance of surface points in the calibrated frame: position, scale and shape all count."""
    return chamfer(points, truth.surface, truth.surface_tree, workers)


def cd_official(vertices: FloatArray, truth: Truth, workers: int = -1) -> float:
    """Chamfer distance of all vertices, each shape scaled to its own unit box, as the released evaluator takes it.

    It hides errors of position and scale, and depends on a mesh's resolution.
    """
    return chamfer(unit_box(vertices), truth.vertices, truth.vertex_tree, workers)


def unit_box(points: FloatArray) -> FloatArray:
    """Points (N, 3) moved and scaled so that their bounding box is centred and its longest side is 1."""
    low, high = points.min(axis=0), points.max(axis=0)
    side = float((high - low).max())
    if not side > 0:
        raise GeometryError("Points that all coincide have no box to scale to.")
    return np.asarray((points - 0.5 * (low + high)) / side)


def psnr(image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio in dB of images (H, W, 3) in [0, 1], background included.

    Equal images give 100 dB, not infinity, so that means stay finite.
    """
    error = float(np.mean((np.asarray(image, dtype=np.float64) - target) ** 2))
    return 100.0 if error < 1e-10 else -10.0 * float(np.log10(error))


def ssim(image: NDArray[np.floating], target: NDArray[np.floating]) -> float:
    """Structural similarity of images (H, W, 3) in [0, 1]: scikit-image, uniform 7 x 7 window, mean of the channels."""
    from skimage.metrics import structural_similarity

    compare: Any = structural_similarity  # scikit-image has no type annotations
    return float(
        compare(
            np.asarray(target, dtype=np.float32),
            np.asarray(image, dtype=np.float32),
            win_size=SSIM_WINDOW,
            channel_axis=2,
            data_range=1.0,
        )
    )
