"""Real spherical harmonics of degree 1 to 3, in the order and with the signs of 3D Gaussian splatting."""

from __future__ import annotations

from typing import Any


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
