"""The primary configurations: one dataclass and one YAML file of ``gvla2.conf`` for each Hydra command."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

CONFIG_MODULE = "gvla2.conf"
VERSION_BASE = "1.3"


class Schemas(Mapping[str, type]):
    """Dataclasses by name, each imported when it is asked for: a command that needs one starts faster."""

    def __init__(self, loaders: Mapping[str, Callable[[], type]]) -> None:
        self._loaders = dict(loaders)

    def __getitem__(self, name: str) -> type:
        return self._loaders[name]()

    def __iter__(self) -> Iterator[str]:
        return iter(self._loaders)

    def __len__(self) -> int:
        return len(self._loaders)


def _run() -> type:
    from gvla2.commands.run import RunConfig

    return RunConfig


def _reconstruct() -> type:
    from gvla2.commands.reconstruct import ReconstructConfig

    return ReconstructConfig


def _bench() -> type:
    from gvla2.evaluation.config import BenchConfig

    return BenchConfig


def _report() -> type:
    from gvla2.commands.report import ReportConfig

    return ReportConfig


def _memory() -> type:
    from gvla2.commands.memory import MemoryCommandConfig

    return MemoryCommandConfig


def _data() -> type:
    from gvla2.commands.data import DataCommandConfig

    return DataCommandConfig


def _calibrate() -> type:
    from gvla2.commands.calibrate import CalibrateConfig

    return CalibrateConfig


PRIMARY = Schemas(
    {
        "run": _run,
        "reconstruct": _reconstruct,
        "bench": _bench,
        "report": _report,
        "memory": _memory,
        "data": _data,
        "calibrate": _calibrate,
    }
)


def suite_schemas() -> dict[str, type]:
    """The schemas of the bench's suites, by their place in Hydra's store."""
    from gvla2.evaluation.config import SUITES

    return {f"bench_suite_schema/{name}": schema for name, schema in SUITES.items()}


def all_schemas() -> dict[str, type]:
    """The schemas of the primary configurations and of the bench's suites."""
    return {**PRIMARY, **suite_schemas()}
