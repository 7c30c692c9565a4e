"""From Gaussians to ellipses in the image and back to the Gaussians' gradients: numba kernels, float32.

Elliptical weighted average splatting (Zwicker et al. 2001) as in 3D Gaussian splatting (Kerbl et al. 2023):
with the Gaussian's axes as columns of L = R S and the projection's Jacobian J at its centre, the ellipse is
V V^T + low_pass I with V = J W L. Keeping V (2, 3) instead of a 3x3 covariance makes both ways short, and the
determinant a sum of squares: |v1 x v2|^2 + low_pass (|v1|^2 + |v2|^2) + low_pass^2 loses nothing to cancellation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gvla2.reconstruction.compiled import Floats, Ints, Real, compiled


def harmonics(x: Any, y: Any, z: Any) -> tuple[Any, ...]:
    """The 15 values at a unit direction: of numbers, arrays alike, and inside compiled loops."""
    xx, yy, zz = x * x, y * y, z * z
    return (
        -0.4886025119 * y,
        0.4886025119 * z,
        -0.4886025119 * x,
        1.0925484306 * x * y,
        -1.0925484306 * y * z,
        0.3153915653 * (2 * zz - xx - yy),
        -1.0925484306 * x * z,
        0.5462742153 * (xx - yy),
        -0.5900435899 * y * (3 * xx - yy),
        2.8906114426 * x * y * z,
        -0.4570457995 * y * (4 * zz - xx - yy),
        0.3731763326 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457995 * x * (4 * zz - xx - yy),
        1.4453057213 * z * (xx - yy),
        -0.5900435899 * x * (xx - 3 * yy),
    )


TILE = 16
"""Side of the square tiles in pixels."""

U, V, CONIC_A, CONIC_B, CONIC_C, CONIC_DET, OPACITY, REACH, RED, GREEN, BLUE, DEPTH = range(12)
"""Columns of a projected Gaussian ("splat"). The conic is the inverse ((A, B), (B, C)) of the ellipse; REACH is
ln(opacity / min_alpha): alpha stays above min_alpha while half the squared Mahalanobis distance is below it."""
SPLAT_COLUMNS = 12

ROTATION, TRANSLATION, INTRINSICS, EYE, SLOPES, LOW_PASS, NEAR, MIN_ALPHA = 0, 9, 12, 17, 20, 24, 25, 26
"""Where values are in the camera's vector: camera_from_world (9 + 3), k00 k01 k02 k11 k12, the optical centre,
the least and greatest slopes x/z, y/z at which the projection is linearised, and the renderer's options."""

MOST_SPREAD = np.float32(1e3)
"""A standard deviation of this multiple of the depth covers any image; more would only overflow."""
SH_C0 = np.float32(0.2820948)


@compiled
def to_camera(
    camera: Floats,
    centre: Floats,
) -> tuple[Real, Real, Real]:
    """A point of the world in the camera's frame."""
    x = camera[0] * centre[0] + camera[1] * centre[1] + camera[2] * centre[2] + camera[9]
    y = camera[3] * centre[0] + camera[4] * centre[1] + camera[5] * centre[2] + camera[10]
    z = camera[6] * centre[0] + camera[7] * centre[1] + camera[8] * centre[2] + camera[11]
    return x, y, z


@compiled
def gaussian_axes(
    log_scale: Floats,
    rotation: Floats,
    z: Real,
    axes: Floats,
) -> None:
    """Write L = R S (3, 3), one axis of the Gaussian a column, for a Gaussian at depth ``z``."""
    w, x, y, q = rotation[0], rotation[1], rotation[2], rotation[3]
    inverse = np.float32(1.0) / math.sqrt(w * w + x * x + y * y + q * q)
    w, x, y, q = w * inverse, x * inverse, y * inverse, q * inverse
    most = MOST_SPREAD * z
    a, b, c = (
        min(math.exp(log_scale[0]), most),
        min(math.exp(log_scale[1]), most),
        min(math.exp(log_scale[2]), most),
    )
    one, two = np.float32(1.0), np.float32(2.0)
    axes[0, 0] = (one - two * (y * y + q * q)) * a
    axes[1, 0] = two * (x * y + w * q) * a
    axes[2, 0] = two * (x * q - w * y) * a
    axes[0, 1] = two * (x * y - w * q) * b
    axes[1, 1] = (one - two * (x * x + q * q)) * b
    axes[2, 1] = two * (y * q + w * x) * b
    axes[0, 2] = two * (x * q + w * y) * c
    axes[1, 2] = two * (y * q - w * x) * c
    axes[2, 2] = (one - two * (x * x + y * y)) * c


