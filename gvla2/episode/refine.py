"""Refine the perceived objects' geometry by the reconstruction branch, before planning."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from gvla2.errors import GeometryError
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.transform import FloatArray, invert_rigid, rigid, transform_points
from gvla2.geometry.views import Observation, View, Views
from gvla2.planning.scene import Scene, SceneObject
from gvla2.reconstruction.contracts import (
    AxisCompensation,
    FusionStrategy,
    GeometryPrior,
    Reconstruction,
    Reconstructor,
    Renderer,
    StageReport,
)
from gvla2.reconstruction.options import BranchOptions

MIN_MASK_PIXELS = 30
DEPTH_BAND = 0.015
"""A pixel belongs to an object when its depth lies within this of the object's box, metres."""

ABOVE_SUPPORT = 0.003
"""Points less than this above the object's underside belong to the table, metres."""

LEAST_GAIN = 0.01
"""How much better a refined box must agree with the masks, in IoU, than the perceived one: less is a pixel's worth."""

LEAST_AGREEMENT = 0.8
"""Masks that a refined box explains worse speak of cameras or masks that err, not for the box."""

SAME = 0.05
"""A perceived object is the true one whose centre is this near, metres."""


@dataclass(frozen=True)
class GeometryComponents:
    """The components that refine an object's geometry, and the branch's options."""

    reconstructor: Reconstructor
    prior: GeometryPrior
    axis: AxisCompensation
    fusion: FusionStrategy
    renderer: Renderer
    options: BranchOptions = field(default_factory=BranchOptions)


@dataclass(frozen=True)
class Refinement:
    """One object's box as perceived, ``before``, and as the reconstruction has it, ``after``, None if it made none.

    ``used``: the planner gets ``after``; ``reason`` says why, or why not. ``stages`` are the branch's reports. ``true``
    is the object in a simulator's true scene, for reports only.
    """

    before: SceneObject
    after: SceneObject | None
    used: bool
    reason: str
    stages: tuple[StageReport, ...] = ()
    true: SceneObject | None = None

    @property
    def chosen(self) -> SceneObject:
        """The object that the planner gets."""
        return self.after if self.used and self.after is not None else self.before

    @property
    def width_error(self) -> float | None:
        """How far the planner's narrower level side is from the true one, metres; None without a true object."""
        if self.true is None:
            return None
        return abs(float(self.chosen.extents[:2].min() - self.true.extents[:2].min()))

    def to_json(self) -> dict[str, Any]:
        """Its entry in ``result.json``: sizes in metres, the branch's stages by name."""
        sizes = {"before": self.before, "after": self.after, "true": self.true}
        return {
            "object": self.before.id,
            "label": self.before.label,
            "used": self.used,
            "reason": self.reason,
            **{name: obj and obj.extents.tolist() for name, obj in sizes.items()},
            "stages": {stage.stage: f"{stage.status}: {stage.reason}" for stage in self.stages},
        }


def refine_scene(
    scene: Scene, observation: Observation, instruction: str, components: GeometryComponents
) -> tuple[Scene, tuple[Refinement, ...]]:
    """The scene with those boxes of the objects of interest refined that the views speak for, and what was done.

    Each object's silhouette in a view is the set of pixels whose measured point lies in its box. An object
    that no view shows, or that the reconstructor leaves alone or fails on, stays as perceived.
    """
    done: list[Refinement] = []
    for obj in objects_of_interest(scene, instruction):
        views = masked_views(observation, obj)
        if views is None:
            continue
        try:
            refinement = _refined(obj, views, components)
        except GeometryError as error:
            refinement = Refinement(obj, None, False, str(error))
        done.append(refinement)
        scene = scene.with_object(refinement.chosen)
    return scene, tuple(done)


def with_truth(refinements: Sequence[Refinement], truth: Scene) -> tuple[Refinement, ...]:
    """The refinements with the true objects nearest to their boxes, for reports: no component sees them."""

    def nearest(obj: SceneObject) -> SceneObject | None:
        found = min(
            truth.obstacles(), key=lambda o: float(np.linalg.norm(o.centre - obj.centre)), default=None
        )
        near = found is not None and np.linalg.norm(found.centre - obj.centre) < SAME
        return found if near else None

    return tuple(replace(one, true=nearest(one.before)) for one in refinements)


def objects_of_interest(scene: Scene, instruction: str) -> tuple[SceneObject, ...]:
    """The solid objects whose colour or noun the instruction names; all of them when it names none."""
    words = set(re.findall(r"\w+", instruction.lower()))
    objects = scene.obstacles()
    coloured = tuple(obj for obj in objects if obj.colour in words)
    named = tuple(obj for obj in objects if words & set(obj.label.lower().split()))
    return coloured or named or objects


