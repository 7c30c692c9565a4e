"""The suite ``reconstruction``: the rows of the branch's ablation on every object of a data set."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from itertools import product
from typing import Any

from omegaconf import OmegaConf

from gvla2.component import described
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.ablation import DRIFTS, NOISES, Drift, refined_row
from gvla2.evaluation.comparison import Measure, TableLayout, comparison_sheets
from gvla2.evaluation.components import changed_options, code_of, given_label
from gvla2.evaluation.config import ReconstructionBench
from gvla2.evaluation.datasets import Dataset, Item, open_dataset
from gvla2.evaluation.engine import Rows, Suite, Unit, in_a_worker
from gvla2.evaluation.metrics import MEASURES, ReconstructionJudge
from gvla2.evaluation.protocol import VERSION
from gvla2.evaluation.results import Cell, Run, cell_key
from gvla2.evaluation.tables import Sheet
from gvla2.plugins.assembly import GEOMETRY
from gvla2.plugins.registry import Registry
from gvla2.reconstruction.branch import BranchComponents
from gvla2.reconstruction.contracts import Reconstruction, Reconstructor
from gvla2.reconstruction.options import REFERENCE, VARIANTS

LAYOUT = TableLayout(
    title="Reconstruction",
    row="variant",
    labels={
        "baseline": "baseline, no prior",
        "a_prior_appearance": "A: prior + appearance",
        "a_soft_hull": "A: + soft hull",
        "b_axis": "B: axis only (no prior)",
        "ab_fusion": "A + B fusion",
    },
    reference="baseline",
    measures=(
        Measure("cd_surface", "CD surface ×10³", "lower"),
        Measure("cd_official", "CD official ×10³", "lower"),
        Measure("psnr", "PSNR dB", "higher"),
        Measure("ssim", "SSIM", "higher", 4),
        Measure("seconds", "seconds", "lower", 2, compared=False),
    ),
    groups=(
        "data",
        "baseline",
        "drift",
        "prior",
        "noise",
        "axis",
        "fusion",
        "renderer",
        "branch",
        "protocol",
    ),
    explanation=(
        "Every row but the first and B has the prior that the title names; noise exact is depth ray cast from the true "
        "mesh itself, the best that a prior can be. Seeds draw the drift and the "
        "prior's noise: ± 0.00 if neither applies. CD surface is the mean distance of surface "
        "samples, both ways, with position and scale, and never 0: the truth sampled twice lies some thousandths from "
        "itself, more with fewer samples; CD official that of all vertices, each shape scaled to its own "
        "box, which a speck beside the object stretches. Seconds are wall time: the first row's for the reconstruction "
        "itself, any other row's only for what follows."
    ),
)
MEASURING_CODE = (
    "gvla2.geometry",
    "gvla2.reconstruction",
    "gvla2.evaluation.suites.reconstruction",
    *(f"gvla2.evaluation.{name}" for name in ("ablation", "datasets", "metrics", "protocol")),
)
"""Code whose change outdates stored rows, besides the chosen plugins."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ObjectUnit(Unit):
    """Cells of one object and baseline, with the ``factors`` of each key."""

    dataset: Dataset
    item: Item
    baseline: str
    factors: Mapping[str, Mapping[str, str | int]]
    config: ReconstructionBench