@compiled
def image_axes(
    camera: Floats,
    x: Real,
    y: Real,
    z: Real,
    axes: Floats,
    frame: Floats,
    image: Floats,
) -> tuple[Real, Real]:
    """Write J W (2, 3) to ``frame`` and V = J W L (2, 3) to ``image``; return the slopes of linearisation.

    Far outside the image the slopes stay at its margin, as in 3DGS.
    """
    slope_x = min(max(x / z, camera[SLOPES]), camera[SLOPES + 1])
    slope_y = min(max(y / z, camera[SLOPES + 2]), camera[SLOPES + 3])
    inverse = np.float32(1.0) / z
    k00, k01, k11 = camera[INTRINSICS], camera[INTRINSICS + 1], camera[INTRINSICS + 3]
    for j in range(3):
        along_x = (camera[j] - slope_x * camera[6 + j]) * inverse
        along_y = (camera[3 + j] - slope_y * camera[6 + j]) * inverse
        frame[0, j] = k00 * along_x + k01 * along_y
        frame[1, j] = k11 * along_y
    for row in range(2):
        for k in range(3):
            image[row, k] = (
                frame[row, 0] * axes[0, k] + frame[row, 1] * axes[1, k] + frame[row, 2] * axes[2, k]
            )
    return slope_x, slope_y


@compiled
def ellipse(
    image: Floats,
    low_pass: Real,
) -> tuple[Real, Real, Real, Real]:
    """Variances xx, xy, yy of V V^T + low_pass I in square pixels, and the determinant."""
    xx = image[0, 0] * image[0, 0] + image[0, 1] * image[0, 1] + image[0, 2] * image[0, 2]
    yy = image[1, 0] * image[1, 0] + image[1, 1] * image[1, 1] + image[1, 2] * image[1, 2]
    xy = image[0, 0] * image[1, 0] + image[0, 1] * image[1, 1] + image[0, 2] * image[1, 2]
    c0 = image[0, 1] * image[1, 2] - image[0, 2] * image[1, 1]
    c1 = image[0, 2] * image[1, 0] - image[0, 0] * image[1, 2]
    c2 = image[0, 0] * image[1, 1] - image[0, 1] * image[1, 0]
    det = c0 * c0 + c1 * c1 + c2 * c2 + low_pass * (xx + yy) + low_pass * low_pass
    return xx + low_pass, xy, yy + low_pass, det


@compiled
def project(
    start: int,
    stop: int,
    camera: Floats,
    width: int,
    height: int,
    centres: Floats,
    log_scales: Floats,
    rotations: Floats,
    logits: Floats,
    sh_dc: Floats,
    sh_rest: Floats,
    splats: Floats,
    boxes: Ints,
) -> None:
    """Project Gaussians ``start`` to ``stop``.

    Writes ``splats`` (N, 12) and ``boxes`` (N, 4), the first and last-plus-one tile column, then row, empty for a
    Gaussian that is not seen.
    """
    low_pass, near, min_alpha = camera[LOW_PASS], camera[NEAR], camera[MIN_ALPHA]
    axes = np.empty((3, 3), np.float32)
    frame, image = np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
    half = np.float32(0.5)
    for i in range(start, stop):
        boxes[i, 0] = boxes[i, 1] = boxes[i, 2] = boxes[i, 3] = 0
        x, y, z = to_camera(camera, centres[i])
        if not z > near:
            continue
        opacity = np.float32(1.0) / (np.float32(1.0) + math.exp(-logits[i]))
        if not opacity > min_alpha:
            continue
        gaussian_axes(log_scales[i], rotations[i], z, axes)
        image_axes(camera, x, y, z, axes, frame, image)
        xx, xy, yy, det = ellipse(image, low_pass)
        if not (det > 0 and det < np.inf):  # flat and edge-on without a low-pass
            continue
        u = camera[INTRINSICS] * x / z + camera[INTRINSICS + 1] * y / z + camera[INTRINSICS + 2]
        v = camera[INTRINSICS + 3] * y / z + camera[INTRINSICS + 4]
        # The pixels whose centres (k + 0.5) lie in the box around the ellipse where alpha reaches min_alpha.
        reach = math.log(opacity / min_alpha)
        half_u, half_v = math.sqrt(np.float32(2.0) * reach * xx), math.sqrt(np.float32(2.0) * reach * yy)
        left, right = np.ceil(u - half_u - half), np.floor(u + half_u - half)
        top, bottom = np.ceil(v - half_v - half), np.floor(v + half_v - half)
        if not (
            left <= right and top <= bottom and right >= 0 and bottom >= 0 and left < width and top < height
        ):
            continue
        column0, column1 = int(max(left, 0)) // TILE, int(min(right, width - 1)) // TILE + 1
        row0, row1 = int(max(top, 0)) // TILE, int(min(bottom, height - 1)) // TILE + 1
        boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3] = column0, column1, row0, row1
        splats[i, U], splats[i, V], splats[i, DEPTH] = u, v, z
        splats[i, CONIC_A], splats[i, CONIC_B], splats[i, CONIC_C] = yy / det, -xy / det, xx / det
        splats[i, CONIC_DET] = np.float32(1.0) / det
        splats[i, OPACITY], splats[i, REACH] = opacity, reach
        _colour(camera, centres[i], sh_dc[i], sh_rest, i, splats[i])


