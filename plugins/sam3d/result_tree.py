"""Results of MV-SAM3D, SAM3D and related programs: finding, reading, and moving them to the calibrated frame."""

from __future__ import annotations

import io
import os
import zipfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gvla2.errors import ConfigurationError, GeometryError
from gvla2.geometry.gaussians import Gaussians, read_gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import read_mesh
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.sim3 import Sim3
from gvla2.reconstruction.surfels import surfels
from gvla2_plugins.sam3d.registration import (
    place,
    register_along_ray,
    register_unposed,
)

if TYPE_CHECKING:
    from gvla2_plugins.sam3d import ResultTreeConfig


def result_folder(root: str | os.PathLike[str], name: str, views: int = 5) -> Path:
    """``<root>/<name>/<views>views``; raises :class:`GeometryError` that lists the folders there are."""
    folder = Path(root) / name / f"{views}views"
    if not folder.is_dir():
        present = sorted(str(p.parent.relative_to(root)) for p in Path(root).glob("*/*views/result.*"))
        raise GeometryError(f"There is no folder {folder}. Results there: {', '.join(present) or 'none'}.")
    return folder


_POOR = 0.6
"""Mean IoU with the masks below which an alignment is called poor."""
_CAMERA_FROM_P3D = np.diag([-1.0, -1.0, 1.0])  # PyTorch3D's cameras look along z too, with x left and y up
_MOST_FACES = 60_000  # a finer mesh is drawn coarser while it is aligned
_CELLS = 120  # along the longest side of a mesh that is drawn coarser
_MOST_GAUSSIANS = 8_000


@dataclass(frozen=True)
class ResultFiles:
    """A result in its own canonical frame, Z-up.

    ``pose`` takes it into the frame of the first camera (OpenCV), up to the scale of the depth that it was made with;
    None if the result does not say. ``note`` says what was missing; ``glb`` is the mesh's file.
    """

    gaussians: Gaussians | None
    mesh: TriangleMesh | None
    pose: Sim3 | None
    note: str = ""
    glb: Path | None = None


def read_result(folder: str | os.PathLike[str], stem: str = "result") -> ResultFiles:
    """Read ``<stem>.ply`` (Gaussians), ``<stem>.glb`` (mesh) and ``params.npz`` (pose) of a folder.

    One of the first two suffices. Raises :class:`GeometryError`, naming the file, when both are absent or one is
    broken.
    """
    place_ = Path(folder)
    ply, glb = place_ / f"{stem}.ply", place_ / f"{stem}.glb"
    if not ply.is_file() and not glb.is_file():
        present = ", ".join(sorted(p.name for p in place_.iterdir())[:8]) if place_.is_dir() else ""
        raise GeometryError(
            f"{place_} has neither {ply.name} nor {glb.name}. It holds: {present or 'nothing'}."
        )
    mesh = read_mesh(glb) if glb.is_file() else None
    gaussians = read_gaussians(ply) if ply.is_file() else None
    absent = glb if mesh is None else ply if gaussians is None else None
    note = "" if absent is None else f"{absent.name} is missing"
    return ResultFiles(
        gaussians, mesh, _read_pose(place_ / "params.npz"), note, None if mesh is None else glb
    )


def align_result(result: ResultFiles, views: Views, count: int) -> Reconstruction:
    """The result in the views' calibrated frame, aligned with the masks by a similarity.

    Starts from the result's own pose when it has one (its scale is searched), else from the 24 quarter turns. A result
    without Gaussians gets ``count`` flat ones on its mesh. The status says how well the silhouettes fit if they fit
    poorly.
    """
    mesh = _silhouette_mesh(result)
    if result.pose is not None:
        camera = views[0].camera
        world_from_camera = Sim3(1.0, camera.world_from_camera[:3, :3], camera.position)
        found = register_along_ray(mesh, views, world_from_camera.compose(result.pose), camera.position)
    else:
        found = register_unposed(mesh, views)
    gaussians = result.gaussians
    if gaussians is None and result.mesh is not None:
        gaussians = surfels(result.mesh, None, count)
    notes = [result.note + (", flat Gaussians lie on the mesh" if result.gaussians is None else "")]
    if found.iou < _POOR:
        notes.append(f"the silhouettes fit poorly, mean IoU {found.iou:.2f}")
    notes = [text for text in notes if text]
    status = f"fallback: {'; '.join(notes)}" if notes else "ok"
    return replace(place(Reconstruction(gaussians, result.mesh, glb=result.glb), found.sim3), status=status)


