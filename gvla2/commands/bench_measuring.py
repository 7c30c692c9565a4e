"""Measuring one object of the reconstruction suite: building the components, loading the data, judging."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from omegaconf import OmegaConf

from gvla2.catalog import Registry
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_frame import in_a_worker, pictured
from gvla2.errors import Gvla2Error, MissingDependencyError

if TYPE_CHECKING:
    from gvla2.evaluation.ablation import AblationParts, Measured, Wanted
    from gvla2.evaluation.datasets import Dataset, Item
    from gvla2.evaluation.judge import ReconstructionJudge
    from gvla2.evaluation.lpips import Lpips
    from gvla2.evaluation.results import Cell
    from gvla2.reconstruction.contracts import Renderer

KINDS = ("reconstructor", "prior", "axis", "fusion", "renderer")
_NAMED = ("object", "baseline", "drift", "noise", "variant")
"""What names a picture."""


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
        for kind in KINDS:
            if (kind, repr(root[kind])) not in built:
                built[kind, repr(root[kind])] = registry.build(root, kind)
        return AblationParts(**{kind: built[kind, repr(root[kind])] for kind in KINDS})

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
