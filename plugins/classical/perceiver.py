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
from gvla2.perception.objects import MOST_POINTS, colour_word, new_ids, numbered, over_workspace, true_colour
from gvla2.perception.options import labellers
from gvla2.perception.registration import agreed
from gvla2.planning.scene import Box, Scene, SceneObject, Shape
from gvla2_plugins.classical import ClassicalConfig
from gvla2_plugins.classical.assembly import assemble, join_overlapping
from gvla2_plugins.classical.composites import (
    join_bottles,
    join_doors,
    join_fronts,
    join_lids,
    join_stems,
    name_knives,
    put_together,
)
from gvla2_plugins.classical.footprints import find_patches, unlike_table
from gvla2_plugins.classical.known import known_objects
from gvla2_plugins.classical.pixels import (
    Masks,
    Pixels,
    TableFrame,
    bodies_of,
    choose,
    grow_down,
    join_across_views,
    join_in_bodies,
    pieces_in_views,
    settle_layers,
    textured,
    usable_frames,
)
from gvla2_plugins.classical.solids import SeenObject, evenly

BORDER = 0.06  # metres around the workspace that are looked at too: what stands on its edge is seen whole
WHOLES = (join_lids, join_fronts, join_doors, join_stems, name_knives, join_bottles)
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
        frames, table, notes = usable_frames(views, workspace, least=3 if err else 2)
        if err:
            notes.append("The cameras' poses disagreed and were corrected.")
        table_from_world = table.frame(workspace)
        back = invert_rigid(table_from_world)
        hand = transform_points(table_from_world, observation.world_from_tcp[:3, 3])
        height = table.height_over(workspace)
        # The table's frame has its origin under the middle of the workspace.
        half = 0.5 * (workspace.high - workspace.low)[:2]
        room = np.array([*half + BORDER, workspace.high[2] - height])
        known, objects, named = self._find(frames, back, views, height, table.noise, room, hand)
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
        world_from_table: FloatArray,
        views: Views,
        height: float,
        noise: float,
        room: FloatArray,
        hand: FloatArray,
    ) -> tuple[list[SceneObject], list[SeenObject], list[SceneObject]]:
        """Known objects in the world; the others as solids, and with patches as objects in the table's frame."""
        config = self._config
        rise = max(config.min_height, 3.3 * noise)
        raised, flat, different = Masks(), Masks(), Masks()
        for frame in frames:
            with np.errstate(invalid="ignore"):
                near, high = (np.abs(frame.points) < room).all(axis=-1), frame.points[..., 2] > rise
                flat.append(near & ~high & (frame.points[..., 2] >= -rise))
            raised.append(without_specks(near & high))
            different.append(unlike_table(frame, flat[-1]))
        reach = 0.004 + 1.5 * noise
        raised, different = settle_layers(frames, raised, different, rise, reach, config)
        flat = [mask | other for mask, other in zip(flat, different, strict=True)]
        raised = grow_down(frames, raised, flat, different, config.colour_step)
        connected = config.jump, reach, config.min_points
        known, left = known_objects(
            self._labellers, frames, world_from_table, raised, views, height, *connected
        )
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
            objects = assemble(frames, pixels, labels, fine, config, hand)
            overlap = partial(join_overlapping, frames=frames, pixels=pixels, bodies=bodies, gap=config.gap)
            objects = put_together(pixels, objects, (*WHOLES, overlap))
        paint = [mask & other & ~up for mask, other, up in zip(flat, different, raised, strict=True)]
        bare = [mask & ~other & ~up for mask, other, up in zip(flat, different, raised, strict=True)]
        painted, patches = find_patches(frames, paint, bare, config)
        # What is seen flat on the table inside a hollow object is its floor.
        patches = [
            p for p in patches if not any(t.hollow and t.covers(p.centre[None, :2])[0] for t in objects)
        ]
        return known, objects, described(pixels, objects, "object") + described(painted, patches, "patch")


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
    return sorted(notes)


def described(pixels: Pixels, objects: Sequence[SeenObject], prefix: str) -> list[SceneObject]:
    """Objects in the table's frame, with ids and parents of their places in the list, behind ``prefix``."""
    belongs = parents(objects)
    named = []
    for k, obj in enumerate(objects):
        rgb = true_colour(pixels.rgb[obj.members])
        colour, sure = colour_word(rgb)
        named.append(
            SceneObject(
                f"{prefix}{k}",
                f"{colour} {noun_for(obj, objects, belongs[k])}",
                shape_of(obj),
                colour,
                obj.pose,
                obj.extents,
                evenly(obj.points, MOST_POINTS),
                rgb,
                parent=f"{prefix}{belongs[k]}" if belongs[k] >= 0 else "",
                confidence=round(float(np.clip(obj.agreement, 0.05, 1.0) * (0.5 + 0.5 * sure)), 3),
                opening=obj.opening,
            )
        )
    return named


