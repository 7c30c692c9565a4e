"""The clicked target in the scene: the object that the mask shows, or one that geometry alone did not separate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from gvla2.language.contracts import LanguageModel
from gvla2.perception.clicks import Located, locate
from gvla2.perception.frames import BoolArray, TablePlane, ViewFrame
from gvla2.perception.fusing import TOUCHING, Fused, MaskCandidate, objects_of
from gvla2.perception.options import VisionOptions
from gvla2.perception.prompting import Segmenter
from gvla2.planning.scene import Scene, SceneObject

SAME = 0.6
"""Share of an object's points and of the mask's above which the mask shows the object."""


def localized(
    scene: Scene,
    frames: Sequence[ViewFrame],
    segmenter: Segmenter,
    table: TablePlane,
    instruction: str,
    model: LanguageModel,
    options: VisionOptions,
) -> Scene:
    """The scene with a note on the instruction's target, from clicks in the picture that shows the most."""
    if not scene.objects or not instruction.strip():
        return scene
    shown = [[_shown(frame, thing) for thing in scene.objects] for frame in frames]
    view = int(np.argmax([sum(int(mask.sum()) for mask in masks) for masks in shown]))
    found = locate(
        model, frames[view].view.image, segmenter.encode(frames[view].view.image), shown[view], instruction,
        scale=options.scale, longest=options.longest,
    )  # fmt: skip
    if found.mask is None:
        return replace(scene, notes=(*scene.notes, f"Nothing was localized: {_story(found)}."))
    return _merged(scene, frames, table, found, view)


def _merged(scene: Scene, frames: Sequence[ViewFrame], table: TablePlane, found: Located, view: int) -> Scene:
    assert found.mask is not None
    own = found.mask & frames[view].known
    cloud = frames[view].points[own & (frames[view].height > 0)]
    best, worth, of_mask = None, 0.0, 0.0
    for thing in scene.objects:
        if not len(cloud) or not len(thing.points):
            continue
        share = float(
            np.isfinite(cKDTree(thing.points).query(cloud, distance_upper_bound=TOUCHING)[0]).mean()
        )
        in_sight = thing.points[_in_sight(frames[view], thing.points)]
        back = (
            float(np.isfinite(cKDTree(cloud).query(in_sight, distance_upper_bound=TOUCHING)[0]).mean())
            if len(in_sight)
            else 0.0
        )
        if share * back > worth:
            best, worth, of_mask = thing, share * back, min(share, back)
    if best is not None and of_mask >= SAME:
        return replace(scene, notes=(*scene.notes, f"{best.id} is the target: {_story(found)}."))
    made, _ = objects_of([Fused((MaskCandidate(view, found.mask, found.score),))], frames, table, 3)
    if not made:
        return replace(scene, notes=(*scene.notes, f"The localized target has no depth: {_story(found)}."))
    new = f"o{len(scene.objects) + 1}"
    parent = best.id if best is not None and worth > 0.1 else ""
    note = f"{new} is the target, a part that geometry did not separate: {_story(found)}."
    thing = replace(made[0], id=new, parent=parent)
    return replace(scene, objects=(*scene.objects, thing), notes=(*scene.notes, note))


def _story(found: Located) -> str:
    refused = sum(bool(click.refused) for click in found.clicks)
    return f"{len(found.clicks)} clicks, {refused} refused, {found.stopped}"


def _shown(frame: ViewFrame, thing: SceneObject) -> BoolArray:
    """(H, W) the pixels of an object's points in a picture."""
    mask = np.zeros(frame.height.shape, dtype=bool)
    camera = frame.view.camera
    uv, _ = camera.project(thing.points[_in_sight(frame, thing.points)])
    columns, rows = np.floor(uv).astype(int).T
    mask[rows, columns] = True
    return mask


def _in_sight(frame: ViewFrame, points: np.ndarray) -> BoolArray:
    uv, z = frame.view.camera.project(points)
    inside = frame.view.camera.inside(uv)
    near = np.zeros(len(points), dtype=bool)
    columns, rows = np.floor(uv[inside]).astype(int).T
    assert frame.view.depth is not None
    with np.errstate(invalid="ignore"):
        near[inside] = np.abs(frame.view.depth[rows, columns] - z[inside]) < 1.5 * TOUCHING
    return near
