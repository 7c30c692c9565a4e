"""How far a reconstruction is from the truth: Chamfer distances, PSNR and SSIM."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gvla2.errors import GeometryError
from gvla2.evaluation.protocol import ObjectViews
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.contracts import Reconstruction, Renderer

SURFACE_SAMPLES = 100_000
SSIM_WINDOW = 7
MEASURES = ("cd_surface", "cd_official", "psnr", "ssim")


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


def chamfer(points: FloatArray, truth: cKDTree, workers: int = -1) -> float:
    """Symmetric Chamfer distance, in thousandths of the frame's unit.

    1000 * (mean distance of points (N, 3) to the nearest of the truth + mean distance the other way) / 2, Euclidean,
    not squared. ``truth`` is the k-d tree of its points; ``workers`` threads, -1 for all cores.
    """
    there, _ = truth.query(points, workers=workers)
    back, _ = cKDTree(points).query(truth.data, workers=workers)
    return float(500.0 * (np.mean(there) + np.mean(back)))


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


class ReconstructionJudge:
    """Measures reconstructions of one object; the truth is prepared once.

    ``workers`` is the number of threads for nearest neighbours, -1 for all cores; ``samples`` how many points of a
    surface are compared.

    ``cd_surface`` compares surface points in the calibrated frame: position, scale and shape all count. ``cd_official``
    compares all vertices, each shape scaled to its own unit box, as the released evaluator does: it hides errors of
    position and scale, and depends on a mesh's resolution. ``psnr`` and ``ssim`` are means over the target views.
    """

    def __init__(
        self, views: ObjectViews, renderer: Renderer, workers: int = -1, samples: int = SURFACE_SAMPLES
    ) -> None:
        self._views, self._renderer, self._workers, self._samples = views.targets, renderer, workers, samples
        self._targets = [(view.image / 255).astype(np.float32) for view in views.targets]
        self._truth: tuple[cKDTree, cKDTree] | None = None
        if views.mesh is not None:
            surface, _ = views.mesh.sample(samples, np.random.default_rng(0))
            self._truth = cKDTree(surface), cKDTree(unit_box(views.mesh.vertices))

    def measure(self, made: Reconstruction) -> tuple[dict[str, float | None], str]:
        """All measures by name (None: not measured), and which points the surface distance used."""
        measures: dict[str, float | None] = dict.fromkeys(MEASURES)
        points = "none"
        if self._truth is not None:
            centres = None if made.gaussians is None else made.gaussians.centres.astype(np.float64)
            surface, points = surface_points(made.mesh, centres, self._samples)
            vertices = made.mesh.vertices if made.mesh is not None and points == "mesh" else surface
            measures["cd_surface"] = chamfer(surface, self._truth[0], self._workers)
            measures["cd_official"] = chamfer(unit_box(vertices), self._truth[1], self._workers)
        if made.gaussians is not None:
            cameras = [view.camera for view in self._views]
            images = [np.clip(self._renderer.render(made.gaussians, camera)[0], 0, 1) for camera in cameras]
            pairs = list(zip(images, self._targets, strict=True))
            measures["psnr"] = float(np.mean([psnr(*pair) for pair in pairs]))
            measures["ssim"] = float(np.mean([ssim(*pair) for pair in pairs]))
        return measures, points
