"""From five masked views to geometry, and back to its place after a drift: the reconstruction branch from Python.

python examples/04_refine_geometry.py
"""

from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from gvla2.evaluation.metrics import chamfer, surface_points
from gvla2.evaluation.protocol import protocol_cameras
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.views import View, Views
from gvla2.plugins.registry import load_plugins
from gvla2.reconstruction.branch import BranchComponents, refine_geometry

# A mallet, one unit long, seen by five cameras that look at it from all around.
head = trimesh.creation.cylinder(radius=0.17, height=0.62, sections=40)
handle = trimesh.creation.box((0.85, 0.1, 0.1), trimesh.transformations.translation_matrix([0.4, 0, 0]))
solid = trimesh.util.concatenate([head, handle])
solid.apply_translation(-solid.bounds.mean(axis=0))
colours = np.where(
    np.arange(len(solid.faces))[:, None] < len(head.faces), [0.75, 0.25, 0.2], [0.8, 0.65, 0.4]
)
cameras = protocol_cameras("mallet", size=160)[:5]
pictures = RayCaster([Surface(solid.vertices, solid.faces, colours, 0)]).cast(cameras, {})
views = Views(
    tuple(
        View(camera, picture.image, mask=(picture.ids == 0).astype(np.float32))
        for camera, picture in zip(cameras, pictures, strict=True)
    )
)

# Any mapping with a choice for each kind will do, as on the command line.
choices = {
    "reconstructor": "hull", "prior": "none", "axis": "contours", "fusion": "residual", "renderer": "numba",
}  # fmt: skip
parts = load_plugins().build_all({kind: {"name": name} for kind, name in choices.items()}, choices)

carved = parts["reconstructor"].reconstruct(views)
print(f"carved: {len(carved.gaussians)} Gaussians, {len(carved.mesh.faces)} triangles ({carved.status})")


def drifted(points: np.ndarray) -> np.ndarray:
    """Too long, too flat and a little beside its place, as learned reconstructors are."""
    return points * [1.05, 0.95, 1.04] + [0.02, -0.01, 0.015]


g0 = replace(
    carved,
    gaussians=carved.gaussians.with_centres(drifted(carved.gaussians.centres)),
    mesh=carved.mesh.with_vertices(drifted(carved.mesh.vertices)),
)
chosen = BranchComponents(*(parts[kind] for kind in ("prior", "axis", "fusion", "renderer")))
refined = refine_geometry(g0, views, chosen)
for stage in refined.stages:
    print(f"  {stage.stage:<11} {stage.status:<9} {stage.reason}")

surface, _ = TriangleMesh(solid.vertices, solid.faces).sample(20_000, np.random.default_rng(0))
truth = cKDTree(surface)
for name, made in (("carved", carved), ("drifted", refined.g0), ("refined", refined.out)):
    points, _ = surface_points(made.mesh, None, samples=20_000)
    print(f"{name:<8} Chamfer distance {chamfer(points, truth):6.2f} thousandths of its length")