def _silhouette_mesh(result: ResultFiles) -> TriangleMesh:
    """Triangles that cast the result's silhouettes: some of its mesh's, or one on each Gaussian."""
    if result.mesh is not None:
        if len(result.mesh.faces) <= _MOST_FACES:
            return result.mesh
        longest = float(np.ptp(result.mesh.bounds, axis=0).max())
        return result.mesh.clustered(max(longest, 1e-12) / _CELLS)[0]
    assert result.gaussians is not None
    g = result.gaussians
    solid = np.flatnonzero(g.opacities > 0.3)
    if len(solid) == 0:
        raise GeometryError("No Gaussian of the result is more than 30 % opaque: it has no silhouette.")
    chosen = solid[:: max(1, len(solid) // _MOST_GAUSSIANS)]
    # A tetrahedron a Gaussian, as wide as it and wide enough to close the gaps to its neighbours.
    spread = np.sqrt(np.maximum((g.scales[chosen].astype(np.float64) ** 2).mean(axis=1), 1e-12))
    reach = np.maximum(1.5 * spread, _spacing(g.centres[chosen].astype(np.float64))).reshape(-1, 1, 1)
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
    vertices = (g.centres[chosen].astype(np.float64)[:, None] + reach * corners).reshape(-1, 3)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    return TriangleMesh(vertices, (faces + 4 * np.arange(len(chosen))[:, None, None]).reshape(-1, 3))


def _spacing(points: FloatArray) -> float:
    if len(points) < 2:
        return 0.0
    gaps = np.asarray(cKDTree(points).query(points, k=2)[0])
    return float(np.median(gaps[:, 1]))


def _read_pose(path: Path) -> Sim3 | None:
    """The pose of ``params.npz``: scale, rotation (wxyz) and translation in PyTorch3D's row convention."""
    if not path.is_file():
        return None
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as arrays:
            if not {"scale", "rotation", "translation"} <= set(arrays.files):
                return None
            scale = float(np.asarray(arrays["scale"], dtype=np.float64).mean())
            w, x, y, z = np.asarray(arrays["rotation"], dtype=np.float64).ravel()
            translation = np.asarray(arrays["translation"], dtype=np.float64).reshape(3)
        # Rows are multiplied from the right there: p (s R) + t, so that R turns the other way round.
        rotation = Rotation.from_quat([x, y, z, w]).as_matrix().T
        return Sim3(scale, _CAMERA_FROM_P3D @ rotation, _CAMERA_FROM_P3D @ translation)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, GeometryError) as error:
        raise GeometryError(f"Cannot read the pose {path}: {error}") from error


class ResultTreeReconstructor:
    """Reads the tree again for each call, so that it may be filled while a sweep runs.

    Raises :class:`ConfigurationError` when root or object is not given.
    """

    def __init__(self, config: ResultTreeConfig) -> None:
        for option in ("root", "object"):
            if not getattr(config, option):
                raise ConfigurationError(
                    f"reconstructor.{option} is empty: result_tree reads <root>/<object>/{config.views}views; "
                    "give both reconstructor.root=PATH and reconstructor.object=NAME."
                )
        self._config = config

    def reconstruct(self, views: Views) -> Reconstruction:
        """The result in the views' frame; a :class:`gvla2.errors.GeometryError` names the missing or broken part."""
        c = self._config
        result = read_result(result_folder(c.root, c.object, c.views))
        return align_result(result, views, c.gaussians)
