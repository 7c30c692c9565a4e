"""Plane, clusters, solids, words: the perceiver ``classical``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_opening, find_objects, label

from gvla2.errors import PerceptionError
from gvla2.geometry.transform import FloatArray, invert_rigid, transform_points
from gvla2.geometry.views import Observation
from gvla2.perception.clusters import without_specks
from gvla2.perception.frames import find_table
from gvla2.perception.labels import labelled
from gvla2.perception.objects import new_ids, numbered, over_workspace
from gvla2.perception.options import labellers
from gvla2.perception.registration import agreed
from gvla2.planning.scene import Box, Scene
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
from gvla2_plugins.classical.naming import described
from gvla2_plugins.classical.pixels import Pixels, TableFrame, choose, plane_crossings, usable_frames
from gvla2_plugins.classical.segmentation import (
    LAYER,
    bodies_of,
    grow_down,
    join_across_views,
    join_in_bodies,
    pieces_in_views,
    settle_layers,
    textured,
)
from gvla2_plugins.classical.solids import SeenObject

SMALLEST = 0.02  # metres along the table: what hides less of it is noise
AROUND = 0.8  # share of the pixels about a hole that show the table
ONE_PLACE = 0.15  # metres between the feet of one object in two pictures


def lost_places(frames: Sequence[TableFrame], flat: Sequence[NDArray[np.bool_]]) -> list[FloatArray]:
    """Points (3,) on the table, one a place, where a camera lost all depth and sees the table all around.

    ``flat`` (H, W), one a frame, are pixels of the table.
    """
    places: list[FloatArray] = []
    for frame, table in zip(frames, flat, strict=True):
        holes, _ = label(binary_opening(frame.lost, iterations=2))
        for number, (down, right) in enumerate(find_objects(holes), 1):
            window = (_wider(down), _wider(right))
            hole = holes[window] == number
            ring = binary_dilation(hole, iterations=4) & ~binary_dilation(hole, iterations=2)
            if not ring.any() or table[window][ring].mean() < AROUND:
                continue
            rows, columns = np.nonzero(hole)
            hidden = plane_crossings(frame, rows + window[0].start, columns + window[1].start)
            if np.ptp(hidden[:, :2], axis=0).min() < SMALLEST:
                continue
            # What is nearest to the camera is its foot; beyond it the object only hides the table.
            away = np.linalg.norm(hidden - frame.origin, axis=1)
            foot = np.median(hidden[away <= np.percentile(away, 10.0)], axis=0)
            if all(np.linalg.norm(foot - other) > ONE_PLACE for other in places):
                places.append(foot)
    return places


def _wider(span: slice) -> slice:
    return slice(max(0, span.start - 5), span.stop + 5)


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
        if wrong or config.min_points < 4 or config.robot_margin < 0:
            raise PerceptionError(
                f"perceiver=classical: {', '.join(wrong) or 'min_points or robot_margin'} is out of range; lengths "
                "must be positive, min_points at least 4, robot_margin at least 0."
            )
        self._config = config
        self._labellers = labellers(config)

    def perceive(self, observation: Observation, instruction: str, workspace: Box) -> Scene:
        """The scene inside ``workspace``, objects ordered by x, then y.

        Raises :class:`PerceptionError` when no camera delivers depth, or no plane is found that is level to 15 degrees.
        """
        del instruction  # what was asked must not change what is seen
        config = self._config
        low, high = np.asarray(workspace.low, dtype=np.float64), np.asarray(workspace.high, dtype=np.float64)
        if not (np.isfinite(low).all() and np.isfinite(high).all() and (low < high).all()):
            raise PerceptionError(f"The workspace from {low} to {high} is empty; low must be below high.")
        views = agreed(observation.views, workspace)
        err = views is not observation.views
        frames, notes = usable_frames(views, config.robot_margin, least=3 if err else 2)
        if err:
            notes.append("The cameras' poses disagreed and were corrected.")
        table = find_table([frame.points[np.isfinite(frame.depth)] for frame in frames], workspace)
        table_from_world = table.frame(workspace)
        frames = [frame.moved(table_from_world) for frame in frames]
        hand = transform_points(table_from_world, observation.world_from_tcp[:3, 3])
        middle = 0.5 * (low + high)
        height = table.height_at(float(middle[0]), float(middle[1]))
        # The table's frame has its origin under the middle of the workspace.
        room = np.array([*(high - middle)[:2] + BORDER, high[2] - height])
        pixels, objects, painted, patches, places = self._find(frames, table.noise, room, hand)
        named = described(pixels, objects, "object") + described(painted, patches, "patch")
        back = invert_rigid(table_from_world)
        world = [
            replace(o, world_from_object=back @ o.world_from_object, points=transform_points(back, o.points))
            for o in named
        ]
        inside = over_workspace(world, workspace)
        if lost := len(world) - len(inside):
            notes.append(f"{lost} object(s) beside the workspace were left out.")
        notes += _lost_notes([transform_points(back, place) for place in places], workspace)
        notes += _carried_notes(objects, new_ids(inside))
        scene = Scene(numbered(inside), height, workspace, "classical", tuple(notes))
        return labelled(scene, observation, self._labellers)

    def _find(
        self, frames: Sequence[TableFrame], noise: float, room: FloatArray, hand: FloatArray
    ) -> tuple[Pixels, list[SeenObject], Pixels, list[SeenObject], list[FloatArray]]:
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
        # The height of a speck is not believed: it may be of a layer, but is no paint on its own.
        specks = [
            near & high & ~up & (frame.points[..., 2] < LAYER[1] * rise)
            for frame, near, high, up in zip(frames, inside, above, raised, strict=True)
        ]
        different = [
            unlike_table(f, mask | speck) for f, mask, speck in zip(frames, flat, specks, strict=True)
        ]
        reach = 0.004 + 1.5 * noise
        layer = rise, noise, reach, config.jump, config.colour_step, config.min_points
        raised, different = settle_layers(frames, raised, different, *layer)
        different = [paint & ~speck for paint, speck in zip(different, specks, strict=True)]
        flat = [mask | other for mask, other in zip(flat, different, strict=True)]
        raised = grow_down(frames, raised, flat, different, config.colour_step)
        pixels = choose(frames, raised)
        objects: list[SeenObject] = []
        if len(pixels):
            pieces = pieces_in_views(pixels, config.jump, config.colour_step)
            labels = join_across_views(pixels, pieces, reach=reach)
            bodies = bodies_of(frames, pixels, config.jump, reach, config.min_points)
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
        return pixels, objects, painted, patches, lost_places(frames, flat)


def _grain(frame: TableFrame, flat: NDArray[np.bool_]) -> float:
    """What most neighbouring pixels of the table differ by at most, in colour from 0 to 1: the picture's noise."""
    image, flat = frame.image[::4].astype(np.float64), flat[::4]
    both = flat[:, :-1] & flat[:, 1:]
    step = np.linalg.norm(image[:, :-1][both] - image[:, 1:][both], axis=1)
    return float(np.percentile(np.append(step, 0.0), 75.0)) / 255.0


def _lost_notes(places: Sequence[FloatArray], workspace: Box) -> list[str]:
    """Where in the workspace something may stand that no depth shows; places (3,) in the world, metres."""
    inside = [p for p in places if ((p > workspace.low) & (p < workspace.high))[:2].all()]
    return [
        f"No depth was measured about x={p[0]:.2f}, y={p[1]:.2f} with the table all around: something of glass or "
        "metal may stand there that is not among the objects."
        for p in inside
    ]


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
