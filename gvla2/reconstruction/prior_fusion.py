"""Source A's first stage: what a geometry prior says, made into the object's surface where it can be believed."""

from __future__ import annotations

from dataclasses import replace

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray
from gvla2.reconstruction.carving import normals_of, surface_of, without_crumbs
from gvla2.reconstruction.colouring import vertex_colours
from gvla2.reconstruction.contracts import GeometryEstimate, GeometryPrior, Reconstruction, StageReport
from gvla2.reconstruction.evidence import DepthEvidence, gather
from gvla2.reconstruction.placing import place
from gvla2.reconstruction.view_set import ViewSet
from gvla2.reconstruction.volume import Posterior, fuse_volume
from gvla2.reconstruction.zbuffer import depth_maps

NO_PRIOR = "There is no geometry prior."
"""What is said where none was chosen, or the chosen one has nothing to say of any view."""
THIN = 0.75
"""Points that masks need, a pixel of their outlines, from which on the object has walls thinner than a voxel."""
MENDED = 0.5
"""Share of these points that may be left by a correction that heeds them."""


def agreed(
    estimate: GeometryEstimate, seen: ViewSet, g0: TriangleMesh | None
) -> tuple[DepthEvidence, Posterior]:
    """What a prior's depth and the views agree on.

    Depth that is wrong where no other depth looks still cuts away what other views' masks show. Those points go back
    into the correction of depth, as what it must not look through; what comes of that is kept where it leaves few of
    them. Depth that errs cuts along the outlines; walls thinner than a voxel are cut everywhere, however right it is.
    """

    def fused(needed: FloatArray | None) -> tuple[DepthEvidence, Posterior]:
        evidence = gather(estimate, seen, needed)
        return evidence, fuse_volume(seen, evidence, g0)

    first = fused(None)
    needed = first[1].needed
    rim = sum(int(((s.distance > 0) & (s.distance <= 1)).sum()) for s in seen.silhouettes)
    if not 0 < len(needed) < THIN * rim:
        return first
    second = fused(needed)
    return second if len(second[1].needed) < MENDED * len(needed) else first


def fuse_prior(
    thing: Reconstruction, seen: ViewSet, prior: GeometryPrior
) -> tuple[Reconstruction, StageReport]:
    """``thing`` with the surface that masks, depth and itself agree on, and its Gaussians on that surface.

    Depth is corrected view by view (:mod:`~gvla2.reconstruction.depth_alignment`), fused with masks and G0 in one
    volume (:mod:`~gvla2.reconstruction.volume`), the surface coloured from the views, and the Gaussians placed on it
    with their attributes. Skipped without a prior; an unusable one is a ``rejected`` stage with its reason.
    """
    estimate = prior.predict(seen.views)
    if estimate is None:
        return thing, StageReport("prior", "skipped", NO_PRIOR)
    try:
        evidence, posterior = agreed(estimate, seen, thing.mesh)
        if not (posterior.field.values > 0).any():
            raise GeometryError("The prior leaves nothing of the object.")
    except GeometryError as error:
        return thing, StageReport("prior", "rejected", f"{error} G0 stays.")
    # Depth maps that err leave specks between them.
    field = without_crumbs(posterior.field, seen.silhouettes)
    mesh, step = surface_of(field), 2 * field.step
    normals = normals_of(field, mesh.vertices)
    depths = depth_maps(mesh, [s.camera for s in seen.silhouettes])
    colours, _ = vertex_colours(mesh, normals, seen.silhouettes, depths, step)
    mesh = replace(mesh, colours=colours)
    gaussians = thing.gaussians
    if gaussians is not None and len(gaussians):
        gaussians = place(gaussians, thing.mesh, mesh, normals, seen.silhouettes, depths, step)
    told = float((posterior.confidence > 0).mean())
    report = StageReport("prior", "applied", evidence.told, {}, {"voxels_told": told})
    return replace(thing, gaussians=gaussians, mesh=mesh), report