_harmonics = compiled(harmonics)


@compiled
def _colour(
    camera: Floats,
    centre: Floats,
    sh_dc: Floats,
    sh_rest: Floats,
    i: int,
    splat: Floats,
) -> None:
    """Colour >= 0 towards the camera, from spherical harmonics up to degree 3 in the order of 3DGS."""
    for k in range(3):
        splat[RED + k] = np.float32(0.5) + SH_C0 * sh_dc[k]
    count = sh_rest.shape[1] // 3
    if count > 0:
        x, y, z = centre[0] - camera[EYE], centre[1] - camera[EYE + 1], centre[2] - camera[EYE + 2]
        inverse = np.float32(1.0) / math.sqrt(
            x * x + y * y + z * z
        )  # not zero: z > near in the camera's frame
        x, y, z = x * inverse, y * inverse, z * inverse
        basis = _harmonics(x, y, z)
        for k in range(3):
            total = 0.0
            for j in range(count):
                total += basis[j] * sh_rest[i, k * count + j]
            splat[RED + k] += np.float32(total)
    for k in range(3):
        splat[RED + k] = max(splat[RED + k], np.float32(0.0))


@compiled
def project_back(
    start: int,
    stop: int,
    camera: Floats,
    centres: Floats,
    log_scales: Floats,
    rotations: Floats,
    splats: Floats,
    first: Ints,
    partial: Floats,
    to_centres: Floats,
    to_log_scales: Floats,
    to_rotations: Floats,
    to_logits: Floats,
    to_sh_dc: Floats,
) -> None:
    """Write the gradients of Gaussians ``start`` to ``stop`` from what the tiles found.

    ``partial`` (entries, 9) holds the sums of ``rasteriser.composite_back``, one row for each tile of each
    Gaussian; rows ``first[i]`` to ``first[i + 1]`` are Gaussian i's and are added in that order, so that the
    answer does not depend on the number of threads.
    """
    sums = np.empty(9, np.float32)
    axes, to_axes = np.empty((3, 3), np.float32), np.empty((3, 3), np.float32)
    frame, image = np.empty((2, 3), np.float32), np.empty((2, 3), np.float32)
    to_image = np.empty((2, 3), np.float32)
    for i in range(start, stop):
        if first[i] == first[i + 1]:
            continue
        sums[:] = 0
        for entry in range(first[i], first[i + 1]):
            for k in range(9):
                sums[k] += partial[entry, k]
        for k in range(3):
            if splats[i, RED + k] > 0:  # a colour clamped at black has no slope
                to_sh_dc[i, k] = SH_C0 * sums[6 + k]
        to_logits[i] = (np.float32(1.0) - splats[i, OPACITY]) * sums[0]
        a, b, c = splats[i, CONIC_A], splats[i, CONIC_B], splats[i, CONIC_C]
        # d ellipse = -conic (d conic) conic, where d conic is -1/2 of the second moments.
        p, q, r = np.float32(0.5) * sums[3], np.float32(0.5) * sums[4], np.float32(0.5) * sums[5]
        ap, aq, bp, bq = a * p + b * q, a * q + b * r, b * p + c * q, b * q + c * r
        to_xx, to_xy, to_yy = ap * a + aq * b, ap * b + aq * c, bp * b + bq * c

        x, y, z = to_camera(camera, centres[i])
        gaussian_axes(log_scales[i], rotations[i], z, axes)
        slope_x, slope_y = image_axes(camera, x, y, z, axes, frame, image)
        for k in range(3):
            to_image[0, k] = np.float32(2.0) * (to_xx * image[0, k] + to_xy * image[1, k])
            to_image[1, k] = np.float32(2.0) * (to_xy * image[0, k] + to_yy * image[1, k])
        for j in range(3):
            for k in range(3):
                to_axes[j, k] = frame[0, j] * to_image[0, k] + frame[1, j] * to_image[1, k]
        _to_shape(log_scales[i], rotations[i], axes, to_axes, to_log_scales[i], to_rotations[i])
        to_u, to_v = a * sums[1] + b * sums[2], b * sums[1] + c * sums[2]
        _to_centre(camera, x, y, z, slope_x, slope_y, axes, frame, to_image, to_u, to_v, to_centres[i])


