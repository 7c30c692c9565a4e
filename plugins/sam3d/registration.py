"""Aligning a shape with the views' masks by a similarity, and moving a whole reconstruction by one.

Gauss-Newton on silhouettes: the shape is drawn into each view; where its silhouette has its rim, a point of the surface
is known (depth map), and the mask's signed distance at that pixel should be zero. One residual a rim pixel, seven
unknowns. Gaussians move with their rotations, scales and harmonics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from gvla2.errors import GeometryError
from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.carving import Carving, carve
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.rasteriser import harmonics
from gvla2.reconstruction.silhouette import Silhouette, depth_map, mask_agreement, mask_iou, mask_silhouettes
from gvla2.reconstruction.sim3 import Sim3


def turned_harmonics(sh_rest: NDArray[np.float32], rotation: FloatArray) -> NDArray[np.float32]:
    """Coefficients (N, 3k) of the files, k = 3, 8 or 15, in a frame turned by ``rotation`` (3, 3).

    The colour seen along a direction d before is the colour seen along R d after. Each degree turns within itself;
    its matrix is found from the basis' values at as many directions as fix it.
    """
    n, columns = sh_rest.shape
    coefficients = sh_rest.reshape(n, 3, columns // 3).astype(np.float64)
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(64, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = _basis(directions), _basis(directions @ rotation.T)
    turned = np.empty_like(coefficients)
    start = 0
    for degree in range(1, 4):
        stop = start + 2 * degree + 1
        if stop > coefficients.shape[2]:
            break
        matrix = np.linalg.lstsq(after[:, start:stop], before[:, start:stop], rcond=None)[0]
        turned[:, :, start:stop] = coefficients[:, :, start:stop] @ matrix.T
        start = stop
    return turned.reshape(n, columns).astype(np.float32)


def _basis(directions: FloatArray) -> FloatArray:
    """(M, 15) at unit directions (M, 3)."""
    return np.stack(harmonics(*directions.T), axis=1)


def place(reconstruction: Reconstruction, sim3: Sim3) -> Reconstruction:
    """The reconstruction in the similarity's target frame: Gaussians with all they have, and mesh."""
    gaussians, mesh = reconstruction.gaussians, reconstruction.mesh
    return replace(
        reconstruction,
        gaussians=None if gaussians is None else place_gaussians(gaussians, sim3),
        mesh=None if mesh is None else place_mesh(mesh, sim3),
    )


def place_mesh(mesh: TriangleMesh, sim3: Sim3) -> TriangleMesh:
    """The mesh in the similarity's target frame."""
    return mesh.with_vertices(sim3.apply(mesh.vertices))


def place_gaussians(gaussians: Gaussians, sim3: Sim3) -> Gaussians:
    """Gaussians in the similarity's target frame: centres, scales, rotations and harmonics."""
    rest = gaussians.sh_rest
    return replace(
        gaussians,
        centres=sim3.apply(gaussians.centres).astype(np.float32),
        log_scales=(gaussians.log_scales + np.float32(np.log(sim3.scale))).astype(np.float32),
        rotations=_turned(gaussians.rotations, sim3),
        sh_rest=None if rest is None else turned_harmonics(rest, sim3.rotation),
    )


def _turned(quaternions: NDArray[np.float32], sim3: Sim3) -> NDArray[np.float32]:
    """Quaternions wxyz (N, 4) turned by the similarity's rotation, each as long as before."""
    x, y, z, w = Rotation.from_matrix(sim3.rotation).as_quat()
    left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return np.asarray(quaternions.astype(np.float64) @ left.T, dtype=np.float32)


_ITERATIONS = 20
_HUBER = 3.0  # pixels
_DAMPING = 1e-3
_PATIENCE = 4  # steps without a better IoU before giving up
_RIM = 400  # rim pixels used per view
_GOOD = 0.95  # IoU at which no further start is tried
_TRIED_FURTHER = 4  # number of starts refined; the others fit too badly


@dataclass(frozen=True)
class Registration:
    """``sim3`` from the shape's frame to the views' world, and the mean ``iou`` with the masks there."""

    sim3: Sim3
    iou: float


def register_unposed(mesh: TriangleMesh, views: Views) -> Registration:
    """The similarity that fits a mesh's silhouettes to the masks, for a shape whose frame is turned by quarter turns.

    Tries the shape as it is and in the 24 quarter turns, each fitted to the masks' carved hull. Raises
    :class:`GeometryError` for an empty mesh and when no view shows the object.
    """
    hull = carve(views, resolution=32)
    return _best(mesh, views, [Sim3.identity(), *(_fitted(mesh, hull, turn) for turn in _quarter_turns())])


def register_along_ray(mesh: TriangleMesh, views: Views, pose: Sim3, eye: FloatArray) -> Registration:
    """The same for a shape in a camera's frame of unknown scale: ``pose`` puts it into the world up to a scale
    about the camera's centre ``eye`` (3,), which is searched over four decades.
    """
    scales = np.geomspace(0.01, 100.0, 81)
    about_eye = [Sim3(float(scale), np.eye(3), (1 - scale) * eye) for scale in scales]
    return _best(mesh, views, [scaled.compose(pose) for scaled in about_eye])