def _refined(obj: SceneObject, views: Views, components: GeometryComponents) -> Refinement:
    """The object's box fitted to the branch's output, used if the views speak for it."""
    views = Views(tuple(map(_knowing, views)))
    g0 = components.reconstructor.reconstruct(views)
    if g0 is None:
        return Refinement(obj, None, False, "the reconstructor leaves it alone")
    if g0.mesh is not None:  # boxes are fitted to it: colours and footprints would not reach the planner
        g0 = replace(g0, gaussians=None)
    # Compiled code is imported only when something is reconstructed.
    from gvla2.reconstruction.branch import BranchComponents, refine_geometry
    from gvla2.reconstruction.silhouette import mask_agreement, mask_silhouettes

    chosen = BranchComponents(components.prior, components.axis, components.fusion, components.renderer)
    result = refine_geometry(g0, views, chosen, components.options)
    after = fit_box(obj, result.out)
    if after is None:
        return Refinement(obj, None, False, "nothing lies between its top and its underside", result.stages)
    silhouettes, _ = mask_silhouettes(views)
    was, now = (mask_agreement(_solid(one), silhouettes) for one in (obj, after))
    used = now > max(was + LEAST_GAIN, LEAST_AGREEMENT)
    return Refinement(obj, after, used, f"agreement with the masks {was:.3f} and {now:.3f}", result.stages)


def _knowing(view: View) -> View:
    """The view with the pixels without a measurement marked as the robot's are: they say nothing about the object."""
    if view.depth is None or view.mask is None:
        return view
    lost = ~(np.isfinite(view.depth) & (view.depth > 0)) & (view.mask < 0.5)
    return replace(view, robot_mask=lost if view.robot_mask is None else lost | view.robot_mask)


def _solid(obj: SceneObject) -> TriangleMesh:
    """The object's box, or the cylinder or ellipsoid in it, in the world."""
    local = transform_points(invert_rigid(obj.world_from_object), obj.outline()) / (0.5 * obj.extents)
    if obj.shape == "sphere":
        local[:, :2] *= np.sqrt(np.maximum(1.0 - local[:, 2:] ** 2, 0.0))
    hull = ConvexHull(local)
    points = transform_points(obj.world_from_object, 0.5 * obj.extents * local)
    return TriangleMesh(points, np.asarray(hull.simplices, dtype=np.int64))


def masked_views(observation: Observation, obj: SceneObject) -> Views | None:
    """The views that show the object, its silhouette as their mask; None when none does."""
    object_from_world = invert_rigid(obj.world_from_object)
    half = 0.5 * obj.extents + DEPTH_BAND
    shown: list[View] = []
    for view in observation.views:
        if view.depth is None:
            continue
        points = view.points()  # (H, W, 3)
        local = transform_points(object_from_world, points)
        with np.errstate(invalid="ignore"):
            inside = (np.abs(local) <= half).all(axis=-1) & (points[..., 2] > obj.bottom + ABOVE_SUPPORT)
        if view.robot_mask is not None:
            inside &= ~view.robot_mask
        if np.count_nonzero(inside) >= MIN_MASK_PIXELS:
            shown.append(replace(view, mask=inside.astype(np.float32)))
    return Views(tuple(shown)) if shown else None


def fit_box(obj: SceneObject, reconstruction: Reconstruction) -> SceneObject | None:
    """The object with the level sides of its box fitted to the reconstruction between its underside and its top, along
    its own axes; None when that has no points there.
    """
    points = _points(reconstruction)
    if points is None:
        return None
    # Cameras look down: a hull ends in a cone below the underside, which none sees, and in another above the top, which
    # depth measures.
    points = points[(points[:, 2] >= obj.bottom) & (points[:, 2] <= obj.top)]
    if not len(points):
        return None
    local = transform_points(invert_rigid(obj.world_from_object), points)
    # Stray points of a reconstruction must not widen a grasp: the outermost half per cent a side is left out.
    low, high = np.percentile(local, [0.5, 99.5], axis=0)
    low[2], high[2] = -0.5 * obj.extents[2], 0.5 * obj.extents[2]
    if not np.isfinite([low, high]).all() or (high - low).min() <= 0:
        return None
    centre = obj.world_from_object @ rigid(translation=0.5 * (low + high))
    return replace(obj, world_from_object=centre, extents=high - low)


def _points(reconstruction: Reconstruction) -> FloatArray | None:
    if reconstruction.mesh is not None and len(reconstruction.mesh.vertices):
        return np.asarray(reconstruction.mesh.vertices, dtype=np.float64)
    if reconstruction.gaussians is not None and len(reconstruction.gaussians.centres):
        return np.asarray(reconstruction.gaussians.centres, dtype=np.float64)
    return None
