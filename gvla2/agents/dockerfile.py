"""The part of a Dockerfile that works without Docker: copied files, a folder, variables, and host commands."""

from __future__ import annotations

import json
import shlex
from dataclasses import dataclass, field
from pathlib import Path

from gvla2.errors import ConfigurationError


@dataclass(frozen=True)
class Recipe:
    """The steps of a Dockerfile in their order: ("copy", (sources..., target)) and ("run", (command,)).

    ``folder`` is the last WORKDIR, the one that the agent works in.
    """

    folder: str = "/app"
    variables: dict[str, str] = field(default_factory=dict)
    steps: tuple[tuple[str, tuple[str, ...]], ...] = ()


def read_recipe(dockerfile: Path) -> Recipe:
    """The recipe, empty without a Dockerfile; raises :class:`ConfigurationError` for unsupported instructions."""
    if not dockerfile.is_file():
        return Recipe()
    folder, variables = "/app", dict[str, str]()
    steps: list[tuple[str, tuple[str, ...]]] = []
    for line in _instructions(dockerfile.read_text(encoding="utf-8", errors="replace")):
        word, _, rest = line.partition(" ")
        word, rest = word.upper(), rest.strip()
        if word == "WORKDIR":
            folder = str(Path(folder) / rest)
        elif word == "ENV":
            variables |= _variables(rest)
        elif word in ("COPY", "ADD"):
            parts = _words(rest)
            if any(part.startswith(("--from", "http://", "https://")) for part in parts):
                raise ConfigurationError(
                    f"{dockerfile}: '{line[:80]}' needs Docker: agents.sandbox=docker builds it."
                )
            *sources, target = [part for part in parts if not part.startswith("--")]
            steps.append(("copy", (*sources, str(Path(folder) / target) + "/" * target.endswith("/"))))
        elif word == "RUN":
            steps.append(("run", (f"cd {shlex.quote(folder)} && {rest}",)))
        elif word not in ("FROM", "CMD", "ENTRYPOINT", "LABEL", "EXPOSE", "USER", "SHELL", "ARG"):
            raise ConfigurationError(f"{dockerfile}: '{word}' needs Docker: agents.sandbox=docker builds it.")
    return Recipe(folder, variables, tuple(steps))


def _instructions(text: str) -> list[str]:
    """Lines with their continuations, without comments."""
    whole: list[str] = []
    open_line = ""
    for line in text.splitlines():
        if line.strip().startswith("#") or not (line.strip() or open_line):
            continue
        open_line += line.strip()
        if open_line.endswith("\\"):
            open_line = open_line[:-1] + " "
            continue
        if open_line:
            whole.append(open_line)
        open_line = ""
    return whole + ([open_line.strip()] if open_line.strip() else [])


def _words(rest: str) -> list[str]:
    if rest.startswith("["):
        return [str(word) for word in json.loads(rest)]
    return shlex.split(rest)


def _variables(rest: str) -> dict[str, str]:
    if "=" not in rest.split(" ", 1)[0]:
        name, _, value = rest.partition(" ")
        return {name: value.strip()}
    return dict(word.split("=", 1) for word in shlex.split(rest) if "=" in word)
