"""Words for things: colour, shape and the noun that a person would use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import nearest_colours
from gvla2.planning.scene import Shape
from gvla2_plugins.classical.pixels import IntArray, Pixels
from gvla2_plugins.classical.things import Thing

SURE = 12.0  # by how much the second nearest colour word must be further away to be ruled out


def true_colour(pixels: Pixels, members: IntArray) -> FloatArray:
    """(3,) the thing's own colour in [0, 1]: the median of its brightest face in the view that lights it best.

    Light falls off with slope, never brightens: the brightest face is nearest to the paint.
    """
    best = np.zeros(3)
    for view in np.unique(pixels.view[members]):
        rgb = pixels.rgb[members[pixels.view[members] == view]]
        if len(rgb) < 6:
            continue
        brightness = rgb.sum(axis=1)
        face = np.median(rgb[brightness >= np.percentile(brightness, 70.0)], axis=0)
        best = face if face.sum() > best.sum() else best
    return best if best.any() else np.median(pixels.rgb[members], axis=0)


def colour_word(rgb: FloatArray) -> tuple[str, float]:
    """The nearest colour word and how sure it is, in [0, 1], from the lead over the second."""
    (word, first), (_, second) = nearest_colours(rgb, 2)
    return word, float(np.clip((second - first) / SURE, 0.0, 1.0))


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
    return carrier is not None and (
        is_post(carrier) or (thing.floating and thing.bottom > carrier.top + 0.01)
    )


def parents(things: Sequence[Thing]) -> list[int]:
    """Index of the thing that each is a part of, or -1.

    A button belongs to what it stands on, a post on a foot to the foot, what is held up to what the post belongs
    to, a lid to the round thing under it, and what a split by height made to the lowest of its parts. What is already
    known to be a part, or to be a thing of its own, stays that.
    """
    found = []
    for k, thing in enumerate(things):
        if thing.part_of >= 0 or thing.noun or thing.textured:
            found.append(thing.part_of)
            continue
        carrier = things[thing.on] if thing.on >= 0 else None
        siblings = [j for j, other in enumerate(things) if other.group == thing.group and j != k]
        lowest = min(siblings, key=lambda j: things[j].bottom, default=-1)
        parent = -1
        if carrier is not None and (
            is_button(thing, carrier)
            or is_post(thing)
            or is_held_up(thing, carrier)
            or _is_lid(thing, carrier)
        ):
            parent = thing.on
        elif lowest >= 0 and things[lowest].bottom < thing.bottom - 1e-4:
            parent = lowest
        found.append(parent)
    for k in range(len(found)):  # parts of parts belong to the whole, save a button's own housing
        for _ in range(0 if things[k].part_of >= 0 else len(found)):
            above = found[found[k]] if found[k] >= 0 else -1
            carrier = things[found[k]] if found[k] >= 0 else None
            if above < 0 or is_button(things[k], carrier):
                break
            found[k] = above
    return found


def _stands_up(thing: Thing, carrier: Thing) -> bool:
    return is_post(thing) or is_held_up(thing, carrier)


def _is_lid(thing: Thing, carrier: Thing) -> bool:
    rounds = thing.kind == "cylinder" and carrier.kind == "cylinder"
    alike = 0.75 < float(thing.extents[0] / carrier.extents[0]) < 1.35
    return bool(rounds and alike and thing.extents[2] < 0.5 * carrier.extents[2])


def noun_for(thing: Thing, things: Sequence[Thing], parent: int) -> str:
    """The plain word for it, without its colour."""
    if thing.noun:
        return thing.noun
    carrier = things[thing.on] if thing.on >= 0 and not thing.textured else None
    width, _, height = thing.extents
    if is_button(thing, carrier):
        return "button"
    if parent >= 0 and carrier is not None and _is_lid(thing, carrier):
        return "lid"
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
    match shape_of(thing):
        case "sphere":
            return "ball"
        case "disc":
            return "disc"
        case "cylinder":
            return "bottle" if height > 2.0 * width else "cylinder"
        case "plate":
            return "plate"
        case "box":
            longest, shortest = float(max(thing.extents)), float(min(thing.extents))
            return "cube" if longest < 1.3 * shortest and longest < 0.15 else "box"
    return "object"
