"""Solids by their signed distance, and their fit to surface points and to points known to be free.

A point that a camera saw lies on the surface: its distance should be 0. A point that a camera looked through lies
outside: its distance should not be negative. The first places the faces, the second the silhouette, which is known
to a fraction of a pixel where several views see it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gvla2.geometry.compiled import compiled
from gvla2.geometry.transform import FloatArray, rigid
from gvla2_plugins.classical.pixels import IntArray, Pixels

Kind = Literal["box", "cylinder", "sphere", "region", "other"]
"""A region is paint on the table."""

THIN = 2e-3  # metres: nothing is taken to be flatter


@dataclass(frozen=True)
class SeenObject:
    """One solid on the table, in the table's frame (z = 0 is its top), metres.

    ``members`` (N,) its pixels in the list; ``points`` (N, 3); ``centre``, ``yaw``, ``extents`` its upright box;
    ``agreement`` in [0, 1] how well the solid explains the points; ``hollow``: one sees into it; ``floating``: free
    space was seen under it; ``lowest`` height of its seen points;
    objects of one ``group`` were one before a split by height; ``on`` is the index of the object that carries
    it, -1 for the table; ``part_of`` that of the object that it is known to be a part of, and ``noun`` what it is known
    to be, "" if it is named by its shape; ``textured``: its paint separates no parts; ``opening`` its inner width,
    0 where it is closed; ``turn`` (3, 3) the axes of an object that leans, in place of ``yaw``.
    """

    kind: Kind
    members: IntArray = field(repr=False)
    points: FloatArray = field(repr=False)
    centre: FloatArray
    yaw: float
    extents: FloatArray
    agreement: float
    hollow: bool = False
    floating: bool = False
    lowest: float = 0.0
    group: int = -1
    on: int = -1
    part_of: int = -1
    noun: str = ""
    opening: float = 0.0
    textured: bool = False
    turn: FloatArray | None = None

    @property
    def spans(self) -> FloatArray:
        """(3,) side lengths of the upright box about it that is turned by its yaw."""
        if self.turn is None:
            return self.extents
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        upright = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return np.asarray(np.abs(upright @ self.turn) @ self.extents)

    @property
    def top(self) -> float:
        """Height of its highest point."""
        return float(self.centre[2] + 0.5 * self.spans[2])

    @property
    def bottom(self) -> float:
        """Height of its lowest point."""
        return float(self.centre[2] - 0.5 * self.spans[2])

    @property
    def pose(self) -> FloatArray:
        """(4, 4) table_from_object."""
        if self.turn is not None:
            return rigid(self.turn, self.centre)
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        return rigid([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], self.centre)

    def posed(self, kind: Kind, parameters: Sequence[float] | FloatArray) -> SeenObject:
        """The same object as a solid with these parameters; "other" has those of a box."""
        yaw, (x, y, *sides) = 0.0, parameters
        if kind == "sphere":
            centre, extents = np.array([x, y, sides[0]]), np.full(3, abs(sides[1]))
            return replace(self, kind=kind, centre=centre, extents=extents)
        *sides, top, bottom = sides
        if kind == "cylinder":
            width = depth = abs(sides[0])
        else:
            yaw, width, depth = upright_rectangle(*sides)
        centre, extents = np.array([x, y, 0.5 * (top + bottom)]), np.array([width, depth, top - bottom])
        return replace(self, kind=kind, centre=centre, yaw=yaw, extents=extents)

    def resting_at(self, height: float) -> SeenObject:
        """The same object with its lower face at ``height``; its top stays."""
        span = max(THIN, self.top - height)
        centre = np.array([*self.centre[:2], self.top - 0.5 * span])
        return replace(self, centre=centre, extents=np.array([*self.extents[:2], span]))

    def covers(self, xy: FloatArray, margin: float = 0.0) -> NDArray[np.bool_]:
        """(N,) bool: points (N, 2) over its footprint, grown by ``margin`` metres."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        local = (xy - self.centre[:2]) @ np.array([[c, -s], [s, c]])
        if self.kind in ("cylinder", "sphere"):
            return np.asarray(np.linalg.norm(local, axis=1) <= 0.5 * self.extents[0] + margin)
        return np.asarray((np.abs(local) <= 0.5 * self.spans[:2] + margin).all(axis=1))

    def grid(self, *shares: FloatArray) -> FloatArray:
        """(N, 3) all points at these shares of its extents from its centre, along its three axes."""
        steps = np.stack(np.meshgrid(*shares, indexing="ij"), axis=-1).reshape(-1, 3)
        return np.asarray(self.centre + (steps * self.extents) @ self.pose[:3, :3].T)

    def local(self, points: FloatArray) -> FloatArray:
        """(N, 3) points (N, 3) along its own axes, from its centre."""
        pose = self.pose
        return np.asarray((points - pose[:3, 3]) @ pose[:3, :3])