class ReconstructionSuite(Suite[ReconstructionBench, ObjectUnit]):
    """The ablation rows on every object: one unit of work for each object and baseline."""

    name = "reconstruction"
    title = LAYOUT.title

    def stages(self) -> Sequence[Sequence[ObjectUnit]]:
        """Every cell of the design with its key."""
        data = self.config.data
        dataset = open_dataset(data.kind, data.root, data.objects, size=data.size, samples=data.samples)
        _check_names(self.config)
        return [list(self._units(dataset))]

    def prepare(self, unit: ObjectUnit, rows: Rows) -> ObjectUnit:
        """The unit without the cells that are known."""
        return replace(unit, keys=tuple(key for key in unit.keys if key not in rows))

    @staticmethod
    def measure(unit: ObjectUnit, registry: Registry) -> Iterator[Cell]:
        """The unit's cells; a :class:`Gvla2Error` becomes a cell's ``status``, with no measures."""
        try:
            bench = ObjectBench(unit, registry)
        except Gvla2Error as error:
            yield from (_failed(unit, key, error) for key in unit.keys)
            return
        for key in unit.keys:
            try:
                yield bench.cell(key)
            except Gvla2Error as error:
                yield _failed(unit, key, error)

    @staticmethod
    def sheets(cells: Sequence[Cell], runs: Sequence[Run] = ()) -> list[Sheet]:
        """The ablation's table for each group of cells that can be compared."""
        return comparison_sheets(cells, LAYOUT)

    def _units(self, dataset: Dataset) -> Iterator[ObjectUnit]:
        config, registry = self.config, self.registry
        baselines, seeds = list(dict.fromkeys(config.baselines)), list(dict.fromkeys(config.seeds))
        noises, drifts = list(dict.fromkeys(config.noise)), list(dict.fromkeys(config.drifts))
        variants = list(dict.fromkeys(config.variants or VARIANTS))
        chosen: dict[tuple[str, int, str], tuple[Any, ...]] = {}
        for baseline, seed, noise in product(baselines, seeds, noises):
            root = chosen_components(config, registry, baseline, seed, noise)
            typed = [registry.configure(root, kind)[0] for kind in GEOMETRY]
            chosen[baseline, seed, noise] = list(map(asdict, typed)), code_of(typed, *MEASURING_CODE)
        protocol = (VERSION, dataset.size, dataset.samples, config.surface_samples, asdict(config.branch))
        shared = {kind: described(getattr(config, kind)) for kind in ("axis", "fusion", "renderer")}
        shared |= {"protocol": label} if (label := _protocol_label(config)) else {}
        for item in dataset.items:
            fingerprint = item.fingerprint()
            for baseline in baselines:
                cells: dict[str, dict[str, str | int]] = {}
                for seed, noise, drift, variant in product(seeds, noises, drifts, variants):
                    factors: dict[str, str | int] = {
                        "data": dataset.kind,
                        "object": item.name,
                        "baseline": given_label(baseline, config.baseline_options),
                        "drift": drift,
                        "variant": variant,
                        "seed": seed,
                        "prior": _prior_label(config),
                        # How a caption names a prior's noise: by its own name if it was drawn here.
                        "noise": {"depth": noise, "none": "none"}.get(config.prior.name, "its own"),
                        **shared,
                        "branch": config.branch.label(),
                    }
                    key = cell_key(self.name, factors, chosen[baseline, seed, noise], protocol, fingerprint)
                    cells[key] = factors
                label = f"{item.name}, {baseline}"
                yield ObjectUnit(tuple(cells), label, dataset, item, baseline, cells, config)


def _check_names(config: ReconstructionBench) -> None:
    if config.prior.name != "depth" and list(config.noise) != ["exact"]:
        raise ConfigurationError(
            f"noise={config.noise} is drawn on the views' own depth: it needs prior=depth, not {config.prior.name}."
        )
    for what, requested, available in (
        ("variant", config.variants, VARIANTS),
        ("drift", config.drifts, DRIFTS),
        ("noise", config.noise, NOISES),
    ):
        for name in requested:
            if name not in available:
                raise ConfigurationError(f"No {what} '{name}'. Available: {', '.join(available)}.")


def _prior_label(config: ReconstructionBench) -> str:
    """The prior but for its noise and seed, which are factors of their own."""
    own = {field.name for field in fields(config.prior)} - {"noise", "seed"}
    return described(config.prior, only=own)


