"""Runs that others have published, with their outcomes: Terminal-Bench trials, mini-swe-agent's trajectories."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gvla2.agents.contracts import AgentRun
from gvla2.agents.solving import transcript
from gvla2.errors import ConfigurationError

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