def solid(
    kind: Kind, pixels: Pixels, members: IntArray, parameters: Sequence[float] | FloatArray, agreement: float
) -> SeenObject:
    """The object of the pixels ``members`` (N,) as a solid with these parameters."""
    nowhere = np.zeros(3)
    obj = SeenObject(kind, members, pixels.points[members], nowhere, 0.0, nowhere, agreement)
    return obj.posed(kind, parameters)


def upright_rectangle(yaw: float, width: float, depth: float) -> tuple[float, float, float]:
    """Yaw, width, depth of the same rectangle named the same way each time."""
    if min(width, depth) > 0.9 * max(width, depth):
        quarter = np.round(yaw / (0.5 * np.pi))
        yaw -= quarter * 0.5 * np.pi
        if int(quarter) % 2:
            width, depth = depth, width
        return float(yaw), float(width), float(depth)
    if depth > width:
        yaw, width, depth = yaw + 0.5 * np.pi, depth, width
    return float((yaw + 0.5 * np.pi) % np.pi - 0.5 * np.pi), float(width), float(depth)


Distance = Callable[[FloatArray, FloatArray], FloatArray]
"""Signed distances (N,), metres, negative inside, of points (N, 3) to a solid with parameters (P,)."""

SCALE = 0.003  # metres: a point further off belongs ever more to something else
STEPS = 16  # most steps of a fit
DAMPING, EASED, TRIES = 1e-3, 5.0, 4  # of a step, by how much it changes, and how often a step is tried again
STEP, LEAST_GAIN = 1e-7, 1e-3  # metres or radians of the differences, and share of its cost that a step saves
STAY = 0.003  # metres of error per metre that a parameter leaves its start: it decides only where nothing else does


@compiled
def box_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Upright box: centre x, y, yaw, width (its x), depth (its y), top, bottom."""
    cx, cy, yaw, width, depth = parameters[0], parameters[1], parameters[2], parameters[3], parameters[4]
    top, bottom = parameters[5], parameters[6]
    c, s, found = np.cos(yaw), np.sin(yaw), np.empty(len(points))
    for n in range(len(points)):
        dx, dy, z = points[n, 0] - cx, points[n, 1] - cy, points[n, 2]
        side = abs(c * dx + s * dy) - 0.5 * width
        front = abs(c * dy - s * dx) - 0.5 * depth
        found[n] = _joined(side, front, abs(z - 0.5 * (top + bottom)) - 0.5 * (top - bottom))
    return found


@compiled
def cylinder_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Upright cylinder: centre x, y, diameter, top, bottom."""
    cx, cy, diameter, top, bottom = parameters[0], parameters[1], parameters[2], parameters[3], parameters[4]
    found = np.empty(len(points))
    for n in range(len(points)):
        radial = np.hypot(points[n, 0] - cx, points[n, 1] - cy) - 0.5 * diameter
        level = abs(points[n, 2] - 0.5 * (top + bottom)) - 0.5 * (top - bottom)
        found[n] = _joined(radial, level, -np.inf)
    return found


@compiled
def _joined(one: float, two: float, three: float) -> float:
    """Distance to the intersection of slabs, given the signed distances to each, metres."""
    outside = max(one, 0.0) ** 2 + max(two, 0.0) ** 2 + max(three, 0.0) ** 2
    return float(np.sqrt(outside) + min(max(one, two, three), 0.0))


def sphere_distance(parameters: FloatArray, points: FloatArray) -> FloatArray:
    """Sphere: centre x, y, z, diameter."""
    cx, cy, cz, diameter = parameters
    x, y, z = points.T
    return np.asarray(np.sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) - 0.5 * diameter)


@dataclass(frozen=True)
class SolidFit:
    """A fitted solid: ``parameters`` (P,); ``cost`` mean robust squared error, m^2; ``agreement`` in [0, 1], the
    share of surface points on the surface less ``intrusion``, the share of free points well inside.
    """

    parameters: FloatArray
    cost: float
    agreement: float
    intrusion: float


