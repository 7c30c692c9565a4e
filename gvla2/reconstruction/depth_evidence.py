"""Depth maps as evidence with errors of their own: one joint, robust solve of what each view has wrong.

Depth of view i is believed up to a smooth factor exp(B_i(u) theta_i): a scale, a tilt across the object, its relief,
and a coarse field. The unknowns of all views are found together (Gauss-Newton, Cauchy loss) from

    r_pair   = n . (p_i - q_j) / sigma          samples of one view against planes through another's points
    r_hull   = log d - log d_front, d_back      surfaces lie within the visual hull, most of them near its front
    r_mask   = log d - log d_cap                where another view's mask has no other surface on its ray
    r_prior  = theta / spread                   how large such errors are

The noise sigma and the spread of tilts are estimated from what is left over, round by round: first with stiff terms
alone, then with the field. An estimate's poses are dropped before (see ``evidence``): with masks and depth on the same
pixels, what a wrong pose does to depth is a tilt, a scale and a field, so that no pose is solved for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from gvla2.errors import GeometryError
from gvla2.geometry.compiled import fused
from gvla2.geometry.transform import FloatArray, check_rigid
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2.reconstruction.depth_samples import (
    KNOTS,
    LOW,
    UNKNOWNS,
    DepthSamples,
    DesignRows,
    Pairs,
    matched_pairs,
    sample_view,
    surface_normals,
    with_corrected_normals,
)
from gvla2.reconstruction.support import mask_of
from gvla2.reconstruction.view_set import ViewSet

ROUNDS, STIFF = 8, 4
"""Rounds of matching and solving, and how many of them keep the field still."""
SCALE, TILT, RELIEF = 0.3, 0.1, 0.03
"""Standard deviations of log scale, tilt and relief before anything is known; the tilt's is then estimated."""
STILL = 1e-3
"""The field's standard deviation while it is kept still."""
CAUCHY = 2.4
"""Standard deviations beyond which a pair counts less and less."""
DRAW, BEHIND = 0.15, 0.06
"""How strongly depth is drawn to the hull's front, from within this share of the hull's thickness."""
GATE = 0.10
"""Largest relative distance of a pair at first."""
STEPS = 8
"""Steps of a solve, between two rounds of matching."""
LITTLE = 0.05
"""A gain of the log posterior that is not worth another step."""
UNEVEN = 0.5
"""The field's knots leave at least this share of its size unexplained."""


@dataclass(frozen=True)
class Aligned:
    """Depth after correction, and how far to trust it.

    ``depth`` (S, H, W) metres, NaN where unknown or where a view could not be used; ``std`` (S, H, W) relative standard
    deviation.
    """

    depth: FloatArray
    std: FloatArray


