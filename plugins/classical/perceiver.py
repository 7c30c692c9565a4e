"""Plane, clusters, solids, words: the perceiver ``classical``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.geometry.views import Observation, Views
from gvla2.perception.clusters import without_specks
from gvla2.perception.frames import check_workspace
from gvla2.perception.labels import labelled
from gvla2.perception.objects import new_ids, numbered, over_workspace
from gvla2.perception.options import labellers
from gvla2.perception.registration import agreed, find_table
from gvla2.planning.scene import Box, Scene, SceneObject
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.assembly import assemble, join_overlapping
from gvla2_plugins.classical.composites import (
    join_bottles,
    join_fronts,
    join_lids,
    join_stems,
    name_knives,
    put_together,
)
from gvla2_plugins.classical.footprints import find_patches, unlike_table
from gvla2_plugins.classical.known import known_objects
from gvla2_plugins.classical.naming import described
from gvla2_plugins.classical.pixels import Pixels, TableFrame, choose, usable_frames
from gvla2_plugins.classical.segmentation import (
    bodies_of,
    grow_down,
    join_across_views,
    join_in_bodies,
    pieces_in_views,
    settle_layers,
    textured,
)
from gvla2_plugins.classical.solids import SeenObject

BORDER = 0.06  # metres around the workspace that are looked at too: what stands on its edge is seen whole
WHOLES = (join_lids, join_fronts, join_stems, name_knives, join_bottles)
"""What is looked for, in this order: a side of a case is not to be taken for a bottle."""


class ClassicalPerceiver:
    """Objects on a table from RGB-D views, by geometry and colour; the instruction is not used.

    All views are used together: a pixel graph in each image, pieces joined across views, a solid (box, cylinder,
    sphere) fitted to the seen points and to the rays that pass beside it.
    """

    def __init__(self, config: ClassicalConfig) -> None:
        lengths = ("min_height", "jump", "colour_step", "gap", "min_region")
        wrong = [name for name in lengths if not getattr(config, name) > 0]
        if wrong or config.min_points < 4:
            raise PerceptionError(
                f"perceiver=classical: {', '.join(wrong) or 'min_points'} is out of range; lengths must be positive, "
                "min_points at least 4."
            )
        self._config = config
        self._labellers = labellers(config)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``, objects ordered by x, then y.

        Raises :class:`PerceptionError` when no camera delivers depth, or no plane is found that is level to 15 degrees.
        """
        del instruction  # what was asked must not change what is seen
        check_workspace(workspace)
        views = agreed(observation.views, workspace)
        err = views is not observation.views
        frames, notes = usable_frames(views, least=3 if err else 2)
        if err:
            notes.append("The cameras' poses disagreed and were corrected.")
        table = find_table([frame.points[np.isfinite(frame.depth)] for frame in frames], workspace)
        table_from_world = table.frame(workspace)
        frames = [frame.moved(table_from_world) for frame in frames]
        hand = transform_points(table_from_world, observation.world_from_tcp[:3, 3])
        height = table.height_over(workspace)
        # The table's frame has its origin under the middle of the workspace.
        half = 0.5 * (workspace.high - workspace.low)[:2]
        room = np.array([*half + BORDER, workspace.high[2] - height])
        known, pixels, objects, painted, patches = self._find(frames, views, height, table.noise, room, hand)
        named = described(pixels, objects, "object") + described(painted, patches, "patch")
        back = invert_rigid(table_from_world)
        world = [
            replace(o, world_from_object=back @ o.world_from_object, points=transform_points(back, o.points))
            for o in named
        ]
        world += known
        inside = over_workspace(world, workspace)
        if lost := len(world) - len(inside):
            notes.append(f"{lost} object(s) beside the workspace were left out.")
        notes += _carried_notes(objects, new_ids(inside))
        scene = Scene(numbered(inside), height, workspace, "classical", tuple(notes))
        return labelled(scene, observation, self._labellers)

    def _find(
        self,
        frames: Sequence[TableFrame],
        views: Views,
        height: float,
        noise: float,
        room: FloatArray,
        hand: FloatArray,
    ) -> tuple[list[SceneObject], Pixels, list[SeenObject], Pixels, list[SeenObject]]:
        config = self._config
        rise = max(config.min_height, 3.3 * noise)
        with np.errstate(invalid="ignore"):
            near = [np.abs(frame.points) < room for frame in frames]
            above = [frame.points[..., 2] > rise for frame in frames]
        inside = [one[..., 0] & one[..., 1] & one[..., 2] for one in near]
        raised = [without_specks(near & high) for near, high in zip(inside, above, strict=True)]
        flat = [
            near & ~high & (frame.points[..., 2] >= -rise)
            for frame, near, high in zip(frames, inside, above, strict=True)
        ]
        different = [unlike_table(frame, mask) for frame, mask in zip(frames, flat, strict=True)]
        reach = 0.004 + 1.5 * noise
        raised, different = settle_layers(frames, raised, different, rise, reach, config)
        flat = [mask | other for mask, other in zip(flat, different, strict=True)]
        raised = grow_down(frames, raised, flat, different, config.colour_step)
        connected = config.jump, reach, config.min_points
        known, left = known_objects(self._labellers, frames, raised, views, height, *connected)
        pixels = choose(frames, left)
        objects: list[SeenObject] = []
        if len(pixels):
            pieces = pieces_in_views(pixels, config.jump, config.colour_step)
            labels = join_across_views(pixels, pieces, reach=reach)
            bodies = bodies_of(frames, pixels, *connected)
            labels = join_in_bodies(pixels, labels, bodies)
            grain = max(map(_grain, frames, flat))
            rough = np.append(textured(pixels, bodies, config.jump, grain, config.textured), False)[bodies]
            labels[rough] = -1
            fine = np.where(rough, bodies, -1)
            objects = assemble(
                frames, pixels, labels, fine, config.min_points, config.gap, config.fragment_reach, hand
            )
            overlapping = partial(
                join_overlapping, frames=frames, pixels=pixels, bodies=bodies, gap=config.gap
            )
            objects = put_together(pixels, objects, (*WHOLES, overlapping))
        paint = [mask & other & ~up for mask, other, up in zip(flat, different, raised, strict=True)]
        bare = [mask & ~other & ~up for mask, other, up in zip(flat, different, raised, strict=True)]
        painted, patches = find_patches(
            frames, paint, bare, config.min_region, config.min_points, config.colour_step
        )
        # What is seen flat on the table inside a hollow object is its floor.
        patches = [
            p for p in patches if not any(t.hollow and t.covers(p.centre[None, :2])[0] for t in objects)
        ]
        return known, pixels, objects, painted, patches


def _grain(frame: TableFrame, flat: NDArray[np.bool_]) -> float:
    """What most neighbouring pixels of the table differ by at most, in colour from 0 to 1: the picture's noise."""
    image, flat = frame.image[::4].astype(np.float64), flat[::4]
    both = flat[:, :-1] & flat[:, 1:]
    step = np.linalg.norm(image[:, :-1][both] - image[:, 1:][both], axis=1)
    return float(np.percentile(np.append(step, 0.0), 75.0)) / 255.0


def _carried_notes(objects: Sequence[SeenObject], ids: dict[str, str]) -> list[str]:
    """What stands on what, and what hangs in the air."""
    notes = []
    for k, obj in enumerate(objects):
        own, carrier = ids.get(f"object{k}"), ids.get(f"object{obj.on}")
        if own and carrier and obj.floating and objects[obj.on].top < obj.bottom - 0.01:
            notes.append(f"{own} is above {carrier}, on something that is not seen.")
        elif own and carrier:
            notes.append(f"{own} stands on {carrier}.")
        elif own and obj.floating:
            notes.append(f"{own} does not stand on anything that is seen.")
        if own and obj.guessed:
            notes.append(f"How deep {own} is was not seen; it is taken to be as deep as wide.")
    return sorted(notes)
