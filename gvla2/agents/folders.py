"""Folders of tasks in the layout of Terminal-Bench 2: ``task.toml``, ``instruction.md``, ``tests``, ``environment``."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from pathlib import Path

from gvla2.agents.contracts import AgentTask
from gvla2.errors import ConfigurationError

_LIMITS = {
    "agent_seconds": ("agent", "timeout_sec"),
    "test_seconds": ("verifier", "timeout_sec"),
    "disk_mb": ("environment", "storage_mb"),
    "memory_mb": ("environment", "memory_mb"),
}
"""Where a ``task.toml`` has the fields of :class:`AgentTask`."""


def read_tasks(root: str | Path, names: Iterable[str] = ()) -> list[AgentTask]:
    """The tasks below a folder, by name; ``names`` chooses some, in their order.

    Raises :class:`ConfigurationError` for a folder without tasks, a missing or duplicate name, and a task without tests
    or instruction.
    """
    found: dict[str, Path] = {}
    for folder in sorted(file.parent for file in Path(root).expanduser().rglob("task.toml")):
        if folder.name in found:
            raise ConfigurationError(
                f"Two tasks are called '{folder.name}': {found[folder.name]} and {folder}. Rename one."
            )
        found[folder.name] = folder
    if not found:
        raise ConfigurationError(
            f"No task lies below agents.tasks={root}. A task is a folder with a task.toml, as in Terminal-Bench 2."
        )
    wanted = list(names) or list(found)
    for name in wanted:
        if name not in found:
            raise ConfigurationError(f"No task '{name}' below '{root}'. Available: {', '.join(found)}.")
    return [read_task(found[name]) for name in wanted]


def read_task(folder: Path) -> AgentTask:
    """One task; raises :class:`ConfigurationError` naming what is missing or cannot be read."""
    for name in ("task.toml", "instruction.md", "tests", "environment"):
        if (folder / name).is_symlink():
            # A downloaded task could otherwise show the agent any file of this machine.
            raise ConfigurationError(f"{folder / name} is a link; a task holds its own files.")
    try:
        settings = tomllib.loads((folder / "task.toml").read_text(encoding="utf-8"))
        instruction = (folder / "instruction.md").read_text(encoding="utf-8").strip()
        limits = {
            name: float(settings[section][key])
            for name, (section, key) in _LIMITS.items()
            if key in settings.get(section, {})
        }
    except (OSError, ValueError, TypeError) as error:
        raise ConfigurationError(f"The task {folder} cannot be read: {error}") from error
    metadata = settings.get("metadata", {})
    files = folder / str(metadata["files"]) if metadata.get("files") else None
    entry = folder / "tests" / "test.sh"
    if not instruction:
        raise ConfigurationError(f"The task {folder} has no instruction.")
    if not all(0 < limit < float("inf") for limit in limits.values()):
        raise ConfigurationError(f"The task {folder} has a limit that is not above 0: {limits}.")
    if not entry.is_file():
        raise ConfigurationError(
            f"The task {folder} has no tests: {entry} is missing. Without tests its result is unknown."
        )
    if files is not None and not (
        files.is_dir()
        and files.is_relative_to(folder)
        and files.resolve() == folder.resolve() / files.relative_to(folder)
    ):
        raise ConfigurationError(f"{files}, metadata.files of its task.toml, is not a folder of the task.")
    return AgentTask(
        name=folder.name,
        instruction=instruction,
        folder=folder,
        tests=folder / "tests",
        files=files,
        family=str(metadata.get("family", "")),
        **limits,
    )
