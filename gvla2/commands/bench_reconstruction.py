"""``gvla2 bench suite=reconstruction``: the ablation rows on every object."""

from __future__ import annotations

import logging
from collections.abc import Container, Iterator, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from omegaconf import OmegaConf

from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import BenchRun, code_of, in_a_worker, pictured
from gvla2.commands.run import GEOMETRY
from gvla2.component import described
from gvla2.errors import ConfigurationError, Gvla2Error, MissingDependencyError
from gvla2.plugins.registry import Registry

if TYPE_CHECKING:
    from gvla2.evaluation.ablation import AblationParts, Measured, Wanted
    from gvla2.evaluation.datasets import Dataset, Item
    from gvla2.evaluation.judge import ReconstructionJudge
    from gvla2.evaluation.lpips import Lpips
    from gvla2.evaluation.results import Cell
    from gvla2.reconstruction.contracts import Renderer

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

_NAMED = ("object", "baseline", "drift", "noise", "variant")
"""What names a picture."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ObjectUnit:
    """One process's unit of work: cells of one object and baseline, with pictures in ``folder/pictures``."""

    dataset: Dataset
    item: Item
    baseline: str
    wanted: tuple[Wanted, ...]
    config: BenchConfig
    folder: Path

    @property
    def rows(self) -> Sequence[str]:
        """The keys of its cells."""
        return [want.key for want in self.wanted]

    @property
    def label(self) -> str:
        """The object and the baseline."""
        return f"{self.item.name}, {self.baseline}"

    def without(self, known: Container[str]) -> ObjectUnit:
        """The unit without the cells that are known."""
        return replace(self, wanted=tuple(want for want in self.wanted if want.key not in known))


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
        typed = [registry.configure(root, kind)[0] for kind in GEOMETRY]
        options = dict(zip(GEOMETRY, map(asdict, typed), strict=True))
        chosen[baseline, seed, noise] = options, code_of(typed, *MEASURING_CODE)
    weights = (lpips, config.lpips_weights, config.surface_samples)
    protocol = (VERSION, dataset.size, dataset.samples, *weights)
    parts = {kind: described(getattr(config, kind)) for kind in ("axis", "fusion", "renderer")}
    parts |= {"protocol": told} if (told := _protocol_label(config)) else {}
    for item in dataset.items:
        print_of_files = item.fingerprint()
        for baseline in baselines:
            wanted = []
            for seed, noise, drift, variant in product(seeds, noises, drifts, variants):
                factors: dict[str, str | int] = {
                    "data": dataset.kind,
                    "object": item.name,
                    "baseline": _baseline_label(config, baseline),
                    "drift": drift,
                    "variant": variant,
                    "seed": seed,
                    "prior": _prior_label(config),
                    # A caption's words for a prior's noise: its name if it was drawn.
                    "noise": {"depth": noise, "none": "none"}.get(config.prior.name, "its own"),
                    **parts,
                    "mode": config.mode,
                    "compat": config.compat,
                }
                key = cell_key(SUITE, factors, chosen[baseline, seed, noise], protocol, print_of_files)
                wanted.append(Wanted(key, factors))
            yield ObjectUnit(dataset, item, baseline, tuple(wanted), config, bench.folder)


def _baseline_label(config: BenchConfig, baseline: str) -> str:
    given = config.baseline_options.get(baseline) or {}
    told = ", ".join(f"{name}={value}" for name, value in sorted(given.items()))
    return f"{baseline} ({told})" if told else baseline


def _prior_label(config: BenchConfig) -> str:
    """The prior but for its noise and seed, which are factors of their own."""
    own = {field.name for field in fields(config.prior)} - {"noise", "seed"}
    return described(config.prior, only=own)


def _protocol_label(config: BenchConfig) -> str:
    """How the measuring differs from the protocol; "" where it does not."""
    usual = BenchConfig()
    changed = {
        "surface_samples": (config.surface_samples, usual.surface_samples),
        "lpips_weights": (config.lpips_weights, usual.lpips_weights),
        "size": (config.data.size, usual.data.size),
        "samples": (config.data.samples, usual.data.samples),
    }
    return ", ".join(f"{name}={value}" for name, (value, default) in changed.items() if value != default)


