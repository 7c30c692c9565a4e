"""Moving a whole reconstruction by a similarity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gvla2.geometry.gaussians import Gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.sim3 import Sim3
from gvla2_plugins.sam3d.harmonics import turned_harmonics


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
