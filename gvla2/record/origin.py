"""Where a result comes from: version, commit, the command that repeats it, and the options that were changed."""

from __future__ import annotations

import shlex
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from gvla2.io.files import plain

_NOT_OF_THE_RESULT = ("name", "quiet", "results", "seed", "instruction", "episodes")
"""Options that the page shows elsewhere, or on which no result depends."""

LONGEST = 60
"""Characters of a value that a page shows beside the title."""


@dataclass(frozen=True)
class Origin:
    """``argv`` is the command that repeats the result, [] if it was not started by one; ``options`` are those that
    differ from their defaults, by their dotted names.
    """

    version: str = ""
    commit: str = ""
    argv: list[str] = field(default_factory=list)
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def command(self) -> str:
        """The command as a shell reads it."""
        return shlex.join(self.argv)

    @property
    def shown(self) -> dict[str, Any]:
        """The options for people: of a preset with a kind, its kind alone, and nothing that fills more than a line."""
        kinds = [name.removesuffix("kind") for name in self.options if name.endswith(".kind")]
        return {
            name: value
            for name, value in self.options.items()
            if (name.endswith(".kind") or not any(name.startswith(kind) for kind in kinds))
            and len(str(value)) <= LONGEST
        }


def origin_of(config: Any, command: str) -> Origin:
    """The origin of what ``gvla2 <command>`` makes with this configuration, a dataclass."""
    from hydra.core.hydra_config import HydraConfig

    words = list(HydraConfig.get().overrides.task) if HydraConfig.initialized() else None
    argv = [] if words is None else ["gvla2", *command.split(), *words]
    return Origin(version("gvla2"), commit(), argv, dict(changed_options(config)))


def changed_options(made: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """The options of a dataclass, and of those within it, that differ from their defaults."""
    for each in fields(made):
        value = getattr(made, each.name)
        if each.name in _NOT_OF_THE_RESULT:
            continue
        if is_dataclass(value):
            yield from changed_options(value, f"{path}{each.name}.")
            continue
        # In a launcher's worker process the class was pickled, and its MISSING is not the one of dataclasses.
        usual = each.default_factory() if callable(each.default_factory) else each.default
        if value != usual and not (isinstance(usual, tuple) and value == list(usual)):  # as composed
            yield f"{path}{each.name}", plain(value)


@cache
def commit() -> str:
    """The commit of the source tree, with ``-dirty`` when files differ from it; "" outside a git checkout."""
    folder = Path(__file__).resolve().parents[2]
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    if not (folder / ".git").exists():
        return ""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=20, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