@compiled
def _to_shape(
    log_scale: Floats,
    rotation: Floats,
    axes: Floats,
    to_axes: Floats,
    to_log_scale: Floats,
    to_rotation: Floats,
) -> None:
    """Through L = R S to the logarithms of the scales and to the quaternion, which need not have length one."""
    for k in range(3):
        to_log_scale[k] = to_axes[0, k] * axes[0, k] + to_axes[1, k] * axes[1, k] + to_axes[2, k] * axes[2, k]
        scale = math.exp(log_scale[k])
        for j in range(3):
            to_axes[j, k] *= scale  # from here on the gradient of R
    length = math.sqrt(rotation[0] ** 2 + rotation[1] ** 2 + rotation[2] ** 2 + rotation[3] ** 2)
    w, x, y, z = rotation[0] / length, rotation[1] / length, rotation[2] / length, rotation[3] / length
    r00, r01, r02 = to_axes[0, 0], to_axes[0, 1], to_axes[0, 2]
    r10, r11, r12 = to_axes[1, 0], to_axes[1, 1], to_axes[1, 2]
    r20, r21, r22 = to_axes[2, 0], to_axes[2, 1], to_axes[2, 2]
    two = np.float32(2.0)
    to_w = two * (z * (r10 - r01) + y * (r02 - r20) + x * (r21 - r12))
    to_x = two * (y * (r01 + r10) + z * (r02 + r20) + w * (r21 - r12) - two * x * (r11 + r22))
    to_y = two * (x * (r01 + r10) + z * (r12 + r21) + w * (r02 - r20) - two * y * (r00 + r22))
    to_z = two * (x * (r02 + r20) + y * (r12 + r21) + w * (r10 - r01) - two * z * (r00 + r11))
    along = w * to_w + x * to_x + y * to_y + z * to_z  # the length of a quaternion changes nothing
    to_rotation[0] = (to_w - w * along) / length
    to_rotation[1] = (to_x - x * along) / length
    to_rotation[2] = (to_y - y * along) / length
    to_rotation[3] = (to_z - z * along) / length


@compiled
def _to_centre(
    camera: Floats,
    x: Real,
    y: Real,
    z: Real,
    slope_x: Real,
    slope_y: Real,
    axes: Floats,
    frame: Floats,
    to_image: Floats,
    to_u: Real,
    to_v: Real,
    to_centre: Floats,
) -> None:
    """Through V = J W L and the projected centre (u, v) to the centre in the world."""
    k00, k01, k11 = camera[INTRINSICS], camera[INTRINSICS + 1], camera[INTRINSICS + 3]
    inverse = np.float32(1.0) / z
    to_slope_x = to_slope_y = to_z = np.float32(0.0)
    # J W = K2 (W_xy - slope W_z) / z, with K2 the upper left of K.
    for j in range(3):
        to_0 = to_image[0, 0] * axes[j, 0] + to_image[0, 1] * axes[j, 1] + to_image[0, 2] * axes[j, 2]
        to_1 = to_image[1, 0] * axes[j, 0] + to_image[1, 1] * axes[j, 1] + to_image[1, 2] * axes[j, 2]
        to_slope_x -= k00 * to_0 * camera[6 + j] * inverse
        to_slope_y -= (k01 * to_0 + k11 * to_1) * camera[6 + j] * inverse
        to_z -= (to_0 * frame[0, j] + to_1 * frame[1, j]) * inverse
    if slope_x != x / z:  # held at the margin of the image
        to_slope_x = np.float32(0.0)
    if slope_y != y / z:
        to_slope_y = np.float32(0.0)
    to_slope_x += k00 * to_u
    to_slope_y += k01 * to_u + k11 * to_v
    to_x, to_y = to_slope_x * inverse, to_slope_y * inverse
    to_z -= (to_slope_x * x + to_slope_y * y) * inverse * inverse
    for j in range(3):
        to_centre[j] = camera[j] * to_x + camera[3 + j] * to_y + camera[6 + j] * to_z
