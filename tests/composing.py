"""Configurations of ``gvla2 bench`` for tests whose subject is not how they are composed."""

from functools import cache
from typing import Any

from hydra import compose, initialize_config_module
from omegaconf import DictConfig, OmegaConf

from gvla2.catalog import Registry
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.primary import PRIMARY
from gvla2.hydra_bridge import register


@cache
def composition(command: str, *overrides: str) -> DictConfig:
    """What Hydra composes of these, once: it needs a sixth of a second. It is not to be changed."""
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return compose(command, overrides=list(overrides))


def bench_config(registry: Registry, *overrides: str) -> BenchConfig:
    """A new configuration: choices of components are composed once, values are put into what was composed."""
    register(registry, PRIMARY)
    values = [one for one in overrides if _is_value(registry, one.partition("=")[0])]
    choices = [one for one in overrides if one not in values]
    config: Any = OmegaConf.merge(composition("bench", *choices), OmegaConf.from_dotlist(values))
    made = OmegaConf.to_object(config)
    assert isinstance(made, BenchConfig)
    return made


def _is_value(registry: Registry, key: str) -> bool:
    return (
        (key.isidentifier() and key not in registry.groups and key != "depth_noise") or key.startswith("robot.")
    )
