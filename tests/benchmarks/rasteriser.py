"""How long the CPU rasteriser takes: ``python tests/benchmarks/rasteriser.py``. Milliseconds, 256x256, warm."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from gvla2.geometry.camera import Camera
from gvla2.geometry.gaussians import SH_C0, Gaussians
from gvla2.geometry.transform import look_along
from gvla2.reconstruction.rasteriser import Rasteriser, backward, forward

CAMERA = Camera.from_fov(0.85, look_along([0.3, -1.7, 0.6], [-0.3, 1.7, -0.6]), 256, 256)


def surface(count: int, seed: int = 0) -> Gaussians:
    """An object of size one: flat Gaussians on a wavy ball, as wide as their spacing, in a grid-like order."""
    rng = np.random.default_rng(seed)
    z = np.linspace(-1, 1, count)
    turn = np.arange(count) * np.pi * (3 - np.sqrt(5))
    flat = np.sqrt(1 - z * z)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    centres = directions * (0.42 + 0.08 * np.sin(6 * directions).prod(axis=1, keepdims=True))
    spacing = np.sqrt(4 * np.pi * 0.42**2 / count)
    half = directions + np.array([0, 0, 1 + 1e-6])  # the half-way quaternion from z to the direction
    rotations = np.concatenate(
        [half[:, 2:], -half[:, 1:2], half[:, :1], np.zeros((count, 1))], axis=1
    ) / np.linalg.norm(half, axis=1, keepdims=True)
    scales = spacing * rng.uniform(0.5, 0.8, (count, 3)) * [1, 1, 0.4]
    rgb = 0.5 + 0.4 * np.sin(9 * directions)
    return Gaussians(centres, np.log(scales), rotations, np.full(count, 3.0), (rgb - 0.5) / SH_C0)


def milliseconds(work: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Least and median time of a call, after one that compiles."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - start))
    return min(times), float(np.median(times))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=15)
    arguments = parser.parse_args()
    rasteriser = Rasteriser()
    print(f"{'Gaussians':>9}  {'work':<20}{'least':>8}{'median':>8}")
    for count in (10_000, 20_000, 100_000, 300_000):
        gaussians = surface(count)
        image, alpha = rasteriser.render(gaussians, CAMERA)
        slope = np.sign(image - 0.5).astype(np.float32) / image.size

        def both(
            gaussians: Gaussians = gaussians, slope: np.ndarray = slope, alpha: np.ndarray = alpha
        ) -> None:
            backward(forward(gaussians, CAMERA, rasteriser=rasteriser), slope, alpha)

        for name, work in (
            ("render", lambda gaussians=gaussians: rasteriser.render(gaussians, CAMERA)),
            ("forward + backward", both),
        ):
            least, median = milliseconds(work, arguments.repeats)
            print(f"{count:>9}  {name:<20}{least:>8.1f}{median:>8.1f}")


if __name__ == "__main__":
    main()
