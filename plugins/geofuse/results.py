"""Results of MV-SAM3D, SAM3D and related programs: reading them, and moving them into the calibrated frame.

Gauss-Newton on silhouettes finds the similarity: the mesh is drawn into each view; where its silhouette has its rim, a
point of the surface is known (depth map), and the mask's signed distance at that pixel should be zero. One residual a
rim pixel, seven unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, GeometryError, reading
from gvla2.geometry.gaussians import Gaussians, read_gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh
from gvla2.geometry.transform import FloatArray, rigid, transform_points
from gvla2.geometry.views import Views
from gvla2.io.foreign import read_arrays
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.silhouette import Silhouette, depth_maps, mask_agreement, mask_iou, mask_silhouettes
from gvla2.reconstruction.surfels import surfels

if TYPE_CHECKING:
    from gvla2_plugins.geofuse import ResultTreeConfig

_POOR = 0.6
"""Mean IoU with the masks below which an alignment is called poor."""
_CAMERA_FROM_P3D = np.diag([-1.0, -1.0, 1.0])  # PyTorch3D's cameras look along z too, with x left and y up


def read_result(folder: Path) -> tuple[Reconstruction, FloatArray | None]:
    """``result.glb`` (mesh) with ``result.ply`` (Gaussians) where it is, in a canonical frame, Z-up, and their pose.

    The pose (4, 4) of ``params.npz``, a similarity, takes them into the frame of the first camera (OpenCV), up to the
    scale of the depth that they were made with; None if the result does not say. Raises :class:`GeometryError`, naming
    the file, when the mesh is absent or a file is broken.
    """
    ply, glb = folder / "result.ply", folder / "result.glb"
    if not glb.is_file():
        present = ", ".join(sorted(p.name for p in folder.iterdir())[:8])
        raise GeometryError(f"{folder} has no {glb.name}. It holds: {present or 'nothing'}.")
    gaussians = read_gaussians(ply) if ply.is_file() else None
    return Reconstruction(gaussians, read_mesh(glb)), _read_pose(folder / "params.npz")


def _read_pose(path: Path) -> FloatArray | None:
    """The pose of ``params.npz``: scale, rotation (wxyz) and translation in PyTorch3D's row convention."""
    if not path.is_file():
        return None
    with reading("the pose", path):
        arrays = read_arrays(path, "the pose", ("scale", "rotation", "translation"))
        if len(arrays) < 3:
            return None
        scale = float(np.mean(arrays["scale"]))
        rotation = Rotation.from_quat(np.ravel(arrays["rotation"]), scalar_first=True).as_matrix()
        translation = np.asarray(arrays["translation"], dtype=np.float64).reshape(3)
        # Rows are multiplied from the right there: p (s R) + t, so that R turns the other way round.
        if not (scale > 0 and np.isfinite([scale, *translation]).all()):
            raise ValueError(f"its scale {scale} and translation {translation} are no similarity's.")
        return rigid(scale * _CAMERA_FROM_P3D @ rotation.T, _CAMERA_FROM_P3D @ translation)


def align_result(result: Reconstruction, pose: FloatArray | None, views: Views, count: int) -> Reconstruction:
    """The result in the views' calibrated frame, aligned with the masks by a similarity.

    Starts from the result's own pose when it has one, whose scale about the first camera is searched over four decades;
    else from the 24 quarter turns, each fitted to the masks' carved hull. A result without Gaussians gets ``count``
    flat ones on its mesh. The status says how well the silhouettes fit if they fit poorly.
    """
    mesh, camera, notes = result.mesh, views[0].camera, []
    assert mesh is not None
    if pose is not None:
        in_world, scales = camera.world_from_camera @ pose, np.geomspace(0.01, 100.0, 81)
        starts = [rigid(s * np.eye(3), (1 - s) * camera.position) @ in_world for s in scales]
    else:
        target, turns = carve(views, resolution=32).mesh.bounds, Rotation.create_group("O").as_matrix()
        starts = [np.eye(4), *(_fitted(mesh, target, turn) for turn in turns)]
    moved, iou = register(mesh, views, starts)
    if (gaussians := result.gaussians) is None:
        gaussians = surfels(mesh, None, count)
        notes.append("the result has no .ply, flat Gaussians lie on the mesh")
    if iou < _POOR:
        notes.append(f"the silhouettes fit poorly, mean IoU {iou:.2f}")
    status = f"fallback: {'; '.join(notes)}" if notes else "ok"
    return Reconstruction(place_gaussians(gaussians, moved), place_mesh(mesh, moved), status)


