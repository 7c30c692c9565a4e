"""Configurations for tests whose subject is not how they are composed."""

import re
from functools import cache
from typing import Any

from hydra import compose, initialize_config_module
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import OverrideType
from omegaconf import DictConfig, OmegaConf

from gvla2.commands.hydra_job import schemas, suite_schemas
from gvla2.evaluation.config import BenchConfig
from gvla2.plugins.hydra_config import ComponentSource, register
from gvla2.plugins.registry import Registry

CHOICES = {"bench_suite", "conditions", "depth_noise", "branch", "experiment", "data"}
"""Groups beside those of components."""
_offered: dict[str, Any] = {}


def offer(registry: Registry) -> None:
    """Offer the components and every command's schema to Hydra, which takes a while, unless that was the last offer."""
    if _offered.get("registry") is not registry or _offered["choices"] is not ComponentSource.offered:
        register(registry, schemas() | suite_schemas())
        _offered.update(registry=registry, choices=ComponentSource.offered)


@cache
def composition(command: str, *overrides: str) -> DictConfig:
    """What Hydra composes of these, once: it needs half a second. It is not to be changed."""
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        return compose(command, overrides=list(overrides))


def composed(command: str, *overrides: str) -> Any:
    """A new configuration: components and values are put into what Hydra composes of the other overrides."""
    given = ComponentSource("tests", "gvla2://")
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    changes, others = [], []
    for one in parsed:
        name, value = one.key_or_group, one.value()
        if one.type == OverrideType.CHANGE and given.is_config(f"{name}/{value}"):
            changes.append((name, given.load_config(f"{name}/{value}").config))
        elif one.type == OverrideType.CHANGE and not given.is_group(name) and name not in CHOICES:
            changes.append((name, value))
        else:
            others.append(str(one.input_line))
    config = composition(command, *others).copy()
    for name, value in sorted(changes, key=lambda change: not isinstance(change[1], DictConfig)):
        OmegaConf.update(config, name, value, merge=not isinstance(value, DictConfig))
    return OmegaConf.to_object(config)


def bench_config(registry: Registry, *overrides: str) -> BenchConfig:
    """A new one of ``gvla2 bench``."""
    offer(registry)
    made = composed("bench", *(re.sub("^suite=", "bench_suite=", word) for word in overrides))
    assert isinstance(made, BenchConfig)
    return made