def shape_of(obj: SeenObject) -> Shape:
    """The scene's coarse shape."""
    width, depth, height = obj.extents
    if obj.noun == "ring":
        return "ring"
    if obj.kind == "box" and height < 0.025 and height < 0.3 * min(width, depth):
        return "plate"
    if obj.kind == "cylinder" and height < 0.6 * width:
        return "disc"
    return obj.kind


def is_button(obj: SeenObject, carrier: SeenObject | None) -> bool:
    """A small raised object on a wider one, flat enough to be pushed."""
    if carrier is None or obj.floating:
        return False
    small = max(obj.extents[:2]) < 0.055 and obj.extents[2] < min(0.035, 1.2 * min(obj.extents[:2]))
    return bool(small and obj.extents[:2].prod() < 0.7 * carrier.extents[:2].prod())


def is_post(obj: SeenObject) -> bool:
    """Slender and upright."""
    return bool(obj.extents[2] > 3.5 * max(obj.extents[:2]) and max(obj.extents[:2]) < 0.05)


def is_held_up(obj: SeenObject, carrier: SeenObject | None) -> bool:
    """Up on a post, seen or too thin to be seen."""
    if carrier is None:
        return False
    return is_post(carrier) or (obj.floating and obj.bottom > carrier.top + 0.01)


def parents(objects: Sequence[SeenObject]) -> list[int]:
    """Index of the object that each is a part of, or -1.

    A button belongs to what it stands on, a post on a foot to the foot, what is held up to what the post belongs
    to, and what a split by height made to the lowest of its parts. What is already known to be a part, or to be an
    object of its own, stays that. Parts of parts belong to the whole, save a button's own housing.
    """
    found = [_parent(objects, k) for k in range(len(objects))]
    for k, obj in enumerate(objects):
        for _ in range(len(objects) if obj.part_of < 0 else 0):
            above = found[found[k]] if found[k] >= 0 else -1
            if above < 0 or is_button(obj, objects[found[k]]):
                break
            found[k] = above
    return found


def _parent(objects: Sequence[SeenObject], k: int) -> int:
    obj = objects[k]
    if obj.part_of >= 0 or obj.noun or obj.textured:
        return obj.part_of
    carrier = objects[obj.on] if obj.on >= 0 else None
    if carrier is not None and (is_button(obj, carrier) or _stands_up(obj, carrier)):
        return obj.on
    siblings = [j for j, other in enumerate(objects) if other.group == obj.group and j != k]
    lowest = min(siblings, key=lambda j: objects[j].bottom, default=k)
    return lowest if objects[lowest].bottom < obj.bottom - 1e-4 else -1


def _stands_up(obj: SeenObject, carrier: SeenObject) -> bool:
    return is_post(obj) or is_held_up(obj, carrier)


def noun_for(obj: SeenObject, objects: Sequence[SeenObject], parent: int) -> str:
    """The plain word for it, without its colour."""
    if obj.noun:
        return obj.noun
    carrier = objects[obj.on] if obj.on >= 0 and not obj.textured else None
    width, _, height = obj.extents
    if is_button(obj, carrier):
        return "button"
    if is_post(obj) and not obj.textured:
        return "post"
    if is_held_up(obj, carrier):
        return "lamp shade" if parent >= 0 and not is_post(objects[parent]) else "top"
    if any(
        other.on >= 0 and objects[other.on] is obj and _stands_up(other, obj) and not obj.textured
        for other in objects
    ):
        return "lamp base"
    if obj.hollow:
        if obj.kind == "cylinder":
            return "cup" if height > 0.6 * width else "bowl"
        return "tray" if height < 0.4 * width else "open box"
    shape = shape_of(obj)
    if shape == "cylinder":
        return "bottle" if height > 2.0 * width else "cylinder"
    if shape == "box":
        longest, shortest = float(max(obj.extents)), float(min(obj.extents))
        return "cube" if longest < 1.3 * shortest and longest < 0.15 else "box"
    return {"sphere": "ball", "other": "object"}.get(shape, shape)