def place_gaussians(gaussians: Gaussians, similarity: FloatArray) -> Gaussians:
    """Gaussians in the target frame of a similarity (4, 4), with their scales and rotations."""
    scale = float(np.cbrt(np.linalg.det(similarity[:3, :3])))
    own = Rotation.from_quat(gaussians.rotations, scalar_first=True)
    turned = (Rotation.from_matrix(similarity[:3, :3] / scale) * own).as_quat(scalar_first=True)
    return replace(
        gaussians,
        centres=transform_points(similarity, gaussians.centres).astype(np.float32),
        log_scales=gaussians.log_scales + np.float32(np.log(scale)),
        rotations=turned.astype(np.float32),
    )


def place_mesh(mesh: TriangleMesh, similarity: FloatArray) -> TriangleMesh:
    """The mesh in the target frame of a similarity (4, 4)."""
    return mesh.with_vertices(transform_points(similarity, mesh.vertices))


_ITERATIONS = 12
_HUBER = 3.0  # pixels
_DAMPING = 1e-3
_RIM = 400  # rim pixels used per view
_GOOD = 0.95  # IoU at which no further start is tried
_TRIED_FURTHER = 4  # number of starts refined; the others fit too badly


def register(mesh: TriangleMesh, views: Views, starts: Sequence[FloatArray]) -> tuple[FloatArray, float]:
    """The similarity (4, 4) that fits a mesh's silhouettes to the masks, and its mean IoU with them.

    The likeliest starts are refined; that converges from displacements of about a quarter of the object. Raises
    :class:`GeometryError` when no view shows the object.
    """
    shown, _ = mask_silhouettes(views)
    scores = [mask_agreement(place_mesh(mesh, start), shown) for start in starts]
    best, iou = starts[0], -1.0
    for i in np.argsort(-np.array(scores), kind="stable")[:_TRIED_FURTHER]:
        found, fits = _refine(mesh, shown, starts[i])
        best, iou = (found, fits) if fits > iou else (best, iou)
        if iou > _GOOD:
            break
    return best, iou


def _fitted(mesh: TriangleMesh, target: FloatArray, turn: FloatArray) -> FloatArray:
    """The turn, with scale and place such that the mesh's box has the size and middle of the box ``target`` (2, 3)."""
    box = mesh.bounds @ turn.T
    sizes = np.maximum(np.ptp(box, axis=0), 1e-9)
    scale = float(np.exp(np.mean(np.log(target[1] - target[0]) - np.log(sizes))))
    return rigid(scale * turn, target.mean(axis=0) - scale * box.mean(axis=0))


