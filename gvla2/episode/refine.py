"""Refine the perceived objects' geometry by the reconstruction branch, before planning."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np

from gvla2.errors import GeometryError
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
)
from gvla2.reconstruction.options import BranchOptions

MIN_MASK_PIXELS = 30
DEPTH_BAND = 0.015
"""A pixel belongs to an object when its depth lies within this of the object's box, metres."""

ABOVE_SUPPORT = 0.003
"""Points less than this above the object's underside belong to the table, metres."""


@dataclass(frozen=True)
class GeometryComponents:
    """The components that refine an object's geometry, and the branch's options."""

    reconstructor: Reconstructor
    prior: GeometryPrior
    axis: AxisCompensation
    fusion: FusionStrategy
    renderer: Renderer
    options: BranchOptions = field(default_factory=BranchOptions)


def refine_scene(
    scene: Scene, observation: Observation, instruction: str, components: GeometryComponents
) -> tuple[Scene, str]:
    """The scene with the boxes of the objects of interest fitted to their refined geometry, and what was done.

    Each object's silhouette in a view is the set of pixels whose measured point lies in its box. An object
    that no view shows, or that the reconstructor leaves alone or fails on, stays as perceived.
    """
    changes: list[str] = []
    for obj in objects_of_interest(scene, instruction):
        views = masked_views(observation, obj)
        if views is None:
            continue
        try:
            fitted = _refined(obj, views, components)
        except GeometryError as error:
            changes.append(f"{obj.label}: left as perceived ({error})")
            continue
        if fitted is not None:
            scene = scene.with_object(fitted)
            change = 1e3 * (fitted.extents - obj.extents)
            changes.append(f"{obj.label}: extents changed by {', '.join(f'{c:+.1f}' for c in change)} mm")
    if not changes:
        return scene, "No geometry was refined: objects are as perceived."
    return scene, f"{'; '.join(changes)}."


def objects_of_interest(scene: Scene, instruction: str) -> tuple[SceneObject, ...]:
    """The solid objects whose colour or noun the instruction names; all of them when it names none."""
    words = set(re.findall(r"\w+", instruction.lower()))
    objects = scene.obstacles()
    coloured = tuple(obj for obj in objects if obj.colour in words)
    named = tuple(obj for obj in objects if words & set(obj.label.lower().split()))
    return coloured or named or objects


def _refined(obj: SceneObject, views: Views, components: GeometryComponents) -> SceneObject | None:
    """The object with its box fitted to the branch's output; None when there is nothing to refine."""
    g0 = components.reconstructor.reconstruct(views)
    if g0 is None:
        return None
    # Compiled code is imported only when something is reconstructed.
    from gvla2.reconstruction.branch import BranchComponents, refine_geometry

    chosen = BranchComponents(components.prior, components.axis, components.fusion, components.renderer)
    return fit_box(obj, refine_geometry(g0, views, chosen, components.options).out)


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
    """The object with its box fitted to the reconstruction along its own axes; None when that has no points."""
    points = _points(reconstruction)
    if points is None:
        return None
    # No view sees an underside: a hull goes on below it, the object does not.
    points = points[points[:, 2] >= obj.bottom]
    if not len(points):
        return None
    local = transform_points(invert_rigid(obj.world_from_object), points)
    # Stray points of a reconstruction must not widen a grasp: the outermost half per cent a side is left out.
    low, high = np.percentile(local, [0.5, 99.5], axis=0)
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