def chosen_parts(
    config: BenchConfig, registry: Registry, baseline: str, seed: int, noise: str
) -> dict[str, Any]:
    """What to build; a reconstructor and a prior with a ``seed`` option get it, ``depth`` its noise."""
    from gvla2.evaluation.prior_noise import NOISES

    options = {"name": baseline, **dict(config.baseline_options.get(baseline) or {})}
    if "seed" in {field.name for field in fields(registry.get("reconstructor", baseline).config)}:
        options["seed"] = seed
    prior: Any = config.prior
    if prior.name == "depth":
        plain = OmegaConf.to_container(OmegaConf.structured(prior) if is_dataclass(prior) else prior)
        assert isinstance(plain, dict)
        prior = {**plain, **NOISES[noise][1], "seed": seed}
    return {
        "reconstructor": options,
        "prior": prior,
        "axis": config.axis,
        "fusion": config.fusion,
        "renderer": config.renderer,
    }


def lpips_of(path: str | None) -> Lpips | None:
    """LPIPS with a user's own weights, or those of the cache; None when the cache has none.

    Raises :class:`Gvla2Error` when the given file cannot be used.
    """
    from gvla2.evaluation.lpips import Lpips
    from gvla2.evaluation.lpips_weights import read_weights

    if path is not None:
        return Lpips(read_weights(Path(path).expanduser()))
    try:
        return Lpips()
    except MissingDependencyError:
        return None


def measure_unit(unit: ObjectUnit, registry: Registry) -> list[Cell]:
    """The unit's cells; an object that cannot be loaded gives cells that say so.

    A worker process first runs a refined cell unmeasured, once per baseline, so that loading compiled code is not
    timed.
    """
    if in_a_worker() and unit.wanted and unit.baseline not in _warmed():
        _warmed().add(unit.baseline)
        refined = (want for want in unit.wanted if want.factors["variant"] == "ab_fusion")
        _measured(replace(unit, wanted=(next(refined, unit.wanted[0]),)), registry)
    measured = _measured(unit, registry)
    return [pictured(m.cell, m.picture, unit.folder, "-".join(m.cell.told(*_NAMED))) for m in measured]


def _measured(unit: ObjectUnit, registry: Registry) -> list[Measured]:
    from gvla2.evaluation.ablation import AblationParts, Measured, failed, measure_object
    from gvla2.evaluation.judge import ReconstructionJudge
    from gvla2.reconstruction.branch import BranchOptions

    config = unit.config
    try:
        views = unit.dataset.load(unit.item)
    except Gvla2Error as error:
        return [Measured(failed(want, error)) for want in unit.wanted]
    built: dict[tuple[str, str], Any] = {}

    def parts_for(seed: int, noise: str) -> AblationParts:
        """The components for a seed and a noise, each built once for its options: one G0 serves all priors."""
        root = chosen_parts(config, registry, unit.baseline, seed, noise)
        for kind in GEOMETRY:
            if (kind, repr(root[kind])) not in built:
                built[kind, repr(root[kind])] = registry.build(root, kind)
        return AblationParts(**{kind: built[kind, repr(root[kind])] for kind in GEOMETRY})

    def judge_for(renderer: Renderer) -> ReconstructionJudge:
        threads = 1 if in_a_worker() else -1
        return ReconstructionJudge(
            views, renderer, lpips_of(config.lpips_weights), threads, config.surface_samples
        )

    options = BranchOptions(
        mode=cast(Literal["default", "paper"], config.mode),
        compat=cast(Literal["none", "official"], config.compat),
    )
    return list(measure_object(views, unit.wanted, parts_for, judge_for, options))


@cache
def _warmed() -> set[str]:
    """The baselines that this process has run; empty at first."""
    return set()
