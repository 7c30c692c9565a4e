"""The primary configurations: one dataclass and one YAML file of ``gvla2.conf`` for each Hydra command."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gvla2.commands.calibrate import CalibrateConfig
from gvla2.commands.data import DataCommandConfig
from gvla2.commands.memory import MemoryCommandConfig
from gvla2.commands.reconstruct import ReconstructConfig
from gvla2.commands.report import ReportConfig
from gvla2.commands.run import RunConfig
from gvla2.evaluation.config import SUITES, BenchConfig

PRIMARY: Mapping[str, type] = MappingProxyType(
    {
        "run": RunConfig,
        "reconstruct": ReconstructConfig,
        "bench": BenchConfig,
        "report": ReportConfig,
        "memory": MemoryCommandConfig,
        "data": DataCommandConfig,
        "calibrate": CalibrateConfig,
    }
)
SCHEMAS: Mapping[str, type] = MappingProxyType(
    {**PRIMARY, **{f"bench_suite_schema/{name}": schema for name, schema in SUITES.items()}}
)
"""The schemas of the primary configurations, and those of the suites for ``gvla2 bench``."""
CONFIG_MODULE = "gvla2.conf"
VERSION_BASE = "1.3"
