"""Tasks in folders, as Terminal-Bench lays them out."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from gvla2.agents.contracts import AgentTask
from gvla2.errors import ConfigurationError

MARKERS = ("task.toml", "task.yaml")


def read_tasks(root: str | Path, names: Iterable[str] = ()) -> list[AgentTask]:
    """The tasks below a folder, by name; ``names`` chooses some, in their order.

    Raises :class:`ConfigurationError` for a folder without tasks, a missing or duplicate name, and a task without tests
    or instruction.
    """
    place = Path(root).expanduser()
    if not place.is_dir():
        raise ConfigurationError(
            f"agents.tasks is '{root}', which is not a folder. Give a folder of task folders."
        )
    folders = sorted({file.parent for marker in MARKERS for file in place.rglob(marker)})
    if not folders:
        raise ConfigurationError(
            f"No task lies below '{root}'. A task is a folder with {' or '.join(MARKERS)}, as Terminal-Bench has them."
        )
    found: dict[str, Path] = {}
    for folder in folders:
        if folder.name in found:
            raise ConfigurationError(
                f"Two tasks are called '{folder.name}': {found[folder.name]} and {folder}. Rename one."
            )
        found[folder.name] = folder
    wanted = list(names) or list(found)
    missing = [name for name in wanted if name not in found]
    if missing:
        raise ConfigurationError(f"No task '{missing[0]}' below '{root}'. Available: {', '.join(found)}.")
    return [read_task(found[name]) for name in wanted]


def read_task(folder: Path) -> AgentTask:
    """One task; raises :class:`ConfigurationError` naming what is missing or cannot be read."""
    for name in ("task.toml", "task.yaml", "instruction.md", "tests", "environment", "run-tests.sh"):
        if (folder / name).is_symlink():
            # A downloaded task could otherwise show the agent any file of this machine.
            raise ConfigurationError(f"{folder / name} is a link; a task holds its own files.")
    return _of_version_2(folder) if (folder / "task.toml").is_file() else _of_version_1(folder)


def _of_version_2(folder: Path) -> AgentTask:
    try:
        settings = tomllib.loads((folder / "task.toml").read_text(encoding="utf-8"))
        instruction = (folder / "instruction.md").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigurationError(f"The task {folder} cannot be read: {error}") from error
    metadata = _section(settings, "metadata")
    return _checked(
        AgentTask(
            name=folder.name,
            instruction=instruction.strip(),
            folder=folder,
            environment=folder / "environment",
            tests=folder / "tests",
            tests_entry=folder / "tests" / "test.sh",
            files=folder / str(files) if (files := metadata.get("files")) else None,
            family=str(metadata.get("family", "")),
            agent_seconds=_seconds(_section(settings, "agent").get("timeout_sec", 600), folder),
            test_seconds=_seconds(_section(settings, "verifier").get("timeout_sec", 120), folder),
        )
    )


def _of_version_1(folder: Path) -> AgentTask:
    try:
        settings = yaml.safe_load((folder / "task.yaml").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigurationError(f"The task {folder} cannot be read: {error}") from error
    if not isinstance(settings, Mapping):
        raise ConfigurationError(f"{folder / 'task.yaml'} does not hold a mapping.")
    entries = (folder / "tests" / "run-tests.sh", folder / "run-tests.sh")
    return _checked(
        AgentTask(
            name=folder.name,
            instruction=str(settings.get("instruction", "")).strip(),
            folder=folder,
            environment=folder,
            tests=folder / "tests",
            tests_entry=next((entry for entry in entries if entry.is_file()), entries[0]),
            family=str(settings.get("category", "")),
            agent_seconds=_seconds(settings.get("max_agent_timeout_sec", 600), folder),
            test_seconds=_seconds(settings.get("max_test_timeout_sec", 120), folder),
        )
    )


def _checked(task: AgentTask) -> AgentTask:
    if not task.instruction:
        raise ConfigurationError(f"The task {task.folder} has no instruction.")
    if not task.tests_entry.is_file():
        raise ConfigurationError(
            f"The task {task.folder} has no tests: {task.tests_entry} is missing. Without tests its result is unknown."
        )
    root = task.folder.resolve()
    if task.files is not None and not (
        task.files.is_dir()
        and task.files.is_relative_to(task.folder)
        and task.files.resolve() == root / task.files.relative_to(task.folder)
    ):
        raise ConfigurationError(
            f"{task.files}, metadata.files of its task.toml, is not a folder of the task."
        )
    return task


def _section(settings: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    section = settings.get(name, {})
    return section if isinstance(section, Mapping) else {}


def _seconds(value: object, folder: Path) -> float:
    try:
        seconds = float(str(value))
    except ValueError:
        seconds = -1.0
    if not 0 < seconds < float("inf"):
        raise ConfigurationError(f"The task {folder} allows '{value}' seconds; give a number above 0.")
    return seconds
