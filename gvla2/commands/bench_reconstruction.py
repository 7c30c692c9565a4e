"""``gvla2 bench suite=reconstruction``: the ablation rows on every object."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import asdict
from itertools import product
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import BenchRun, code_of
from gvla2.commands.bench_measuring import KINDS, ObjectUnit, chosen_parts, lpips_of, measure_unit
from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.evaluation.datasets import Dataset
    from gvla2.evaluation.results import Cell

MEASURING_CODE = (
    "gvla2.geometry",
    "gvla2.reconstruction",
    *(
        f"gvla2.evaluation.{name}"
        for name in (
            "ablation", "datasets", "drift", "gso_truth", "judge", "lpips", "metrics", "prior_noise", "protocol",
            "textured_views", "volume_baselines",
        )
    ),
)  # fmt: skip
"""Code whose change outdates stored rows, besides the chosen plugins."""

log = logging.getLogger(__name__)


def run(bench: BenchRun) -> list[Cell]:
    """Measure what the database lacks, one object and baseline after another. Pictures go to ``folder/pictures``."""
    from gvla2.evaluation.datasets import open_dataset

    config, data = bench.config, bench.config.data
    dataset = open_dataset(data.kind, data.root, data.objects, size=data.size, samples=data.samples)
    _check_names(config)
    units = list(_design(bench, dataset))
    with bench.rows(units) as rows:
        rows.fill([unit.without(rows.known) for unit in units], measure_unit)
        return rows.of(units)


def _check_names(config: BenchConfig) -> None:
    from gvla2.evaluation.ablation import VARIANTS
    from gvla2.evaluation.drift import DRIFTS
    from gvla2.evaluation.prior_noise import NOISES

    if config.prior.name != "depth" and list(config.noise) != ["exact"]:
        raise ConfigurationError(
            f"noise={config.noise} is drawn on the views' own depth: it needs prior=depth, not {config.prior.name}."
        )
    if config.depth_noise.kind != "none":
        raise ConfigurationError(
            "depth_noise is the robot's cameras'; of the suite reconstruction, noise=[...] sets the prior's error. "
            f"Available: {', '.join(NOISES)}."
        )
    lists = (
        ("variant", config.variants, VARIANTS), ("drift", config.drifts, DRIFTS), ("noise", config.noise, NOISES),
    )  # fmt: skip
    for what, asked, there in lists:
        for name in asked:
            if name not in there:
                raise ConfigurationError(f"No {what} '{name}'. Available: {', '.join(there)}.")


def _design(bench: BenchRun, dataset: Dataset) -> Iterator[ObjectUnit]:
    """Every cell of the design with its key, one unit per object and baseline."""
    from gvla2.evaluation.ablation import SUITE, VARIANTS, Wanted
    from gvla2.evaluation.protocol import VERSION
    from gvla2.evaluation.results import cell_key

    config, registry = bench.config, bench.registry
    lpips = lpips_of(config.lpips_weights) is not None
    if not lpips:
        log.warning(
            "LPIPS is not measured: its weights are absent. Fetch them with: gvla2 data fetch=[lpips]"
        )
    baselines, seeds = list(dict.fromkeys(config.baselines)), list(dict.fromkeys(config.seeds))
    noises, drifts = list(dict.fromkeys(config.noise)), list(dict.fromkeys(config.drifts))
    variants = list(dict.fromkeys(config.variants or VARIANTS))
    chosen: dict[tuple[str, int, str], tuple[dict[str, Any], str]] = {}
    for baseline, seed, noise in product(baselines, seeds, noises):
        root = chosen_parts(config, registry, baseline, seed, noise)
        typed = [registry.configure(root, kind)[0] for kind in KINDS]
        options = dict(zip(KINDS, map(asdict, typed), strict=True))
        chosen[baseline, seed, noise] = options, code_of(typed, *MEASURING_CODE)
    weights = (lpips, config.lpips_weights, config.surface_samples)
    protocol = (VERSION, dataset.size, dataset.samples, *weights)
    parts = {kind: getattr(config, kind).name for kind in ("axis", "fusion", "renderer")}
    for item in dataset.items:
        print_of_files = item.fingerprint()
        for baseline in baselines:
            wanted = []
            for seed, noise, drift, variant in product(seeds, noises, drifts, variants):
                factors: dict[str, str | int] = {
                    "data": dataset.kind,
                    "object": item.name,
                    "baseline": baseline,
                    "drift": drift,
                    "variant": variant,
                    "seed": seed,
                    "prior": config.prior.name,
                    # A caption's words for a prior's noise: its name if it was drawn.
                    "noise": {"depth": noise, "none": "none"}.get(config.prior.name, "its own"),
                    **parts,
                    "mode": config.mode,
                    "compat": config.compat,
                }
                key = cell_key(SUITE, factors, chosen[baseline, seed, noise], protocol, print_of_files)
                wanted.append(Wanted(key, factors))
            yield ObjectUnit(dataset, item, baseline, tuple(wanted), config, bench.folder)
