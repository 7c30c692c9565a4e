"""How fast the mask-driven parts of the reconstruction branch are, beside the released code on the same arrays.

    python -m tests.benchmarks.reconstruction_speed [points=300000] [repeats=20] [peer=PATH]

``peer`` is a checkout of GeneralVLA-2, whose own functions are loaded from there; without it its column says
"not measured". Times are medians after one warm-up call, with the fastest in brackets.
"""

from __future__ import annotations

import importlib
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import trimesh

from gvla2.geometry.compiled import cores
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.views import Views
from gvla2.plugins.registry import load_plugins
from gvla2.reconstruction.branch import BranchComponents, refine_geometry
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.support import mask_support, object_centre, soft_hull
from gvla2.reconstruction.surfels import surfels
from tests.reconstruction.conftest import make_jug, views_of

SIZE, FOCAL = 256, 1.09375
SCRIPT = "GeoFuse-MV3D/scripts/soft_visual_hull_refine.py"


def load_peer(root: str | None) -> ModuleType | None:
    """The released soft hull script as a module; None without a checkout."""
    if root is None:
        return None
    path = Path(root) / SCRIPT
    if not path.is_file():
        raise SystemExit(f"peer={root} holds no {SCRIPT}: is it a checkout of GeneralVLA-2?")
    sys.path.insert(0, str(path.parent))
    return importlib.import_module(path.stem)


def milliseconds(body: Callable[[], object], repeats: int) -> tuple[float, float]:
    """Median and fastest of some calls after one that is not counted."""
    body()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        body()
        times.append(1e3 * (time.perf_counter() - began))
    return statistics.median(times), min(times)


def show(work: str, ours: tuple[float, float], peer: tuple[float, float] | None) -> None:
    theirs = f"{peer[0]:9.1f} [{peer[1]:8.1f}]" if peer else f"{'not measured':>20}"
    print(f"{work:44s} {ours[0]:9.2f} [{ours[1]:8.2f}] {theirs}")


def branch(count: int, views: Views, mesh: trimesh.Trimesh) -> None:
    """From G0 to the output with the depth of the views as prior, and what rendering costs."""
    names = {"prior": "depth", "axis": "contours", "fusion": "residual", "renderer": "numba"}
    parts = load_plugins().build_all({kind: {"name": name} for kind, name in names.items()}, tuple(names))
    swollen = TriangleMesh(mesh.vertices * [1.04, 0.96, 1.03], np.asarray(mesh.faces))
    g0 = Reconstruction(surfels(swollen, count=count), swollen, "ok")

    def whole() -> None:
        result = refine_geometry(g0, views, BranchComponents(*parts.values()))
        whole.stages = ", ".join(f"{s.stage} {s.status}" for s in result.stages)

    show(f"whole branch, {len(g0.gaussians)} Gaussians", milliseconds(whole, 3), None)
    print(f"{'':44s} {whole.stages}")


def main(arguments: list[str]) -> None:
    """Print one row a part."""
    options = dict(argument.split("=", 1) for argument in arguments)
    count, repeats = int(options.get("points", 300_000)), int(options.get("repeats", 20))
    peer = load_peer(options.get("peer"))
    mesh = make_jug()
    views = views_of(mesh, size=SIZE)
    points = np.ascontiguousarray(trimesh.sample.sample_surface(mesh, count, seed=0)[0])
    centre = object_centre(points)
    setting = f"{count} points, {len(views)} views of {SIZE} x {SIZE}, {cores()} cores"
    print(f"{setting}; ms, median [fastest]")
    print(f"{'':44s} {'gvla2':>20} {'released code':>20}")

    theirs = theirs_hull = None
    if peer is not None:
        masks = [view.mask for view in views]
        extrinsics = [view.camera.camera_from_world.astype(np.float32) for view in views]
        single = points.astype(np.float32)

        def score() -> np.ndarray:
            return peer.compute_support(single, masks, extrinsics, FOCAL, 2)[0]

        class Constants:
            support_threshold, support_softness, max_shrink = 0.45, 0.12, 0.008

        theirs = milliseconds(score, min(repeats, 5))
        theirs_hull = milliseconds(lambda: peer.refine_points(single, score(), Constants), min(repeats, 5))
    show("soft visual hull, scoring only", milliseconds(lambda: mask_support(points, views), repeats), theirs)
    ours = milliseconds(lambda: soft_hull(points, mask_support(points, views), centre), repeats)
    show("soft visual hull, scores and moved points", ours, theirs_hull)
    branch(count, views, mesh)


if __name__ == "__main__":
    main(sys.argv[1:])
