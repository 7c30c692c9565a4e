"""Configurations for tests whose subject is not how they are composed."""

import re
from functools import cache

from hydra import compose, initialize_config_module
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import OverrideType
from omegaconf import DictConfig, OmegaConf

from gvla2.commands.hydra_job import schemas, suite_schemas
from gvla2.evaluation.config import BenchConfig
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import Registry


@cache
def composition(command: str, *overrides: str) -> DictConfig:
    """What Hydra composes of these, once: it needs a sixth of a second. It is not to be changed."""
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return compose(command, overrides=list(overrides))


def bench_config(registry: Registry, *overrides: str) -> BenchConfig:
    """A new one of ``gvla2 bench``: choices of components are composed once, values are put into what was composed."""
    register(registry, schemas() | suite_schemas())
    words = [re.sub("^suite=", "bench_suite=", word) for word in overrides]
    parsed = OverridesParser.create().parse_overrides(words)
    kept = {*registry.groups, "bench_suite", "depth_noise", "branch", "experiment", "data"}
    values = [one for one in parsed if one.type == OverrideType.CHANGE and one.key_or_group not in kept]
    config = composition("bench", *(str(one.input_line) for one in parsed if one not in values)).copy()
    for one in values:
        OmegaConf.update(config, one.key_or_group, one.value())
    made = OmegaConf.to_object(config)
    assert isinstance(made, BenchConfig)
    return made
