"""From gradients at ellipses in the image back to the Gaussians: numba kernels, float32."""

from __future__ import annotations

import math

import numpy as np

from gvla2.reconstruction.compiled import Floats, Ints, Real, compiled
from gvla2.reconstruction.rasteriser_projection import (
    CONIC_A,
    CONIC_B,
    CONIC_C,
    INTRINSICS,
    OPACITY,
    RED,
    SH_C0,
    gaussian_axes,
    image_axes,
    to_camera,
)


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

    ``partial`` (entries, 9) holds the sums of ``rasteriser_compositing.composite_back``, one row for each tile of each
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
