"""``gvla2 bench suite=reconstruction``: the five ablation rows on every object."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.catalog import Registry
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_measuring import KINDS, Unit, chosen_parts, lpips_of, measure_there, measure_unit
from gvla2.commands.bench_progress import BenchProgress
from gvla2.commands.bench_workers import in_processes, workers_for
from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.evaluation.ablation import Measured
    from gvla2.evaluation.datasets import Dataset
    from gvla2.evaluation.results import Cell, Results

MEASURING_CODE = (
    "gvla2.geometry",
    "gvla2.reconstruction",
    *(
        f"gvla2.evaluation.{name}"
        for name in (
            "ablation", "datasets", "drift", "gso_truth", "judge", "lpips", "metrics", "prior_noise", "protocol",
            "textured_mesh", "textured_raycast", "texturing", "volume_baselines",
        )
    ),
)  # fmt: skip
"""Code whose change makes stored rows out of date, besides the plugins that were chosen."""

log = logging.getLogger(__name__)


def run(config: BenchConfig, registry: Registry, results: Results, run_id: int, folder: Path) -> list[Cell]:
    """Measure what the database lacks; all cells of the design, in its order. Pictures go to ``folder/pictures``.

    Every finished object is stored at once, so that an interrupted bench goes on where it stopped.
    """
    from gvla2.evaluation.ablation import SUITE
    from gvla2.evaluation.datasets import open_dataset

    data = config.data
    dataset = open_dataset(data.kind, data.root, data.objects, size=data.size, samples=data.samples)
    _check_names(config)
    units = list(_design(config, registry, dataset))
    keys = [want.key for unit in units for want in unit.wanted]
    known = {} if config.results.fresh else results.with_keys(keys)
    known = {key: cell for key, cell in known.items() if cell.notes.get("status") == "ok"}
    missing = [_without(unit, known) for unit in units]
    missing = [unit for unit in missing if unit.wanted]
    if known:
        log.info("%d of %d cells are in %s already.", len(known), len(keys), results.url)
    total = sum(len(unit.wanted) for unit in missing)
    with BenchProgress(total, config.quiet) as progress:
        for unit, measured in _measure(missing, registry, config.workers):
            cells = [_keep_picture(one, unit, folder) for one in measured]
            results.add(run_id, SUITE, cells)
            known |= {cell.key: cell for cell in cells}
            progress.done(len(cells), f"{unit.item.name}, {unit.baseline}")
    return [known[key] for key in keys]


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
            "depth_noise is the robot's cameras'; of the suite reconstruction, noise=[...] says what the prior has "
            f"wrong. Available: {', '.join(NOISES)}."
        )
    lists = (
        ("variant", config.variants, VARIANTS), ("drift", config.drifts, DRIFTS), ("noise", config.noise, NOISES),
    )  # fmt: skip
    for what, asked, there in lists:
        for name in asked:
            if name not in there:
                raise ConfigurationError(f"No {what} '{name}'. Available: {', '.join(there)}.")


def _design(config: BenchConfig, registry: Registry, dataset: Dataset) -> Iterator[Unit]:
    """Every cell of the design with its key, one unit an object and baseline."""
    from gvla2.evaluation.ablation import SUITE, VARIANTS, Wanted
    from gvla2.evaluation.protocol import VERSION
    from gvla2.evaluation.provenance import code_digest
    from gvla2.evaluation.results import cell_key

    lpips = lpips_of(config.lpips_weights) is not None
    if not lpips:
        log.warning(
            "LPIPS is not measured: its weights are absent. Fetch them with: gvla2 data fetch=[lpips]"
        )
    chosen: dict[tuple[str, int, str], tuple[dict[str, Any], str]] = {}
    for baseline in dict.fromkeys(config.baselines):
        for seed, noise in product(dict.fromkeys(config.seeds), dict.fromkeys(config.noise)):
            root = chosen_parts(config, registry, baseline, seed, noise)
            typed = [registry.configure(root, kind)[0] for kind in KINDS]
            code = code_digest((*MEASURING_CODE, *sorted({type(one).__module__ for one in typed})))
            chosen[baseline, seed, noise] = dict(zip(KINDS, map(asdict, typed), strict=True)), code
    for item in dataset.items:
        print_of_files = item.fingerprint()
        for baseline in dict.fromkeys(config.baselines):
            wanted = []
            for seed, noise in product(dict.fromkeys(config.seeds), dict.fromkeys(config.noise)):
                for drift in dict.fromkeys(config.drifts):
                    for variant in dict.fromkeys(config.variants or VARIANTS):
                        factors: dict[str, str | int] = {
                            "data": dataset.kind,
                            "object": item.name,
                            "baseline": baseline,
                            "drift": drift,
                            "variant": variant,
                            "seed": seed,
                            "prior": config.prior.name,
                            "noise": _noise_name(config.prior.name, noise),
                            "axis": config.axis.name,
                            "fusion": config.fusion.name,
                            "renderer": config.renderer.name,
                            "mode": config.mode,
                            "compat": config.compat,
                        }
                        protocol = (
                            VERSION,
                            dataset.size,
                            dataset.samples,
                            lpips,
                            config.lpips_weights,
                            config.surface_samples,
                        )
                        key = cell_key(
                            SUITE, factors, chosen[baseline, seed, noise], protocol, print_of_files
                        )
                        wanted.append(Wanted(key, factors))
            yield Unit(dataset, item, baseline, tuple(wanted), config)


def _noise_name(prior: str, noise: str) -> str:
    """What a caption says of a prior's noise: its name where it was drawn."""
    return {"depth": noise, "none": "none"}.get(prior, "its own")


def _without(unit: Unit, known: Mapping[str, Cell]) -> Unit:
    left = tuple(want for want in unit.wanted if want.key not in known)
    return replace(unit, wanted=left)


def _measure(units: Sequence[Unit], registry: Registry, asked: int) -> Iterator[tuple[Unit, list[Measured]]]:
    workers = workers_for(asked, len(units))
    if workers == 1:
        for unit in units:
            yield unit, measure_unit(unit, registry)
    else:
        yield from in_processes(measure_there, units, workers)


def _keep_picture(measured: Measured, unit: Unit, folder: Path) -> Cell:
    """Store the cell's picture, if any, and note its path."""
    from gvla2.record.files import write_bytes

    cell = measured.cell
    if measured.picture is None:
        return cell
    factors = cell.factors
    name = "-".join(str(factors[part]) for part in ("object", "baseline", "drift", "noise", "variant"))
    path = write_bytes(folder / "pictures" / f"{name}.png", measured.picture)
    return replace(cell, notes={**cell.notes, "picture": str(path.absolute())})
