"""Depth maps as evidence with errors of their own: one joint, robust solve of what each view has wrong.

Depth of view i is believed up to a smooth factor exp(B_i(u) theta_i): a scale, a tilt across the object, its relief,
and a coarse field. The unknowns of all views are found together, from three witnesses: other views that see the same
surface, the visual hull, before which and behind which no surface can lie, and the size that such errors have. How
large the errors and the noise are is estimated from what is left over, round by round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.ndimage import map_coordinates

from gvla2.geometry.camera import Camera
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import Views

SAMPLES = 300
KNOTS = 5
ROUNDS = 8
FIELD = 0.02
FLOOR = 0.1
STIFF = 4
SHARE = 0.5
EM = 1
HULL = 1.0
DRAW = 0.15
RELIEF = 0.03
TELL = False
LOW = 4  # scale, tilt in x and y, relief
WIDE = np.array([0.3, 0.1, 0.1, 0.1])
ALIKE = 0.8
STEEP = 0.3
GAP = 0.06
CAUCHY = 2.4
PIXEL_SHARE = 1.0


@dataclass(frozen=True)
class Aligned:
    """``depth`` (S, H, W) metres after correction, NaN where unknown; ``sigma`` relative noise left; ``theta`` (S, P)."""

    depth: FloatArray
    std: FloatArray
    sigma: float
    theta: FloatArray


class _Basis:
    """Columns of B_i(u) at pixels of one view."""

    def __init__(self, depth: FloatArray) -> None:
        rows, columns = np.nonzero(np.isfinite(depth))
        self.low = np.array([columns.min(), rows.min()]) + 0.5
        self.size = np.maximum(np.array([np.ptp(columns), np.ptp(rows)]), 1)
        self.middle = float(np.median(np.log(depth[rows, columns])))

    def at(self, uv: FloatArray, log_depth: FloatArray) -> FloatArray:
        """(N, P)."""
        t = np.clip((uv - self.low) / self.size, 0, 1)  # (N, 2)
        columns = [np.ones(len(uv)), 2 * t[:, 0] - 1, 2 * t[:, 1] - 1, (log_depth - self.middle)]
        knots = np.arange(KNOTS)
        hat = [np.maximum(0, 1 - np.abs(t[:, a, None] * (KNOTS - 1) - knots)) for a in (0, 1)]
        hat = [h * h * (3 - 2 * h) for h in hat]
        field = (hat[0][:, :, None] * hat[1][:, None, :]).reshape(len(uv), -1)
        return np.concatenate([np.stack(columns, axis=1), field], axis=1)


@dataclass(frozen=True)
class _Look:
    camera: Camera
    log_depth: FloatArray  # (H, W), NaN where not solid
    normals: FloatArray  # (H, W, 3)
    basis: _Basis
    all_rays: FloatArray  # (H, W, 3)
    pixels: NDArray[np.intp]  # (N, 2)
    at: FloatArray  # (N,) log depth
    rays: FloatArray  # (N, 3)
    normal: FloatArray  # (N, 3)
    design: FloatArray  # (N, P)
    nearest: FloatArray  # (N,) log depth of the hull's front and back
    farthest: FloatArray


def align(
    depth: FloatArray, solid: NDArray[np.bool_], views: Views, front: FloatArray, back: FloatArray
) -> Aligned:
    """Correct depth maps (S, H, W), metres, NaN where unknown.

    ``solid`` (S, H, W) marks pixels that do not fly between surfaces; ``front`` and ``back`` (S, H, W) are the depths
    between which the visual hull lies, NaN outside it.
    """
    looks = [_look(*each) for each in zip(views, depth, solid, front, back, strict=True)]
    size = LOW + KNOTS * KNOTS
    theta = np.zeros((len(looks), size))
    for s, look in enumerate(looks):
        if look is not None:
            theta[s, 0] = _within(look)
    sigma = 0.02
    pixel = float(np.median([1 / v.camera.K[0, 0] for v in views]))
    gate = 0.10
    spread_of = np.concatenate([WIDE, np.full(size - LOW, FIELD)])
    spread_of[3] = RELIEF
    field = 1e-3
    covariance = np.eye(theta.size)
    spread_of[LOW:] = field
    for number in range(ROUNDS):
        if 0 < number <= STIFF:
            looks = [None if a is None else _turned(a, theta[s]) for s, a in enumerate(looks)]
        links = _links(looks, theta, gate)
        problem = _Problem(looks, links, sigma, spread_of, max(PIXEL_SHARE * pixel, sigma), theta.shape)
        answer = least_squares(
            problem.residuals, theta.ravel(), problem.jacobian, loss=problem.loss, method="trf",
            tr_solver="exact", max_nfev=6, x_scale=1 / problem.prior, ftol=1e-4, xtol=1e-5,
        )  # fmt: skip
        theta = answer.x.reshape(theta.shape)
        left = problem.gaps(theta)
        if len(left) == 0:
            break
        spread = float(1.4826 * np.median(np.abs(left)) / np.sqrt(2))
        stiff = number < STIFF
        if number == STIFF - 1:
            field = max(spread, 1e-4)
        sigma = max(spread, FLOOR * pixel, 0.0 if stiff else SHARE * field)
        covariance = np.linalg.inv(answer.jac.T @ answer.jac)
        moment = theta**2 + np.diag(covariance).reshape(theta.shape)
        own = moment if EM else theta**2 + 1e-6
        spread_of = np.concatenate([
            [WIDE[0]], np.full(2, np.sqrt(own[:, 1:3].mean())), [RELIEF],
            np.full(size - LOW, field),
        ])
        if TELL: print("   ", number, "sigma %.4f" % sigma, np.round(spread_of[:5], 4), "links", problem.data, "cost", round(answer.cost), "nfev", answer.nfev)
        gate = float(np.clip(5 * spread, 4 * pixel, 0.10))
    # Rows that share a knot share an error, and count once.
    covariance = covariance * max(1.0, problem.data / (len(looks) * KNOTS * KNOTS))
    corrected, spread_map = np.array(depth), np.full(depth.shape, np.nan)
    for s, (look, view) in enumerate(zip(looks, views, strict=True)):
        if look is None:
            corrected[s] = np.nan
            continue
        known = np.isfinite(depth[s])
        uv = view.camera.pixel_centres()[known]
        log = np.log(depth[s][known])
        design = look.basis.at(uv, log)
        corrected[s][known] = np.exp(log + design @ theta[s])
        own = covariance[s * size : (s + 1) * size, s * size : (s + 1) * size]
        spread_map[s][known] = np.sqrt(np.einsum("np,pq,nq->n", design, own, design) + sigma**2)
    return Aligned(corrected, spread_map, sigma, theta)


def _look(view, depth, solid, front, back) -> _Look | None:
    _, rays = view.camera.rays()
    normals = surface_normals(depth, rays)
    usable = solid & np.isfinite(depth) & np.isfinite(front) & np.isfinite(back)
    rows, columns = np.nonzero(usable)
    if len(rows) < 30:
        return None
    chosen = np.linspace(0, len(rows) - 1, min(SAMPLES, len(rows))).astype(int)
    rows, columns = rows[chosen], columns[chosen]
    basis = _Basis(depth)
    uv = np.stack([columns, rows], axis=1) + 0.5
    at = np.log(depth[rows, columns])
    return _Look(
        view.camera, np.where(solid, np.log(depth), np.nan), normals, basis, rays,
        np.stack([columns, rows], axis=1), at, rays[rows, columns],
        normals[rows, columns], basis.at(uv, at), np.log(front[rows, columns]), np.log(back[rows, columns]),
    )  # fmt: skip


def _turned(look: _Look, theta: FloatArray) -> _Look:
    """The look with the normals of its corrected surface."""
    known = np.isfinite(look.log_depth)
    depth = np.full(known.shape, np.nan)
    log = look.log_depth[known]
    design = look.basis.at(look.camera.pixel_centres()[known], log)
    depth[known] = np.exp(log + design @ theta)
    normals = surface_normals(depth, look.all_rays)
    at = look.pixels
    return replace(look, normals=normals, normal=normals[at[:, 1], at[:, 0]])


def surface_normals(depth: FloatArray, rays: FloatArray) -> FloatArray:
    """(H, W, 3) unit normals towards the camera of a depth map (H, W) on ``rays`` (H, W, 3); NaN at its rim."""
    points = rays * depth[..., None]
    across, down = np.full_like(points, np.nan), np.full_like(points, np.nan)
    across[:, 1:-1] = points[:, 2:] - points[:, :-2]
    down[1:-1] = points[2:] - points[:-2]
    normals = np.cross(down, across)  # v points down: this one looks back at the camera
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def _within(look: _Look) -> float:
    """The log scale that puts most of a view's depth into the hull, nearest to its front."""
    low, high = look.nearest - look.at, look.farthest - look.at
    tried = np.linspace(np.quantile(low, 0.02), np.quantile(high, 0.98), 200)
    cost = [
        np.minimum(np.maximum(low - t, 0) + np.maximum(t - high, 0), 0.05).mean()
        + 0.05 * np.minimum(np.abs(low - t), 0.1).mean()
        for t in tried
    ]
    return float(tried[int(np.argmin(cost))])


