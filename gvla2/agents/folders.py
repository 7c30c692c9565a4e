"""Tasks and published runs in folders, as Terminal-Bench and mini-swe-agent lay them out."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from gvla2.agents.contracts import AgentRun, AgentTask
from gvla2.agents.solving import transcript
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


_ESCAPES = re.compile(r"\x1b(?:\[[0-?]*[ -/]*[@-~]|\][^\x07]*\x07|[@-Z\\-_])|[\x00-\x08\x0b-\x1f\x7f]")
LONGEST = 200_000
"""Characters of a terminal's log that are read from its end."""


@dataclass(frozen=True)
class Trial:
    """A finished run: its task, transcript, reported ending, and whether its tests passed."""

    id: str
    task: str
    instruction: str
    account: str
    resolved: bool
    exit_status: str = ""


def read_trials(root: str | Path) -> list[Trial]:
    """All trials below a folder whose outcome is known, by id.

    Reads Terminal-Bench's trial folders (``results.json`` with ``is_resolved``, beside ``sessions/agent.log`` or
    ``panes/post-agent.txt``) and mini-swe-agent's ``*.traj.json``, whose outcomes are in a report of SWE-bench's
    harness (a JSON with ``resolved_ids``) in the same folder or above. Raises :class:`ConfigurationError` if there are
    none.
    """
    place = Path(root).expanduser()
    if not place.is_dir():
        raise ConfigurationError(f"agents.trajectories is '{root}', which is not a folder.")
    trials = {trial.id: trial for trial in (*_terminal_bench(place), *_mini_swe(place))}
    if not trials:
        raise ConfigurationError(
            f"No run with a known outcome lies below '{root}': neither Terminal-Bench's results.json with is_resolved, "
            "nor *.traj.json with a report that names resolved_ids."
        )
    return [trials[name] for name in sorted(trials)]


def _terminal_bench(root: Path) -> Iterator[Trial]:
    for file in sorted(root.rglob("results.json")):
        content = _json(file)
        if not isinstance(content.get("is_resolved"), bool):
            continue
        account = next((a for name in _ACCOUNTS if (a := _log(file.parent / name))), "")
        if account:
            yield Trial(
                id=f"{content.get('trial_name', file.parent.name)}@{file.parent.parent.parent.name}",
                task=str(content.get("task_id", "")),
                instruction=str(content.get("instruction", "")),
                account=account,
                resolved=content["is_resolved"],
                exit_status=str(content.get("failure_mode") or ""),
            )


_ACCOUNTS = ("sessions/agent.log", "panes/post-agent.txt")


def _mini_swe(root: Path) -> Iterator[Trial]:
    for file in sorted(root.rglob("*.traj.json")):
        resolved = _resolved_near(file, root)
        content = _json(file)
        messages = content.get("messages")
        name = file.name.removesuffix(".traj.json")
        if resolved is None or not isinstance(messages, list) or len(messages) < 3:
            continue
        info = content.get("info", {})
        status = str(info.get("exit_status", "")) if isinstance(info, Mapping) else ""
        run = AgentRun(tuple(m for m in messages if isinstance(m, Mapping)), 0, status, 0.0)
        asked = str(messages[1].get("content", "")) if isinstance(messages[1], Mapping) else ""
        yield Trial(name, name, asked, transcript(run), name in resolved, status)


def _resolved_near(file: Path, root: Path) -> frozenset[str] | None:
    """The resolved ids of the nearest report; None where there is none."""
    for folder in (file.parent, *file.parent.parents):
        for report in sorted(folder.glob("*.json")):
            ids = None if report.name.endswith(".traj.json") else _json(report).get("resolved_ids")
            if isinstance(ids, list):
                return frozenset(map(str, ids))
        if folder == root:
            break
    return None


def _log(file: Path) -> str:
    if not file.is_file():
        return ""
    raw = file.read_bytes()[-LONGEST:].decode(errors="replace")
    lines = (_ESCAPES.sub("", line.rsplit("\r", 1)[-1]).rstrip() for line in raw.split("\n"))
    return "\n".join(line for line in lines if line)


def _json(file: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, Mapping) else {}
