"""Words for things: colour, shape and the noun that a person would use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvla2.perception.objects import colour_word, true_colour
from gvla2.planning.scene import SceneObject, Shape
from gvla2_plugins.classical.pixels import Pixels
from gvla2_plugins.classical.solids import Thing, evenly

MOST_POINTS = 4000  # points kept of one object


def described(pixels: Pixels, things: Sequence[Thing], prefix: str) -> list[SceneObject]:
    """Objects in the table's frame, with ids and parents of their places in the list, behind ``prefix``."""
    belongs = parents(things)
    objects = []
    for k, thing in enumerate(things):
        rgb = true_colour(pixels.rgb[thing.members])
        colour, sure = colour_word(rgb)
        seen = 0.8 * thing.agreement if thing.guessed else thing.agreement
        objects.append(
            SceneObject(
                f"{prefix}{k}",
                f"{colour} {noun_for(thing, things, belongs[k])}",
                shape_of(thing),
                colour,
                thing.pose,
                thing.extents,
                evenly(thing.points, MOST_POINTS),
                rgb,
                parent=f"{prefix}{belongs[k]}" if belongs[k] >= 0 else "",
                confidence=round(float(np.clip(seen, 0.05, 1.0) * (0.5 + 0.5 * sure)), 3),
                opening=thing.opening,
            )
        )
    return objects


def shape_of(thing: Thing) -> Shape:
    """The scene's coarse shape."""
    width, depth, height = thing.extents
    if thing.noun == "ring":
        return "ring"
    if thing.kind == "box" and height < 0.025 and height < 0.3 * min(width, depth):
        return "plate"
    if thing.kind == "cylinder" and height < 0.6 * width:
        return "disc"
    return thing.kind


def is_button(thing: Thing, carrier: Thing | None) -> bool:
    """A small raised thing on a wider one, flat enough to be pushed."""
    if carrier is None or thing.floating:
        return False
    small = max(thing.extents[:2]) < 0.055 and thing.extents[2] < min(0.035, 1.2 * min(thing.extents[:2]))
    return bool(small and thing.extents[:2].prod() < 0.7 * carrier.extents[:2].prod())


def is_post(thing: Thing) -> bool:
    """Slender and upright."""
    return bool(thing.extents[2] > 3.5 * max(thing.extents[:2]) and max(thing.extents[:2]) < 0.05)


def is_held_up(thing: Thing, carrier: Thing | None) -> bool:
    """Up on a post, seen or too thin to be seen."""
    if carrier is None:
        return False
    return is_post(carrier) or (thing.floating and thing.bottom > carrier.top + 0.01)


def parents(things: Sequence[Thing]) -> list[int]:
    """Index of the thing that each is a part of, or -1.

    A button belongs to what it stands on, a post on a foot to the foot, what is held up to what the post belongs
    to, and what a split by height made to the lowest of its parts. What is already known to be a part, or to be a
    thing of its own, stays that. Parts of parts belong to the whole, save a button's own housing.
    """
    found = [_parent(things, k) for k in range(len(things))]
    for k, thing in enumerate(things):
        for _ in range(len(things) if thing.part_of < 0 else 0):
            above = found[found[k]] if found[k] >= 0 else -1
            if above < 0 or is_button(thing, things[found[k]]):
                break
            found[k] = above
    return found


def _parent(things: Sequence[Thing], k: int) -> int:
    thing = things[k]
    if thing.part_of >= 0 or thing.noun or thing.textured:
        return thing.part_of
    carrier = things[thing.on] if thing.on >= 0 else None
    if carrier is not None and (is_button(thing, carrier) or _stands_up(thing, carrier)):
        return thing.on
    siblings = [j for j, other in enumerate(things) if other.group == thing.group and j != k]
    lowest = min(siblings, key=lambda j: things[j].bottom, default=k)
    return lowest if things[lowest].bottom < thing.bottom - 1e-4 else -1


def _stands_up(thing: Thing, carrier: Thing) -> bool:
    return is_post(thing) or is_held_up(thing, carrier)


def noun_for(thing: Thing, things: Sequence[Thing], parent: int) -> str:
    """The plain word for it, without its colour."""
    if thing.noun:
        return thing.noun
    carrier = things[thing.on] if thing.on >= 0 and not thing.textured else None
    width, _, height = thing.extents
    if is_button(thing, carrier):
        return "button"
    if is_post(thing) and not thing.textured:
        return "post"
    if is_held_up(thing, carrier):
        return "lamp shade" if parent >= 0 and not is_post(things[parent]) else "top"
    if any(
        other.on >= 0 and things[other.on] is thing and _stands_up(other, thing) and not thing.textured
        for other in things
    ):
        return "lamp base"
    if thing.hollow:
        if thing.kind == "cylinder":
            return "cup" if height > 0.6 * width else "bowl"
        return "tray" if height < 0.4 * width else "open box"
    shape = shape_of(thing)
    if shape == "cylinder":
        return "bottle" if height > 2.0 * width else "cylinder"
    if shape == "box":
        longest, shortest = float(max(thing.extents)), float(min(thing.extents))
        return "cube" if longest < 1.3 * shortest and longest < 0.15 else "box"
    return {"sphere": "ball", "other": "object"}.get(shape, shape)