def _best(mesh: TriangleMesh, views: Views, starts: Sequence[Sim3]) -> Registration:
    """The best of the likeliest starts, refined; converges from displacements of about a quarter of the object."""
    shown, _ = mask_silhouettes(views)
    if len(mesh.faces) == 0:
        raise GeometryError("A mesh without faces has no silhouette to align.")
    scores = [mask_agreement(place_mesh(mesh, start), shown) for start in starts]
    first, *others = np.argsort(-np.array(scores), kind="stable")[:_TRIED_FURTHER]
    best = _refine(mesh, shown, starts[first])
    for i in others:
        if best.iou > _GOOD:
            break
        best = max(best, _refine(mesh, shown, starts[i]), key=lambda found: found.iou)
    return best


def _quarter_turns() -> list[FloatArray]:
    """The 24 rotations that take axes to axes."""
    every = product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    turns = [np.diag(signs) @ np.eye(3)[list(axes)] for axes, signs in every]
    return [turn for turn in turns if np.linalg.det(turn) > 0]


def _fitted(mesh: TriangleMesh, hull: Carving, turn: FloatArray) -> Sim3:
    """The turn, with scale and place such that the mesh's box has the hull's size and middle."""
    box = mesh.bounds @ turn.T
    low, high = box.min(axis=0), box.max(axis=0)
    target = hull.mesh.bounds
    sizes, wanted = np.maximum(high - low, 1e-9), target[1] - target[0]
    scale = float(np.exp(np.mean(np.log(wanted) - np.log(sizes))))
    return Sim3(scale, turn, target.mean(axis=0) - scale * 0.5 * (low + high))


def _refine(mesh: TriangleMesh, shown: Sequence[Silhouette], start: Sim3) -> Registration:
    """Levenberg-Marquardt with Huber weights; the best similarity seen on the way is kept."""
    best, best_iou, now, stale = start, -1.0, start, 0
    for _ in range(_ITERATIONS + 1):
        placed = place_mesh(mesh, now)
        depths = [depth_map(placed, s.camera) for s in shown]
        iou = float(np.mean([mask_iou(np.isfinite(d), s) for d, s in zip(depths, shown, strict=True)]))
        stale = 0 if iou > best_iou + 1e-5 else stale + 1
        if iou > best_iou:
            best, best_iou = now, iou
        if stale >= _PATIENCE:
            break
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
        step = -np.linalg.solve(normal, jacobian.T @ (weight * residual))
        if float(np.abs(step).max()) < 1e-5:
            break
        now = _step(now, np.clip(step, -0.3, 0.3), centre, size)  # in units of the object's size
    return Registration(best, best_iou)


def _step(now: Sim3, step: FloatArray, centre: FloatArray, size: float) -> Sim3:
    """Shift, turn and scale about the object's centre by the seven unknowns of a step."""
    rotation = Rotation.from_rotvec(step[3:6]).as_matrix()
    scale = float(np.exp(step[6]))
    moved = Sim3(scale, rotation, centre + size * step[:3] - scale * rotation @ centre)
    return moved.compose(now)


def _residuals(
    depth: NDArray[np.float32], s: Silhouette, centre: FloatArray, size: float
) -> tuple[FloatArray, FloatArray]:
    """Signed pixels (M,) from the rim of the drawn mesh to the mask's contour, and their derivatives (M, 7)."""
    covered = np.isfinite(depth)
    rim = covered & ~binary_erosion(covered, border_value=1)
    pixels = np.argwhere(rim & np.isfinite(s.distance))
    if len(pixels) == 0:
        return np.zeros(0), np.zeros((0, 7))
    pixels = pixels[:: max(1, len(pixels) // _RIM)]
    z = depth[pixels[:, 0], pixels[:, 1]].astype(np.float64)
    uv = pixels[:, ::-1].astype(np.float64) + 0.5
    rays = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(s.camera.K).T
    local = rays * z[:, None]
    points = local @ s.camera.world_from_camera[:3, :3].T + s.camera.position
    slope = _slopes(s, uv)
    fx, fy, skew = s.camera.K[0, 0], s.camera.K[1, 1], s.camera.K[0, 1]
    # d(u, v)/d(x, y, z) in the camera, contracted with the distance's slope.
    du, dv = slope[:, 0] / z, slope[:, 1] / z
    along_x, along_y = fx * du, skew * du + fy * dv
    along_z = -(along_x * local[:, 0] + along_y * local[:, 1]) / z
    world = np.stack([along_x, along_y, along_z], axis=1) @ s.camera.world_from_camera[:3, :3].T
    arm = points - centre
    jacobian = np.column_stack([size * world, np.cross(arm, world), np.einsum("ij,ij->i", world, arm)])
    # The rim pixel's centre lies half a pixel inside the drawn silhouette.
    return s.sample(uv) - 0.5, jacobian


def _slopes(s: Silhouette, uv: FloatArray) -> FloatArray:
    """(M, 2) derivative of the mask's signed distance at pixels (M, 2), central differences."""
    slopes = [0.5 * (s.sample(uv + step) - s.sample(uv - step)) for step in np.eye(2)]
    return np.clip(np.stack(slopes, axis=1), -1.5, 1.5)
