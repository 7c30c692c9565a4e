"""The suite ``reconstruction``: the rows of the branch's ablation on every object of a data set."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from gvla2.component import described
from gvla2.errors import ConfigurationError, Gvla2Error, MissingDependencyError
from gvla2.evaluation.ablation import DRIFTS, NOISES, VARIANTS, AblationComponents, Wanted, measure_object
from gvla2.evaluation.comparison import Measure, TableLayout, comparison_sheets
from gvla2.evaluation.components import changed_options, code_of, given_label
from gvla2.evaluation.config import ReconstructionBench
from gvla2.evaluation.datasets import Dataset, Item, open_dataset
from gvla2.evaluation.engine import Rows, Suite, Unit, in_a_worker
from gvla2.evaluation.lpips import Lpips, read_weights
from gvla2.evaluation.metrics import ReconstructionJudge
from gvla2.evaluation.protocol import VERSION
from gvla2.evaluation.results import Cell, cell_key
from gvla2.evaluation.tables import Sheet
from gvla2.io.files import write_bytes
from gvla2.plugins.assembly import GEOMETRY
from gvla2.plugins.registry import Registry
from gvla2.reconstruction.contracts import Renderer

LAYOUT = TableLayout(
    title="Reconstruction",
    row="variant",
    labels={
        "baseline": "G0 (baseline, no prior)",
        "carving": "carving with the same prior",
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
        Measure("lpips", "LPIPS", "lower", 4),
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
        "mesh itself, the best that a prior can be. Seeds draw the drift, the prior's noise and the "
        "order of splat's views: ± 0.00 if none of them applies. CD surface is the mean distance of surface "
        "samples, both ways, with position and scale, and never 0: the truth sampled twice lies some thousandths from "
        "itself, more with fewer samples; CD official that of all vertices, each shape scaled to its own "
        "box, which a speck beside the object stretches. Seconds are wall time: the first row's for the reconstruction "
        "of G0, any other row's only for what follows."
    ),
)
MEASURING_CODE = (
    "gvla2.geometry",
    "gvla2.reconstruction",
    *(f"gvla2.evaluation.{name}" for name in ("ablation", "datasets", "lpips", "metrics", "protocol")),
)
"""Code whose change outdates stored rows, besides the chosen plugins."""
_PICTURE_NAME = ("object", "baseline", "drift", "noise", "variant")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ObjectUnit(Unit):
    """Cells of one object and baseline, with pictures in ``folder/pictures``."""

    dataset: Dataset
    item: Item
    baseline: str
    wanted: tuple[Wanted, ...]
    config: ReconstructionBench
    folder: Path


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
        wanted = tuple(want for want in unit.wanted if want.key not in rows)
        return replace(unit, wanted=wanted, keys=tuple(want.key for want in wanted))

    @staticmethod
    def measure(unit: ObjectUnit, registry: Registry) -> Iterator[Cell]:
        """The unit's cells; an object that cannot be loaded gives cells that say so.

        A worker process first runs a refined cell unmeasured, once per baseline, so that loading compiled code is not
        timed.
        """
        if in_a_worker() and unit.wanted and unit.baseline not in _warmed():
            _warmed().add(unit.baseline)
            refined = (want for want in unit.wanted if want.factors["variant"] == "ab_fusion")
            list(_measured(replace(unit, wanted=(next(refined, unit.wanted[0]),)), registry))
        for cell, picture in _measured(unit, registry):
            if picture is not None:
                path = unit.folder / "pictures" / f"{'-'.join(cell.texts(*_PICTURE_NAME))}.png"
                cell = replace(
                    cell, notes={**cell.notes, "picture": str(write_bytes(path, picture).absolute())}
                )
            yield cell

    @staticmethod
    def sheets(cells: Sequence[Cell]) -> list[Sheet]:
        """The ablation's table for each group of cells that can be compared."""
        return comparison_sheets(cells, LAYOUT)

    def _units(self, dataset: Dataset) -> Iterator[ObjectUnit]:
        config, registry = self.config, self.registry
        lpips = lpips_of(config.lpips_weights) is not None
        if not lpips:
            log.warning(
                "LPIPS is not measured: its weights are absent. Fetch them with: gvla2 data fetch=[lpips]"
            )
        baselines, seeds = list(dict.fromkeys(config.baselines)), list(dict.fromkeys(config.seeds))
        noises, drifts = list(dict.fromkeys(config.noise)), list(dict.fromkeys(config.drifts))
        variants = list(dict.fromkeys(config.variants or VARIANTS))
        chosen: dict[tuple[str, int, str], tuple[Any, ...]] = {}
        for baseline, seed, noise in product(baselines, seeds, noises):
            root = chosen_components(config, registry, baseline, seed, noise)
            typed = [registry.configure(root, kind)[0] for kind in GEOMETRY]
            chosen[baseline, seed, noise] = list(map(asdict, typed)), code_of(typed, *MEASURING_CODE)
        weights = (lpips, config.lpips_weights, config.surface_samples)
        protocol = (VERSION, dataset.size, dataset.samples, *weights, asdict(config.branch))
        shared = {kind: described(getattr(config, kind)) for kind in ("axis", "fusion", "renderer")}
        shared |= {"protocol": label} if (label := _protocol_label(config)) else {}
        for item in dataset.items:
            fingerprint = item.fingerprint()
            for baseline in baselines:
                wanted = []
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
                    wanted.append(Wanted(key, factors))
                keys = tuple(want.key for want in wanted)
                label = f"{item.name}, {baseline}"
                yield ObjectUnit(keys, label, dataset, item, baseline, tuple(wanted), config, self.folder)


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
    own = changed_options(config, ("surface_samples", "lpips_weights"))
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


def lpips_of(path: str | None) -> Lpips | None:
    """LPIPS with a user's own weights, or those of the cache; None when the cache has none.

    Raises :class:`Gvla2Error` when the given file cannot be used.
    """
    if path is not None:
        return Lpips(read_weights(Path(path).expanduser()))
    try:
        return Lpips()
    except MissingDependencyError:
        return None


def _measured(unit: ObjectUnit, registry: Registry) -> Iterator[tuple[Cell, bytes | None]]:
    config = unit.config
    try:
        views = unit.dataset.load(unit.item)
    except Gvla2Error as error:
        yield from ((want.failed(error), None) for want in unit.wanted)
        return
    built: dict[tuple[str, str], Any] = {}

    def components_for(seed: int, noise: str) -> AblationComponents:
        """The components for a seed and a noise, each built once for its options: one G0 serves all priors."""
        root = chosen_components(config, registry, unit.baseline, seed, noise)
        for kind in GEOMETRY:
            if (kind, repr(root[kind])) not in built:
                built[kind, repr(root[kind])] = registry.build(root, kind)
        return AblationComponents(**{kind: built[kind, repr(root[kind])] for kind in GEOMETRY})

    def judge_for(renderer: Renderer) -> ReconstructionJudge:
        threads = 1 if in_a_worker() else -1
        lpips = lpips_of(config.lpips_weights)
        return ReconstructionJudge(views, renderer, lpips, threads, config.surface_samples)

    yield from measure_object(views, unit.wanted, components_for, judge_for, config.branch)


@cache
def _warmed() -> set[str]:
    """The baselines that this process has run; empty at first."""
    return set()
