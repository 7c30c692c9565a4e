"""Shared fixtures: composed configurations and the catalog of plugins."""

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.primary import PRIMARY
from gvla2.commands.run_config import RunConfig
from gvla2.hydra_bridge import register
from gvla2.plugins import Registry, load_plugins


@pytest.fixture(scope="session")
def registry() -> Registry:
    return load_plugins()


@pytest.fixture
def compose_run(registry: Registry, tmp_path: Path):
    """Compose ``gvla2 run``'s configuration with overrides; its memory lives in the test's own folder."""
    register(registry, PRIMARY)

    def composed(*overrides: str) -> RunConfig:
        own = [f"memory.url=sqlite:///{tmp_path / 'memory.db'}"]
        if any(o.startswith(("memory=", "memory.url=")) for o in overrides):
            own = []
        with initialize_config_module("gvla2.conf", version_base="1.3"):
            config = compose("run", overrides=["quiet=true", *own, *overrides])
        return OmegaConf.to_object(config)

    return composed


@pytest.fixture(autouse=True)
def _logging_as_it_was() -> Iterator[None]:
    """Handlers that a command put up in this process are closed: an open log would be blamed on a later test."""
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    yield
    for handler in set(root.handlers) - set(handlers):
        handler.close()
    root.handlers[:], root.level = handlers, level