def _protocol_label(config: ReconstructionBench) -> str:
    """How the measuring differs from the protocol; "" where it does not."""
    own = changed_options(config, ("surface_samples",))
    return ", ".join(filter(None, (own, changed_options(config.data, ("size", "samples")))))


def chosen_components(
    config: ReconstructionBench, registry: Registry, baseline: str, seed: int, noise: str
) -> dict[str, Any]:
    """What to build; a reconstructor and a prior with a ``seed`` option get it, ``depth`` its noise."""
    options = {"name": baseline, **dict(config.baseline_options.get(baseline) or {})}
    if "seed" in {field.name for field in fields(registry.get("reconstructor", baseline).config)}:
        options["seed"] = seed
    prior: Any = config.prior
    if prior.name == "depth":
        plain = OmegaConf.to_container(OmegaConf.structured(prior) if is_dataclass(prior) else prior)
        assert isinstance(plain, dict)
        prior = {**plain, **NOISES[noise], "seed": seed}
    same = {kind: getattr(config, kind) for kind in ("axis", "fusion", "renderer")}
    return {"reconstructor": options, "prior": prior, **same}


class ObjectBench:
    """Measures the cells of one object and baseline; raises :class:`Gvla2Error` for an object that cannot be loaded.

    Components are built once for their options, so that one G0 serves all priors; the true shape is prepared once.
    """

    def __init__(self, unit: ObjectUnit, registry: Registry) -> None:
        config, threads = unit.config, 1 if in_a_worker() else -1
        self._unit, self._registry = unit, registry
        self._views = unit.dataset.load(unit.item)
        self._built: dict[tuple[str, str], Any] = {}
        self._first: dict[int, tuple[Reconstruction, float]] = {}
        renderer = self._part("renderer", config.renderer)
        self._judge = ReconstructionJudge(self._views, renderer, threads, config.surface_samples)

    def cell(self, key: str) -> Cell:
        """One cell: the baseline's seconds are the reconstruction's; any other row's are only its own."""
        unit, views, factors = self._unit, self._views, self._unit.factors[key]
        drift, noise, variant = (str(factors[name]) for name in ("drift", "noise", "variant"))
        root = chosen_components(unit.config, self._registry, unit.baseline, int(factors["seed"]), noise)
        reconstructor, *parts = (self._part(kind, root[kind]) for kind in GEOMETRY)
        g0, seconds = self._reconstructed(reconstructor)
        size = DRIFTS[drift]
        start = g0 if size is None else Drift.drawn(size, views.name, int(factors["seed"])).applied(g0)
        began = time.perf_counter()
        made, notes = refined_row(variant, start, views.inputs, BranchComponents(*parts), unit.config.branch)
        if variant != REFERENCE:
            seconds = time.perf_counter() - began
        measures, points = self._judge.measure(made)
        notes = {"status": "ok", "cd_points": points, **notes}
        return Cell(key, factors, {**measures, "seconds": seconds}, notes)

    def _part(self, kind: str, options: Any) -> Any:
        """The component of these options, built once."""
        key = kind, repr(options)
        if key not in self._built:
            self._built[key] = self._registry.build({kind: options}, kind)
        return self._built[key]

    def _reconstructed(self, reconstructor: Reconstructor) -> tuple[Reconstruction, float]:
        """G0 and its seconds; a reconstructor runs once."""
        if id(reconstructor) not in self._first:
            began = time.perf_counter()
            made = reconstructor.reconstruct(self._views.inputs)
            if made is None:
                raise Gvla2Error(
                    "The reconstructor made nothing; choose baselines that reconstruct, such as hull."
                )
            self._first[id(reconstructor)] = made, time.perf_counter() - began
        return self._first[id(reconstructor)]


def _failed(unit: ObjectUnit, key: str, error: Exception) -> Cell:
    empty = dict.fromkeys((*MEASURES, "seconds"))
    return Cell(key, unit.factors[key], empty, {"status": f"failed: {error}"})