@dataclass(frozen=True)
class _Link:
    """Samples of view i and the pixels of view j that see the same surface: planes through the latter's points."""

    i: int
    j: int
    which: NDArray[np.int64]  # (N,) samples of i
    at: FloatArray  # (N,) log depth in j
    rays: FloatArray  # (N, 3) of j
    design: FloatArray  # (N, P) of j
    normal: FloatArray  # (N, 3)


def _links(looks, theta, gate) -> list[_Link]:
    links = []
    for i, a in enumerate(looks):
        for j, b in enumerate(looks):
            if i == j or a is None or b is None:
                continue
            link = _link(i, j, a, b, theta)
            gap, weight = _gap(link, a, b, theta)
            alike = np.einsum("nk,nk->n", a.normal[link.which], link.normal)
            kept = (np.abs(gap * weight) < gate) & (alike > ALIKE)
            if kept.any():
                links.append(_Link(i, j, *(x[kept] for x in (link.which, link.at, link.rays, link.design, link.normal))))
    return links


def _link(i, j, a, b, theta) -> _Link:
    points = a.camera.position + a.rays * np.exp(a.at + a.design @ theta[i])[:, None]
    uv, z = b.camera.project(points)
    pixel = np.where((b.camera.inside(uv) & (z > 0))[:, None], np.nan_to_num(uv), 0).astype(np.intp)
    there = b.log_depth[pixel[:, 1], pixel[:, 0]]
    known = np.isfinite(there) & b.camera.inside(uv) & (z > 0)
    known &= np.isfinite(b.normals[pixel[:, 1], pixel[:, 0], 0]) & np.isfinite(a.normal[:, 0])
    which = np.flatnonzero(known)
    pixel, there = pixel[known], there[known]
    design = b.basis.at(pixel + 0.5, there)
    return _Link(i, j, which, there, b.all_rays[pixel[:, 1], pixel[:, 0]], design, b.normals[pixel[:, 1], pixel[:, 0]])


