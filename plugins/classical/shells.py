"""Shells: what is left over on the walls of a thing that is already found belongs to it.

The walls of an open box are seen from outside and from inside, in different light and often in pieces that no image
shows together. One wall tells little; the whole box tells where its walls are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gvla2.geometry.transform import FloatArray
from gvla2.planning.colours import LIGHTNESS_WEIGHT
from gvla2_plugins.classical.clusters import LIKE
from gvla2_plugins.classical.pixels import Pixels
from gvla2_plugins.classical.things import Thing

FITTING = 0.7  # agreement from which a solid tells where its walls are
WALL = 0.015  # metres: walls of hollow things are no thicker
OUTSIDE = 0.008  # metres
SHADE = 0.35  # L* + 16 of a wall in the shade, over that of one in the light, is more
LID = 0.15  # of the height: what lies so near to the top may be a lid
SHARE = 0.85


def with_their_walls(pixels: Pixels, things: Sequence[Thing]) -> list[Thing]:
    """The things without pieces of one hue that lie on the walls of a larger one; those pixels are that one's."""
    kept: list[Thing] = []
    for thing in sorted(things, key=lambda t: -_size(t)):
        host = next((k for k, other in enumerate(kept) if _is_wall_of(pixels, thing, other)), None)
        if host is None:
            kept.append(thing)
            continue
        members = np.sort(np.concatenate([kept[host].members, thing.members]))
        kept[host] = replace(kept[host], members=members, points=pixels.points[members])
    return kept


def _is_wall_of(pixels: Pixels, piece: Thing, host: Thing) -> bool:
    rounded = host.kind == "cylinder" and piece.kind != "cylinder"
    if not (host.hollow or host.turn is not None or rounded) or host.kind == "other":
        return False
    if host.agreement < FITTING or piece.points.shape[0] > 2 * len(host.points):
        return False
    looks = [np.median(pixels.look[t.members], axis=0) for t in (piece, host)]
    lightness = [look[2] / LIGHTNESS_WEIGHT + 16.0 for look in looks]
    if np.linalg.norm((looks[0] - looks[1])[:2]) > LIKE or min(lightness) < SHADE * max(lightness):
        return False
    if host.turn is None and float(np.median(piece.points[:, 2])) > host.top - LID * host.extents[2]:
        return False
    depth = WALL if host.hollow else OUTSIDE
    gap = _gap(host, piece.points)
    return bool(((gap > -depth) & (gap < OUTSIDE)).mean() > SHARE)


def _size(thing: Thing) -> float:
    """What is hollow, then what is larger, comes first."""
    return float(np.prod(np.maximum(thing.extents, 0.01))) * (1.3 if thing.hollow else 1.0)


def _gap(host: Thing, points: FloatArray) -> FloatArray:
    """(N,) signed distance of points (N, 3) from the surface of a thing, negative inside."""
    local, half = host.local(points), 0.5 * host.extents
    if host.kind == "sphere":
        return np.asarray(np.linalg.norm(local, axis=1) - half[0])
    if host.kind == "cylinder":
        planes = np.stack([np.hypot(local[:, 0], local[:, 1]) - half[0], np.abs(local[:, 2]) - half[2]])
    else:
        planes = (np.abs(local) - half).T
    outside = np.sqrt((np.maximum(planes, 0.0) ** 2).sum(axis=0))
    return np.asarray(outside + np.minimum(planes.max(axis=0), 0.0))
