"""The bridge to Hydra: components become choices of groups, and plugins' presets are found.

Hydra keeps its configurations and plugins in process-wide stores of its own. This module fills them and is the
only place that does.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from typing import ClassVar

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from gvla2.catalog import Registry, structured
from gvla2.component import ComponentConfig
from gvla2.kinds import KINDS, SLOTS

PROVIDER = "gvla2"
LONGEST_FOLDER_NAME = 80


class PresetSearchPath(SearchPathPlugin):
    """Adds the search paths that plugins announced; Hydra makes instances itself, hence the class attribute."""

    paths: ClassVar[tuple[str, ...]] = ()

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Called by Hydra before it composes."""
        for path in self.paths:
            search_path.append(provider=PROVIDER, path=path)


def register(
    registry: Registry, schemas: Mapping[str, type] | None = None, kinds: Iterable[str] = (*KINDS, *SLOTS)
) -> None:
    """Offer every component of the registry to Hydra as ``group=kind``, ``name=component.name``, and in the slots.

    ``schemas`` are dataclasses of primary configurations, stored under ``<name>_schema``. Calling it again with
    another registry replaces what the former call offered. ``kinds`` are those that matter: a command of few groups
    starts the faster.
    """
    store = ConfigStore.instance()
    for group_name in kinds:
        group = store.repo.get(group_name, {})
        for stale in [key for key, node in group.items() if getattr(node, "provider", None) == PROVIDER]:
            del group[stale]
        for name, component in registry.components(SLOTS.get(group_name, group_name)).items():
            store.store(group=group_name, name=name, node=structured(component), provider=PROVIDER)
    for slot in SLOTS:
        store.store(group=slot, name="none", node=ComponentConfig(name="none"), provider=PROVIDER)
    for name, schema in (schemas or {}).items():
        store.store(name=f"{name}_schema", node=schema, provider=PROVIDER)
    PresetSearchPath.paths = registry.search_paths
    Plugins.instance().register(PresetSearchPath)
    register_resolvers()


def register_resolvers() -> None:
    """Make ``${gvla2_short:...}`` known to OmegaConf in this process; a worker process needs it too."""
    OmegaConf.register_new_resolver("gvla2_short", short_name, replace=True)


def short_name(text: str) -> str:
    """A folder name of at most 80 characters for overrides of any length; a cut one ends in a digest."""
    clean = re.sub(r"[^\w=,.+-]+", "-", text).strip("-")
    if len(clean) <= LONGEST_FOLDER_NAME:
        return clean
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{clean[: LONGEST_FOLDER_NAME - 9]}-{digest}"