def _refine(mesh: TriangleMesh, shown: Sequence[Silhouette], start: FloatArray) -> tuple[FloatArray, float]:
    """Levenberg-Marquardt with Huber weights; the best similarity seen on the way, and its IoU."""
    best, best_iou, now = start, -1.0, start
    for _ in range(_ITERATIONS + 1):
        placed = place_mesh(mesh, now)
        depths = depth_maps(placed, [s.camera for s in shown])
        iou = float(np.mean([mask_iou(np.isfinite(d), s) for d, s in zip(depths, shown, strict=True)]))
        if iou > best_iou:
            best, best_iou = now, iou
        centre = placed.vertices.mean(axis=0)
        size = float(np.linalg.norm(placed.vertices - centre, axis=1).max())
        rows = [_residuals(d, s, centre, size) for d, s in zip(depths, shown, strict=True)]
        residual = np.concatenate([r for r, _ in rows])
        if len(residual) < 7:
            break
        jacobian = np.concatenate([j for _, j in rows])
        weight = np.minimum(1.0, _HUBER / np.maximum(np.abs(residual), 1e-9))
        normal = jacobian.T @ (weight[:, None] * jacobian)
        normal += _DAMPING * np.diag(np.maximum(np.diag(normal), 1e-9 * np.trace(normal) + 1e-12))
        step = np.clip(-np.linalg.solve(normal, jacobian.T @ (weight * residual)), -0.3, 0.3)
        if float(np.abs(step).max()) < 1e-5:
            break
        # Shift (in units of the object's size), turn and scale about the object's centre.
        rotation, scale = Rotation.from_rotvec(step[3:6]).as_matrix(), float(np.exp(step[6]))
        now = rigid(scale * rotation, centre + size * step[:3] - scale * rotation @ centre) @ now
    return best, best_iou


def _residuals(
    depth: NDArray[np.float32], s: Silhouette, centre: FloatArray, size: float
) -> tuple[FloatArray, FloatArray]:
    """Signed pixels (M,) from the rim of the drawn mesh to the mask's contour, and their derivatives (M, 7)."""
    covered = np.isfinite(depth)
    rim = covered & ~binary_erosion(covered, border_value=1)
    pixels = np.argwhere(rim & np.isfinite(s.distance))
    pixels = pixels[:: max(1, len(pixels) // _RIM)]
    z = depth[pixels[:, 0], pixels[:, 1]].astype(np.float64)
    uv = pixels[:, ::-1].astype(np.float64) + 0.5
    local = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(s.camera.K).T * z[:, None]
    points = local @ s.camera.world_from_camera[:3, :3].T + s.camera.position
    # Of the mask's signed distance along u and v, central differences.
    slope = [np.clip(0.5 * (s.sample(uv + step) - s.sample(uv - step)), -1.5, 1.5) for step in np.eye(2)]
    # d(u, v)/d(x, y, z) in the camera, contracted with the distance's slope.
    along = np.column_stack(slope) @ s.camera.K[:2, :2] / z[:, None]
    along_z = -np.einsum("mk,mk->m", along, local[:, :2]) / z
    world = np.column_stack([along, along_z]) @ s.camera.world_from_camera[:3, :3].T
    arm = points - centre
    jacobian = np.column_stack([size * world, np.cross(arm, world), np.einsum("ij,ij->i", world, arm)])
    # The rim pixel's centre lies half a pixel inside the drawn silhouette.
    return s.sample(uv) - 0.5, jacobian


class ResultTreeReconstructor:
    """Reads the tree again for each call, so that it may be filled while a sweep runs.

    Raises :class:`ConfigurationError` when root or object is not given.
    """

    def __init__(self, config: ResultTreeConfig) -> None:
        if not (config.root and config.object):
            raise ConfigurationError(
                f"result_tree reads <root>/<object>/{config.views}views: give both reconstructor.root=PATH and "
                "reconstructor.object=NAME."
            )
        self._config = config

    def reconstruct(self, views: Views) -> Reconstruction:
        """The result in the views' frame; a :class:`gvla2.errors.GeometryError` names the missing or broken file."""
        c, root = self._config, Path(self._config.root)
        folder = root / c.object / f"{c.views}views"
        if not folder.is_dir():
            there = sorted(str(p.parent.relative_to(root)) for p in root.glob("*/*views/result.*"))
            raise GeometryError(f"There is no folder {folder}. Results there: {', '.join(there) or 'none'}.")
        return align_result(*read_result(folder), views, c.gaussians)