def _gap(k, a, b, theta):
    """Distances of the samples from the planes, in relative depth, and (N,) factor ..."""
    far = np.exp(a.at[k.which] + a.design[k.which] @ theta[k.i])
    near = np.exp(k.at + k.design @ theta[k.j])
    slope_a = np.einsum("nk,nk->n", k.normal, a.rays[k.which]) * far
    slope_b = np.einsum("nk,nk->n", k.normal, k.rays) * near
    apart = slope_a - slope_b + k.normal @ (a.camera.position - b.camera.position)
    weight = np.sqrt(np.maximum(slope_a**2, (STEEP * far) ** 2) + np.maximum(slope_b**2, (STEEP * near) ** 2)) / np.sqrt(2)
    return apart / weight, np.ones(len(far))


class _Problem:
    def __init__(self, looks, links, sigma, tau, tolerance, shape) -> None:
        self.looks, self.links, self.shape = looks, links, shape
        self.sigma, self.tolerance = sigma, tolerance
        self.prior = np.tile(1 / tau, shape[0])
        self.data = sum(len(k.which) for k in links)
        self.hinges = 2 * sum(len(k.at) for k in looks if k is not None)

    def residuals(self, x):
        theta = x.reshape(self.shape)
        parts = []
        for k in self.links:
            gap, _ = _gap(k, self.looks[k.i], self.looks[k.j], theta)
            parts.append(gap / (np.sqrt(2) * self.sigma))
        for s, a in enumerate(self.looks):
            if a is None:
                continue
            now = a.at + a.design @ theta[s]
            parts.append((now - a.nearest) / self._width(a, now))
            parts.append(HULL * np.maximum(now - a.farthest, 0) / self.tolerance)
        return np.concatenate([*parts, x * self.prior])

    def _width(self, a, now):
        thick = np.maximum(GAP * (a.farthest - a.nearest), self.tolerance)
        return np.where(now < a.nearest, self.tolerance / HULL, thick / DRAW)

    def jacobian(self, x):
        theta = x.reshape(self.shape)
        size = self.shape[1]
        J = np.zeros((self.data + self.hinges + len(x), len(x)))
        row = 0
        for k in self.links:
            a, b = self.looks[k.i], self.looks[k.j]
            far = np.exp(a.at[k.which] + a.design[k.which] @ theta[k.i])
            near = np.exp(k.at + k.design @ theta[k.j])
            slope_a = np.einsum("nk,nk->n", k.normal, a.rays[k.which]) * far
            slope_b = np.einsum("nk,nk->n", k.normal, k.rays) * near
            weight = np.sqrt(np.maximum(slope_a**2, (STEEP * far) ** 2) + np.maximum(slope_b**2, (STEEP * near) ** 2))
            weight = weight * self.sigma
            rows = slice(row, row + len(k.which))
            J[rows, k.i * size : (k.i + 1) * size] = (slope_a / weight)[:, None] * a.design[k.which]
            J[rows, k.j * size : (k.j + 1) * size] = -(slope_b / weight)[:, None] * k.design
            row += len(k.which)
        for s, a in enumerate(self.looks):
            if a is None:
                continue
            now = a.at + a.design @ theta[s]
            for weight in (1 / self._width(a, now), HULL * (now > a.farthest) / self.tolerance):
                J[row : row + len(now), s * size : (s + 1) * size] = weight[:, None] * a.design
                row += len(now)
        J[row:] = np.diag(self.prior)
        return J

    def loss(self, z):
        """Cauchy for what views say, squares for what errors are like."""
        rho = np.empty((3, len(z)))
        told = self.data + self.hinges
        rho[0], rho[1], rho[2] = z, 1.0, 0.0
        c = np.concatenate([np.full(self.data, CAUCHY**2), np.ones(self.hinges)])
        rho[0, :told] = c * np.log1p(z[:told] / c)
        rho[1, :told] = 1 / (1 + z[:told] / c)
        # Without the second derivative each step is a reweighted least squares, which never overshoots.
        return rho

    def gaps(self, theta):
        found = [_gap(k, self.looks[k.i], self.looks[k.j], theta)[0] for k in self.links]
        return np.concatenate(found) if found else np.zeros(0)
