"""How long four depth cameras take: python tests/benchmarks/camera.py [repeats]."""

from __future__ import annotations

import statistics
import sys
import time

import numpy as np
import trimesh

from gvla2.geometry.camera import Camera
from gvla2.geometry.raycast import RayCaster, Surface
from gvla2.geometry.transform import look_along, rigid

LINKS, OBJECTS, TABLE_TOP = 12, 5, 0.752


def build_surfaces() -> list[Surface]:
    """A table, twelve links of about 1.5k triangles each, two larger shells and five objects: about 30k."""
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((1.2, 1.6, 0.04))]
    for _ in range(LINKS):
        link = trimesh.creation.capsule(height=0.18, radius=0.06, count=[28, 28])
        meshes.append(link)
    meshes += [trimesh.creation.icosphere(subdivisions=4, radius=0.04) for _ in range(2)]
    meshes += [trimesh.creation.box((0.05, 0.05, 0.05)) for _ in range(OBJECTS)]
    return [Surface(m.vertices, m.faces, rng.uniform(0.2, 0.9, 3), i) for i, m in enumerate(meshes)]


def poses(phase: float) -> dict[int, np.ndarray]:
    """An arm-like chain that sways with ``phase``, the objects on the table."""
    where = {0: rigid(translation=(0.25, 0.0, TABLE_TOP - 0.02))}
    for k in range(LINKS):
        along = k / (LINKS - 1)
        height = TABLE_TOP + 0.1 + 0.65 * np.sin(np.pi * 0.6 * along)
        where[1 + k] = rigid(translation=(-0.27 + 0.55 * along, 0.05 * np.sin(phase + along), height))
    for k in range(2 + OBJECTS):
        where[1 + LINKS + k] = rigid(translation=(0.3 + 0.04 * k, -0.2 + 0.08 * k, TABLE_TOP + 0.03))
    return where


def build_cameras(size: int = 256) -> list[Camera]:
    """Front, two shoulders and a wrist."""
    fov = np.deg2rad(40.0)
    placed = {
        "front": ((1.35, 0.0, 1.58), (-0.906, 0.0, -0.423), fov),
        "left": ((-0.175, 0.2, 1.98), (0.416, -0.073, -0.906), fov),
        "right": ((-0.175, -0.2, 1.98), (0.416, 0.073, -0.906), fov),
        "wrist": ((0.279, 0.0, 1.3), (0.0, 0.0, -1.0), np.deg2rad(60.0)),
    }
    return [Camera.from_fov(f, look_along(p, d), size, size, name) for name, (p, d, f) in placed.items()]


def main(repeats: int = 15) -> None:
    """Print the medians in milliseconds."""
    surfaces, cameras = build_surfaces(), build_cameras()
    start = time.perf_counter()
    caster = RayCaster(surfaces)
    caster.cast(cameras[:1], poses(0.0))
    print(f"triangles             {sum(len(s.faces) for s in surfaces):8d}")
    print(f"build, once           {1e3 * (time.perf_counter() - start):8.1f} ms")
    spent = []
    for k in range(repeats):
        moved = poses(0.1 * k)
        start = time.perf_counter()
        images = caster.cast(cameras, moved)
        spent.append(1e3 * (time.perf_counter() - start))
    print(f"4 cameras 256x256     {statistics.median(spent):8.1f} ms   (poses changed before each)")
    print(f"pixels hit            {np.mean([np.isfinite(i.depth).mean() for i in images]):8.2f}")


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:]))
