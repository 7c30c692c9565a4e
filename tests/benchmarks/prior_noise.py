"""Chamfer distance against a prior's noise, in a minute or two: hull, carving, aligned TSDF and the branch's volume.

    python tests/benchmarks/prior_noise.py [NOISE ...] [--objects a,b] [--held] [--rows carve,tsdf,ours,truth]

By default the ten development scans, on which constants may be chosen; ``--held`` takes the other twenty. The row
``truth`` is the true mesh itself, sampled anew: no reconstruction can be told from it below that.
"""

from __future__ import annotations

import argparse
import pickle
import sys
import time

import numpy as np

from gvla2.evaluation.datasets import open_dataset
from gvla2.evaluation.metrics import Truth, cd_surface
from gvla2.evaluation.volume_baselines import aligned_tsdf, carved, mesh_of
from gvla2.io.array_cache import cache_folder
from gvla2.reconstruction.carving import carve
from gvla2.reconstruction.contracts import GeometryEstimate
from gvla2_plugins.depth_prior import LearnedNoise
from gvla2_plugins.depth_prior.noise import learned, sensor

CLEAN = {"global_scale": 0.0, "low_frequency": 0.0, "pose_degrees": 0.0, "pose_shift": 0.0, "edge_blur": 0.0}
NOISES = {
    "exact": None,
    "low1": {**CLEAN, "low_frequency": 0.01},
    "low2": {**CLEAN, "low_frequency": 0.02},
    "low1long": {**CLEAN, "low_frequency": 0.01, "correlation": 0.2},
    "low1short": {**CLEAN, "low_frequency": 0.01, "correlation": 0.05},
    "view3": {**CLEAN, "view_scale": 0.03},
    "view10": {**CLEAN, "view_scale": 0.10},
    "slope20": {**CLEAN, "slope": 0.20},
    "vggt": {},
    "vggt_out": {"outliers": 0.03},
    "sensor": "sensor",
}


def estimate(views, noise, seed):
    depth = np.stack([view.depth for view in views]).astype(float)
    rng = np.random.default_rng(seed)
    poses = np.stack([view.camera.world_from_camera for view in views])
    if noise is None:
        sure, moved = np.isfinite(depth).astype(float), None
    elif noise == "sensor":
        depth, moved = sensor(depth, 0.0009, 0.0016, 0.01, rng), None
        sure = np.isfinite(depth).astype(float)
    else:
        depth, sure, moved = learned(depth, poses, LearnedNoise(**noise), rng)
    return GeometryEstimate(depth.astype(np.float32), sure.astype(np.float32), moved)


def prepared(item, dataset):
    """The item's views, G0 and truth, kept on disk."""
    kept = cache_folder() / "prior_noise" / f"{item.name}.pickle"
    if kept.is_file():
        return pickle.loads(kept.read_bytes())
    views = dataset.load(item)
    made = views.inputs, carve(views.inputs, 96).to_reconstruction(15000), views.mesh
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_bytes(pickle.dumps(made))
    return made


def main() -> None:
    from gvla2.reconstruction.branch import agreed
    from gvla2.reconstruction.view_set import ViewSet

    parser = argparse.ArgumentParser()
    parser.add_argument("noises", nargs="*", default=["low1"])
    parser.add_argument("--objects", default="")
    parser.add_argument("--held", action="store_true")
    parser.add_argument("--rows", default="carve,tsdf,ours")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    dataset = open_dataset("ycb30", None, tuple(filter(None, args.objects.split(","))))
    items = [i for n, i in enumerate(dataset.items) if args.objects or (n % 3 == 0) != args.held]
    rows = args.rows.split(",")
    for noise in args.noises:
        table = []
        print(f"== {noise}", flush=True)
        for item in items:
            views, g0, mesh = prepared(item, dataset)
            truth = Truth.of(mesh, 20_000)
            prior = estimate(views, NOISES[noise], args.seed + sum(map(ord, item.name)))
            found = {"g0": cd(g0.mesh, truth)}
            for row in rows:
                began = time.perf_counter()
                if row == "truth":
                    made = mesh
                elif row == "carve":
                    made = carved(views, prior)
                elif row == "tsdf":
                    made = aligned_tsdf(views, prior)
                else:
                    made = mesh_of(agreed(prior, ViewSet(views), g0.mesh)[1].field)
                spent = time.perf_counter() - began
                found[row] = cd(made, truth) if made is not None and len(made.faces) else found["g0"]
            table.append(list(found.values()))
            print(
                f"{item.name:20s} " + "  ".join(f"{k} {v:6.2f}" for k, v in found.items()),
                f"{spent:.1f}s",
                flush=True,
            )
        t = np.array(table)
        change = 100 * (t.mean(0) / t.mean(0)[0] - 1)
        worst = 100 * (t / t[:, :1] - 1).max(0)
        print(
            "MEAN                 "
            + "  ".join(
                f"{k} {v:6.2f} {c:+.0f}% (worst {w:+.0f}%)"
                for k, v, c, w in zip(found, t.mean(0), change, worst, strict=True)
            ),
            flush=True,
        )
        if "carve" in found and "ours" in found:
            names = list(found)
            wins = (t[:, names.index("ours")] <= t[:, names.index("carve")]).mean()
            print(f"ours <= carve on {100 * wins:.0f} %", flush=True)


def cd(mesh, truth):
    return cd_surface(mesh.sample(20_000, np.random.default_rng(1))[0], truth, 1)


if __name__ == "__main__":
    sys.exit(main())
