"""Measuring one object of the reconstruction suite: building the components, loading the data, judging."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

from omegaconf import OmegaConf

from gvla2.catalog import Registry, load_plugins
from gvla2.commands.bench_config import BenchConfig
from gvla2.errors import Gvla2Error, MissingDependencyError

if TYPE_CHECKING:
    from gvla2.evaluation.ablation import Measured, Parts, Wanted
    from gvla2.evaluation.datasets import Dataset, Item
    from gvla2.evaluation.judge import Judge
    from gvla2.evaluation.lpips import Lpips
    from gvla2.reconstruction.contracts import Renderer

KINDS = ("reconstructor", "prior", "axis", "fusion", "renderer")


@dataclass(frozen=True)
class Unit:
    """What one process does in one go: the missing cells of one object and baseline."""

    dataset: Dataset
    item: Item
    baseline: str
    wanted: tuple[Wanted, ...]
    config: BenchConfig


def chosen_parts(
    config: BenchConfig, registry: Registry, baseline: str, seed: int, noise: str
) -> dict[str, Any]:
    """What to build; a reconstructor and a prior that have a ``seed`` option get it, ``depth`` its noise."""
    from gvla2.evaluation.prior_noise import NOISES

    options = {"name": baseline, **dict(config.baseline_options.get(baseline) or {})}
    names = {field.name for field in fields(registry.get("reconstructor", baseline).config)}
    if "seed" in names:
        options["seed"] = seed
    prior: Any = config.prior
    if config.prior.name == "depth":
        prior = merged(config.prior, {**NOISES[noise][1], "seed": seed})
    return {
        "reconstructor": options,
        "prior": prior,
        "axis": config.axis,
        "fusion": config.fusion,
        "renderer": config.renderer,
    }


def merged(config: Any, changes: Mapping[str, Any]) -> dict[str, Any]:
    """A component's options as a plain dict, with changes."""
    plain = OmegaConf.to_container(OmegaConf.structured(config) if is_dataclass(config) else config)
    assert isinstance(plain, dict)
    return {**plain, **changes}


def lpips_of(path: str | None) -> Lpips | None:
    """LPIPS with a user's own weights, or those of the cache; None when the cache has none.

    Raises :class:`Gvla2Error` when a file was named and cannot be used.
    """
    from gvla2.evaluation.lpips import Lpips
    from gvla2.evaluation.lpips_weights import read_weights

    if path is not None:
        return Lpips(read_weights(Path(path).expanduser()))
    try:
        return Lpips()
    except MissingDependencyError:
        return None


def measure_there(unit: Unit) -> list[Measured]:
    """As :func:`measure_unit`, in a worker process: it finds the plugins itself and warms up before the clock runs.

    Errors travel back as their message alone: exceptions with constructors of their own do not survive pickling.
    """
    try:
        _warm_up(unit)
        return measure_unit(unit, _registry(), threads=1)
    except Gvla2Error as error:
        raise Gvla2Error(str(error)) from None


def measure_unit(unit: Unit, registry: Registry, threads: int = -1) -> list[Measured]:
    """Measure the unit's cells here; an object that cannot be loaded gives cells that say so."""
    from gvla2.evaluation.ablation import Measured, failed, measure_object
    from gvla2.evaluation.judge import Judge
    from gvla2.reconstruction.branch import BranchOptions

    config = unit.config
    try:
        views = unit.dataset.load(unit.item)
    except Gvla2Error as error:
        return [Measured(failed(want, error)) for want in unit.wanted]
    parts_for = _PartsBySeed(unit, registry)
    options = BranchOptions(
        mode=cast(Literal["default", "paper"], config.mode),
        compat=cast(Literal["none", "official"], config.compat),
    )

    def judge_for(renderer: Renderer) -> Judge:
        return Judge(views, renderer, lpips_of(config.lpips_weights), threads, config.surface_samples)

    return list(measure_object(views, unit.wanted, parts_for, judge_for, options))


class _PartsBySeed:
    """Builds the components for a seed; once for all seeds that configure them alike."""

    def __init__(self, unit: Unit, registry: Registry) -> None:
        self._unit, self._registry = unit, registry
        self._built: dict[tuple[str, str], Parts] = {}

    def __call__(self, seed: int, noise: str) -> Parts:
        from gvla2.evaluation.ablation import Parts

        root = chosen_parts(self._unit.config, self._registry, self._unit.baseline, seed, noise)
        which = repr(root["reconstructor"]), repr(root["prior"])
        if which not in self._built:
            parts = Parts(**self._registry.build_all(root, KINDS))
            # One reconstructor serves all priors, so that it runs once.
            same = [kept for (name, _), kept in self._built.items() if name == which[0]]
            self._built[which] = replace(parts, reconstructor=same[0].reconstructor) if same else parts
        return self._built[which]


@cache
def _registry() -> Registry:
    return load_plugins()


def _warm_up(unit: Unit) -> None:
    """Once a process and baseline, run a refined cell unmeasured: compiled code is loaded before any clock runs."""
    if not unit.wanted or unit.baseline in _warmed():
        return
    _warmed().add(unit.baseline)
    refined = (want for want in unit.wanted if want.factors["variant"] == "ab_fusion")
    one = next(refined, unit.wanted[0])
    measure_unit(replace(unit, wanted=(one,)), _registry(), threads=1)


@cache
def _warmed() -> set[str]:
    """The baselines that this process has run; empty at first."""
    return set()