def align(
    depth: FloatArray,
    solid: NDArray[np.bool_],
    seen: ViewSet,
    caps: FloatArray,
) -> Aligned:
    """Correct depth maps (S, H, W), metres, NaN where unknown.

    ``solid`` (S, H, W) marks pixels that do not fly between surfaces; ``caps`` (S, H, W) are depths behind which no
    surface can begin, NaN where nobody knows.
    """
    views, ends = seen.views, seen.hull_interval
    each = zip(views, seen.rays, depth, solid, *ends, caps, strict=True)
    sampled = [sample_view(s, *of_view) for s, of_view in enumerate(each)]
    theta = np.zeros((len(sampled), UNKNOWNS))
    for s, one in enumerate(sampled):
        if one is not None:
            theta[s, 0] = one.scale_within_hull()
    pixel = float(np.median([1 / view.camera.K[0, 0] for view in views]))
    sigma, gate, field, tilt = 0.02, GATE, STILL, TILT
    covariance, rows = np.eye(theta.size), 0
    for number in range(ROUNDS):
        if 0 < number <= STIFF:
            sampled = [None if one is None else with_corrected_normals(one, theta) for one in sampled]
        spread = np.concatenate([[SCALE, tilt, tilt, RELIEF], np.full(UNKNOWNS - LOW, field)])
        pairs = matched_pairs(sampled, theta, gate)
        theta, covariance = _Problem(sampled, pairs, sigma, max(pixel, sigma), spread).solved(theta)
        if pairs is None:
            break
        rows, gaps = len(pairs.at), pairs.gaps(theta)[0]
        left = float(1.4826 * np.median(np.abs(gaps)) / np.sqrt(2))
        if number == STIFF - 1:
            field = max(left, 1e-4)  # what stiff terms leave over is the field's
        sigma = max(left, 0.1 * pixel, UNEVEN * field if number >= STIFF else 0.0)
        # How large tilts are: their posterior second moment, the mean over the views (MacKay's evidence).
        moment = theta**2 + np.diag(covariance).reshape(theta.shape)
        tilt = float(np.sqrt(moment[:, 1:3].mean()))
        gate = float(np.clip(5 * left, 4 * pixel, GATE))
    # Rows that share a knot share an error, and count once.
    covariance = covariance * max(1.0, rows / (len(sampled) * KNOTS * KNOTS))
    return _corrected(depth, sampled, theta, covariance, sigma)


def _corrected(
    depth: FloatArray,
    sampled: Sequence[DepthSamples | None],
    theta: FloatArray,
    covariance: FloatArray,
    sigma: float,
) -> Aligned:
    corrected, std = np.full(depth.shape, np.nan), np.full(depth.shape, np.nan)
    for s, one in enumerate(sampled):
        if one is None:
            continue
        known = np.isfinite(depth[s])
        log = np.log(depth[s][known])
        design = one.basis.at(one.camera.pixel_centres()[known], log)
        corrected[s][known] = np.exp(log + design @ theta)
        std[s][known] = np.sqrt(_variances(design.columns, design.values, covariance) + sigma**2)
    return Aligned(corrected, std)


Rows = tuple[FloatArray, float, DesignRows]
"""Residuals (N,), the square of the Cauchy loss's width, and their slopes."""


