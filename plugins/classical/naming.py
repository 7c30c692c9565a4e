"""Words for objects: colour, shape and the noun that a person would use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvla2.perception.objects import colour_word, true_colour
from gvla2.planning.scene import SceneObject, Shape
from gvla2_plugins.classical.pixels import Pixels
from gvla2_plugins.classical.solids import SeenObject, evenly

MOST_POINTS = 4000  # points kept of one object


def described(pixels: Pixels, objects: Sequence[SeenObject], prefix: str) -> list[SceneObject]:
    """Objects in the table's frame, with ids and parents of their places in the list, behind ``prefix``."""
    belongs = parents(objects)
    named = []
    for k, obj in enumerate(objects):
        rgb = true_colour(pixels.rgb[obj.members])
        colour, sure = colour_word(rgb)
        seen = 0.8 * obj.agreement if obj.guessed else obj.agreement
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
                confidence=round(float(np.clip(seen, 0.05, 1.0) * (0.5 + 0.5 * sure)), 3),
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