def fit_solid(
    distance: Distance,
    start: Sequence[float] | FloatArray,
    surface: FloatArray,
    free: FloatArray,
    rays: FloatArray | None = None,
    *,
    hold: Sequence[int],
    limits: tuple[Sequence[float] | FloatArray, Sequence[float] | FloatArray],
    filled: bool = False,
    slack: float = 0.0,
    tolerance: float = 0.005,
) -> SolidFit:
    """Robust least squares from ``start`` (P,); a parameter that no point determines stays, such as how far a box
    reaches behind a side that another object hides.

    ``surface`` (N, 3) seen points, ``free`` (M, 3) points known to be outside; ``rays`` (R, S, 3) points along rays
    that hit the solid, which must reach into it somewhere, however wrong their depth is; ``hold`` indices of
    parameters that stay, ``limits`` their least and greatest values. With ``filled`` the seen points may also lie
    inside, as those of a painted patch do, or ``slack`` metres outside, where their depth is noisy.
    """
    parameters = np.asarray(start, dtype=np.float64).copy()
    moving = np.delete(np.arange(len(parameters)), list(hold))
    begin = parameters[moving]
    rays = np.zeros((0, 1, 3)) if rays is None else rays
    counts = (len(surface), len(free), len(rays))
    share = np.repeat([*(1.0 / max(1, count) for count in counts), 1.0], [*counts, len(moving)])
    points = np.concatenate([surface, free, rays.reshape(-1, 3)])
    first_free, first_ray = counts[0], counts[0] + counts[1]

    def errors(values: FloatArray) -> FloatArray:
        """(N + M + R + P',) errors with the moving parameters (P',)."""
        parameters[moving] = values
        value = distance(parameters, points)
        seen, outside = value[:first_free], value[first_free:first_ray]
        reached = value[first_ray:].reshape(-1, rays.shape[1]).min(axis=1)
        seen = np.maximum(seen - slack, 0.0) if filled else seen
        left = STAY * (values - begin)
        return np.concatenate([seen, np.minimum(outside, 0.0), np.maximum(reached, 0.0), left])

    low, high = (np.asarray(limit)[moving] for limit in limits)
    best, cost = _minimised(errors, begin, low, high, share)
    error = errors(best)
    on = np.abs(error[:first_free]) < tolerance
    inside = error[first_free:first_ray] < -tolerance
    intrusion = float(inside.mean()) if len(free) else 0.0
    agreement = max(0.0, float(on.mean()) - intrusion) if len(surface) else 0.0
    return SolidFit(parameters, cost, agreement, intrusion)


def _minimised(
    errors: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    low: FloatArray,
    high: FloatArray,
    share: FloatArray,
) -> tuple[FloatArray, float]:
    """The values (P,) between ``low`` and ``high`` with the least cost near ``start``, and their cost: Cauchy's loss of
    the errors (E,), weighted by ``share`` (E,), so that each kind of evidence counts as much.

    Levenberg-Marquardt on reweighted squares: with a handful of values, most of the time of SciPy's
    ``least_squares`` is not spent on the errors.
    """

    def cost_of(error: FloatArray) -> float:
        return float(0.5 * SCALE**2 * (share @ np.log1p((error / SCALE) ** 2)))

    values, damping = np.clip(start, low, high), DAMPING
    error = errors(values)
    cost = cost_of(error)
    for _ in range(STEPS):
        steps = np.where(values + STEP > high, -STEP, STEP)
        slopes = np.stack([(errors(values + step) - error) / step.sum() for step in np.diag(steps)])  # (P, E)
        weighted = slopes * (share / (1.0 + (error / SCALE) ** 2))
        system, descent = weighted @ slopes.T, -weighted @ error
        inside = np.where(descent > 0, values < high, values > low)  # the others are held at their limits
        system, descent = system[np.ix_(inside, inside)], descent[inside]
        before = cost
        for _ in range(TRIES):
            step = np.zeros(len(values))
            step[inside] = np.linalg.solve(system + damping * np.diag(np.diag(system)), descent)
            nearer = np.clip(values + step, low, high)
            found = errors(nearer)
            if cost_of(found) < cost:
                values, error, cost, damping = nearer, found, cost_of(found), damping / EASED
                break
            damping *= EASED
        if before - cost <= LEAST_GAIN * cost:
            break
    return values, cost


def evenly(points: NDArray[Any], most: int) -> NDArray[Any]:
    """At most about ``most`` rows, taken at even steps: the same ones every time."""
    return points[:: max(1, -(-len(points) // most))]


def spread_out(points: FloatArray, most: int, spacing: float = 0.003) -> FloatArray:
    """At most about ``most`` rows, one a cube of side ``spacing`` metres: near cameras do not outvote far ones."""
    cells = np.floor(points / spacing).astype(np.int64)
    cells -= cells.min(axis=0)
    size = cells.max(axis=0) + 1
    _, first = np.unique((cells[:, 0] * size[1] + cells[:, 1]) * size[2] + cells[:, 2], return_index=True)
    return evenly(points[np.sort(first)], most)


def narrow_yaw(xy: FloatArray, trim: float = 1.0) -> tuple[float, FloatArray, FloatArray]:
    """Yaw in [0, pi/2), centre (2,) and lengths (2,) of the smallest rectangle about points (N, 2).

    ``trim`` per cent of the points are left out at each end, so that stray points do not count.
    """
    yaws = np.radians(np.arange(0.0, 90.0, 3.0))
    axes = np.stack([np.cos(yaws), np.sin(yaws), -np.sin(yaws), np.cos(yaws)], axis=1).reshape(-1, 2, 2)
    along = np.einsum("yij,nj->yin", axes, xy)  # (Y, 2, N)
    low, high = np.percentile(along, [trim, 100.0 - trim], axis=2)
    best = int(np.argmin((high - low).prod(axis=1)))
    middle = 0.5 * (low[best] + high[best]) @ axes[best]
    return float(yaws[best]), middle, high[best] - low[best]