class _Problem:
    """The negative log posterior of all unknowns theta (S, P), and its minimum.

    ``sigma`` relative noise of depth; ``edge`` relative width of the hull's surface; ``spread`` (P,) of the unknowns.
    The solver sees them in units of their spread.
    """

    def __init__(
        self,
        sampled: Sequence[DepthSamples | None],
        pairs: Pairs | None,
        sigma: float,
        edge: float,
        spread: FloatArray,
    ) -> None:
        self._sampled = [one for one in sampled if one is not None]
        self._pairs, self._sigma, self._edge = pairs, np.sqrt(2) * sigma, edge
        self._spread = np.tile(spread, len(sampled))

    def solved(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The likeliest theta near the given one, and its covariance (S P, S P)."""
        z = theta.ravel() / self._spread
        now = self._at(z)
        for _ in range(STEPS):
            cost, slope, curvature = now
            step = -_inverse(curvature) @ slope
            now = self._at(z + step)
            while not now[0] <= cost and np.abs(step).max() > 1e-6:  # nor where depth has overflown
                step *= 0.5
                now = self._at(z + step)
            z = z + step
            if cost - now[0] < LITTLE:
                break
        covariance = _inverse(now[2]) * np.outer(self._spread, self._spread)
        return (z * self._spread).reshape(theta.shape), covariance

    def _rows(self, theta: FloatArray) -> Iterator[Rows]:
        if self._pairs is not None:
            gaps, slopes = self._pairs.gaps(theta)
            yield gaps / self._sigma, CAUCHY**2, DesignRows(slopes.columns, slopes.values / self._sigma)
        for one in self._sampled:
            now = one.at + one.design @ theta
            # Little may lie before the hull's front, much behind it.
            behind = np.maximum(BEHIND * (one.farthest - one.nearest), self._edge) / DRAW
            width = np.where(now < one.nearest, self._edge, behind)
            yield (now - one.nearest) / width, 1.0, one.design.scaled(1 / width)
            past = np.maximum(now - one.farthest, 0) / self._edge
            yield past, 1.0, one.design.scaled((past > 0) / self._edge)
            at, design, cap = one.capped
            past = np.maximum(at + design @ theta - cap, 0) / self._edge
            yield past, 1.0, design.scaled((past > 0) / self._edge)

    def _at(self, z: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """The cost at z, its slope (S P,), and the curvature (S P, S P) of a reweighted least squares.

        Cauchy for what pairs and hull say, squares for what errors are like. The curvature is positive definite.
        """
        cost, slope, curvature = 0.0, np.zeros(len(z)), np.zeros((len(z), len(z)))
        for r, width, slopes in self._rows(z * self._spread):
            weight = 1 / (1 + r * r / width)
            cost += 0.5 * width * float(np.log1p(r * r / width).sum())
            _gather(slopes.columns, slopes.values, weight, weight * r, slope, curvature)
        curvature *= np.outer(self._spread, self._spread)
        return cost + 0.5 * float(z @ z), slope * self._spread + z, curvature + np.eye(len(z))


@fused
def _gather(
    columns: NDArray[np.intp],
    values: FloatArray,
    weight: FloatArray,
    pull: FloatArray,
    slope: FloatArray,
    curvature: FloatArray,
) -> None:
    """Add J^T pull and J^T diag(weight) J of rows (N, K) that have few columns each."""
    for n in range(len(columns)):
        for a in range(columns.shape[1]):
            i, value = columns[n, a], values[n, a]
            slope[i] += value * pull[n]
            for b in range(columns.shape[1]):
                curvature[i, columns[n, b]] += value * weight[n] * values[n, b]


@fused
def _variances(columns: NDArray[np.intp], values: FloatArray, covariance: FloatArray) -> FloatArray:
    """(N,) variances of rows (N, K) of unknowns with a covariance (P, P)."""
    found = np.zeros(len(columns))
    for n in range(len(columns)):
        for a in range(columns.shape[1]):
            for b in range(columns.shape[1]):
                found[n] += values[n, a] * covariance[columns[n, a], columns[n, b]] * values[n, b]
    return found


@fused
def _inverse(matrix: FloatArray) -> FloatArray:
    """Invert a positive definite matrix by Gauss-Jordan elimination.

    Matrices this small gain nothing from numpy's threads, which wait for one another busily: with other work on the
    cores they take a hundred times as long.
    """
    inverse, size = matrix.copy(), len(matrix)
    for k in range(size):
        pivot = 1 / inverse[k, k]
        inverse[k, k] = 1.0
        for j in range(size):
            inverse[k, j] *= pivot
        for i in range(size):
            if i != k:
                factor = inverse[i, k]
                inverse[i, k] = 0.0
                for j in range(size):
                    inverse[i, j] -= factor * inverse[k, j]
    return inverse


EDGE = 0.025
"""Share of the object's size by which depth bends from pixel to pixel where it jumps between surfaces."""
LEAST_COVERAGE = 0.05
"""Least share of the masks' pixels that must have depth."""
GAP = 0.03
"""Where surfaces lie behind their hull: half of them within this share of the hull's thickness (half-Cauchy)."""
OFF_SCALE = 0.1
"""How far the factor between a prior's depth and the masks is from 1, up or down, where it is reported."""
_DOUBT, _GROSS, _FEWEST = 2.0, 0.03, 5
"""Standard deviations behind a cap that refute a pixel; relative errors above are no noise; least number of caps."""
_NODES = np.linspace(-3.0, 3.0, 25)
_FLAT = 1e-6
"""Below this share of the distance from the origin, a spread counts as zero."""


@dataclass(frozen=True)
class DepthEvidence:
    """Depth of S views that agrees as well as the views allow.

    ``depth`` (S, H, W) metres along each camera's z, NaN where nothing is known; ``std`` (S, H, W) its relative
    standard deviation; ``weight`` (S, H, W) > 0 where known: confidence over variance; ``normals`` (S, H, W, 3) world,
    unit, towards the camera, 0 where there is none; ``summary`` is a sentence for the report.
    """

    depth: FloatArray
    std: FloatArray
    weight: FloatArray
    normals: FloatArray
    summary: str


def gather(estimate: GeometryEstimate, seen: ViewSet, needed: FloatArray | None = None) -> DepthEvidence:
    """A prior's depth of the object, corrected within its masks' visual hull.

    ``needed`` (N, 3): points that belong to the object because some mask shows nothing else there.

    An estimate with poses is scaled by Sim(3) between its cameras and the calibrated ones; its poses are then dropped
    (VGGT's depth times a scale is nearer to the truth than its point map), and what they had wrong is a part of each
    view's own error. Views without usable depth are left out. Raises :class:`GeometryError` when nothing can be used.
    """
    views, (front, back) = seen.views, seen.hull_interval
    depth, confidence = _checked(estimate, views)
    depth = depth * camera_scale(estimate, views)
    masks = np.stack([mask_of(view) for view in views])
    depth = np.where((masks > 0.5) & np.isfinite(depth) & (depth > 0) & (confidence > 0), depth, np.nan)
    coverage = float(np.isfinite(depth).sum() / max(int((masks > 0.5).sum()), 1))
    if coverage < LEAST_COVERAGE:
        raise GeometryError(f"The prior has depth for {coverage:.0%} of the masks' pixels.")
    jump = EDGE * float(np.linalg.norm(np.ptp(seen.hull_surface.vertices, axis=0)))
    rough = np.array([_first_scale(d, f) for d, f in zip(depth, front, strict=True)])
    usable = np.isfinite(rough)
    caps = depth_caps(np.zeros((0, 3)) if needed is None else needed, views)
    if not usable.any():
        raise GeometryError("The prior's depth and the visual hull have no pixel in common.")
    depth = np.where(usable[:, None, None], depth * rough[:, None, None], np.nan)
    if usable.sum() < 2:
        # A single depth map has nobody to disagree with.
        depth = depth / np.where(usable, rough, 1.0)[:, None, None]
        aligned = Aligned(depth, np.where(np.isfinite(depth), 1e-3, np.nan))
        refuted = np.zeros(depth.shape, dtype=np.bool_)
    else:
        solid = solid_pixels(depth, jump)
        aligned, refuted = refute_by_caps(align(depth, solid, seen, caps), solid, caps)
    believed = _within_hull(aligned, front, back)
    normals = np.stack([surface_normals(d, r) for d, r in zip(believed, seen.rays, strict=True)])
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(refuted, 0.0, np.nan_to_num(confidence / aligned.std**2))
    if not (weight > 0).any():
        raise GeometryError("No depth of the prior agrees with another view's.")
    typical = float(np.median(weight[weight > 0]))
    right = f"depth right to {100 * float(np.nanmedian(aligned.std)):.2f} %"
    if usable.sum() < 2:
        right = "how right its depth is cannot be judged from one"
    unused = ", ".join(view.name for view, one in zip(views, usable, strict=True) if not one)
    without = f" (no usable depth: {unused})" if unused else ""
    summary = f"{int(usable.sum())} of {len(views)} views used{without}, {right}."
    scale = float(np.median(rough[usable]))
    if max(scale, 1 / scale) - 1 > OFF_SCALE:
        summary += f" The masks fit its depth times {scale:.3g}: is it in metres?"
    return DepthEvidence(
        believed, aligned.std, np.clip(weight / typical, 0.0, 1e3), np.nan_to_num(normals), summary
    )


def depth_caps(needed: FloatArray, views: Views) -> FloatArray:
    """(S, H, W) depth of the nearest of the points (N, 3) on each pixel, NaN where there is none."""
    caps = []
    for view in views:
        cap = np.full((view.camera.height, view.camera.width), np.inf)
        uv, z = view.camera.project(needed)
        column, row = uv[view.camera.inside(uv)].astype(np.intp).T
        np.minimum.at(cap, (row, column), z[view.camera.inside(uv)])
        caps.append(np.where(np.isfinite(cap), cap, np.nan))
    return np.stack(caps)


def refute_by_caps(
    aligned: Aligned, solid: NDArray[np.bool_], caps: FloatArray
) -> tuple[Aligned, NDArray[np.bool_]]:
    """Depth with the error that its caps reveal, and the pixels (S, H, W) that they refute.

    How far a view's solid pixels lie behind their ``caps`` is error that the other views did not reveal: it adds to the
    view's own. Pixels clearly behind a cap, and their neighbours, fly or belong to another surface.
    """
    with np.errstate(invalid="ignore"):
        behind = np.log(aligned.depth / caps)
        refuted = maximum_filter(behind > _DOUBT * aligned.std, (1, 3, 3))
    std = aligned.std.copy()
    for s, gap in enumerate(behind):
        residual = gap[solid[s] & np.isfinite(gap)]
        if len(residual) >= _FEWEST:
            std[s] = np.hypot(std[s], np.sqrt(np.mean(np.clip(residual, 0.0, _GROSS) ** 2)))
    return replace(aligned, std=std), refuted


def solid_pixels(depth: FloatArray, jump: float) -> NDArray[np.bool_]:
    """(S, H, W) pixels inside a surface: neither on a step of more than ``jump`` metres nor at the depth's rim.

    A slope has no second difference, however steep; an edge and a flying pixel have.
    """
    bend = np.zeros_like(depth)
    bend[:, :, 1:-1] = np.abs(depth[:, :, 2:] + depth[:, :, :-2] - 2 * depth[:, :, 1:-1])
    bend[:, 1:-1] = np.fmax(bend[:, 1:-1], np.abs(depth[:, 2:] + depth[:, :-2] - 2 * depth[:, 1:-1]))
    known = np.isfinite(depth)
    inner = minimum_filter(known, (1, 3, 3), mode="constant", cval=False)
    return np.asarray(inner & ~(bend >= jump))


def _checked(estimate: GeometryEstimate, views: Views) -> tuple[FloatArray, FloatArray]:
    depth = np.asarray(estimate.depth, dtype=np.float64)
    confidence = np.nan_to_num(np.asarray(estimate.confidence, dtype=np.float64), posinf=0.0)
    sizes = {(view.camera.height, view.camera.width) for view in views}
    if len(sizes) > 1:
        raise GeometryError(f"Depth maps of one prior need views of one size, these have {sorted(sizes)}.")
    expected = (len(views), *sizes.pop())
    if depth.shape != expected or confidence.shape != expected:
        raise GeometryError(
            f"The prior's depth {depth.shape} and confidence {confidence.shape} must be {expected}: "
            "views, height, width."
        )
    return depth, confidence


def camera_scale(estimate: GeometryEstimate, views: Views) -> float:
    """Metres per unit of the prior, by its cameras; 1 if it has at most one."""
    if estimate.world_from_camera is None:
        return 1.0
    calibrated = np.stack([view.camera.world_from_camera for view in views])
    return scale_between(estimate.world_from_camera, calibrated) or 1.0


def scale_between(estimated: FloatArray, calibrated: FloatArray) -> float | None:
    """The scale of the similarity from a prior's cameras to the calibrated ones, by centres and axis points.

    ``estimated`` and ``calibrated`` are world_from_camera (S, 4, 4). Each camera stands for
    its centre and three points on its axes, one root mean square spread of the centres away, so that two or
    collinear centres fix the rotation too; the axes say nothing about scale, which comes from the centres alone.
    None when all centres coincide (one view, or a turning camera): depth must then be scaled by other means.
    Raises :class:`GeometryError` for different numbers of cameras, or poses that are not rigid.
    """
    a, b = (np.asarray(x, dtype=np.float64) for x in (estimated, calibrated))
    if a.ndim != 3 or len(a) == 0 or a.shape != b.shape:
        raise GeometryError(
            f"Cameras to align must both be (S, 4, 4) with S >= 1, got {a.shape} and {b.shape}."
        )
    a = np.stack([check_rigid(pose, f"Estimated camera {i}") for i, pose in enumerate(a)])
    b = np.stack([check_rigid(pose, f"Calibrated camera {i}") for i, pose in enumerate(b)])
    mean_a, mean_b = a[:, :3, 3].mean(axis=0), b[:, :3, 3].mean(axis=0)
    centres_a, centres_b = a[:, :3, 3] - mean_a, b[:, :3, 3] - mean_b
    spread_a, spread_b = (float(np.sqrt((c * c).sum(axis=1).mean())) for c in (centres_a, centres_b))
    # Far from the origin, equal centres differ by rounding.
    floor_a, floor_b = (_FLAT * max(float(np.abs(m).max()), 1e-6) for m in (mean_a, mean_b))
    if spread_a <= floor_a or spread_b <= floor_b:
        return None
    # Axis points at one spread's distance, in units of the spread: centres and axes then weigh alike.
    axes = np.einsum("sij,skj->ik", b[:, :3, :3], a[:, :3, :3])
    u, _, vt = np.linalg.svd(axes + centres_b.T @ centres_a / (spread_a * spread_b))
    # Of all proper rotations, the one with the largest trace of R^T times that.
    rotation = (u * [1.0, 1.0, np.sign(np.linalg.det(u) * np.linalg.det(vt))]) @ vt
    scale = float(np.sum(centres_b * (centres_a @ rotation.T)) / (len(a) * spread_a**2))
    return scale if scale > 0 else None


def _first_scale(depth: FloatArray, front: FloatArray) -> float:
    """The factor that puts a depth map near the hull's front; NaN for too few pixels."""
    both = np.isfinite(depth) & np.isfinite(front)
    return float(np.median(front[both] / depth[both])) if both.sum() >= 30 else float("nan")


def _within_hull(aligned: Aligned, front: FloatArray, back: FloatArray) -> FloatArray:
    """Posterior mean of depth (S, H, W): the measurement, a Gaussian, times where surfaces lie behind a hull.

    Sure depth stays as it is; unsure depth comes near the hull, so that what nobody knows is left as the masks
    have it. Pixels that the hull misses keep the measurement.
    """
    believed = aligned.depth.copy()
    known = np.isfinite(believed) & np.isfinite(front)
    nearest, depth = front[known], believed[known]
    far = np.maximum(back[known] - nearest, 1e-9)
    sigma = np.maximum(aligned.std[known] * depth, 1e-9)
    believed[known] = nearest + _mean_gap(depth - nearest, sigma, far, _NODES, np.exp(-0.5 * _NODES**2))
    return believed


@fused
def _mean_gap(
    measured: FloatArray, sigma: FloatArray, far: FloatArray, nodes: FloatArray, likely: FloatArray
) -> FloatArray:
    mean = np.empty(len(measured))
    for n in range(len(measured)):
        top = bottom = 0.0
        for k in range(len(nodes)):
            gap = measured[n] + sigma[n] * nodes[k]
            if 0 <= gap <= far[n]:
                share = likely[k] / (1 + (gap / (GAP * far[n])) ** 2)
                top += share * gap
                bottom += share
        mean[n] = top / bottom if bottom > 1e-9 else min(max(measured[n], 0.0), far[n])
    return mean
