"""Shell completion: sub-commands first, then Hydra's overrides of the chosen one.

The shells call ``gvla2 --shell-completion query=bash`` with the line so far in COMP_LINE, as Hydra's own
completion has it; Hydra's scripts are used as they are, but know no sub-commands.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from gvla2.commands import COMMANDS

if TYPE_CHECKING:
    from gvla2.plugins.registry import Registry

SHELLS = ("bash", "zsh", "fish")
_FLAGS = ("--help", "--version", "--shell-completion")
_HYDRA_FLAGS = ("--help", "--cfg", "--resolve", "--package", "--multirun", "--info", "--config-dir")


def main(argv: Sequence[str]) -> int:
    """``install=SHELL``, ``uninstall=SHELL`` or ``query=SHELL``; prints what the shell evaluates or suggests."""
    action, _, shell = (argv[0] if len(argv) == 1 else "").partition("=")
    if action not in ("install", "uninstall", "query") or shell not in SHELLS:
        print(
            f"gvla2: --shell-completion takes install=SHELL or uninstall=SHELL, with {', '.join(SHELLS)}.",
            file=sys.stderr,
        )
        return 2
    if action == "query":
        found = complete(os.environ.get("COMP_LINE", ""))
        print(("\n" if shell == "fish" else " ").join(found))
        return 0
    arguments, sys.argv = sys.argv, ["gvla2"]  # the name that Hydra writes into the script
    try:
        with hydra_application() as application:
            application.shell_completion(config_name=None, overrides=[f"{action}={shell}"])
    finally:
        sys.argv = arguments
    return 0


def complete(line: str) -> list[str]:
    """Completions of the last word of ``line``; a line that ends in a space starts a new word."""
    words = line.split()[1:]
    if not line or line[-1].isspace():
        words.append("")
    if len(words) < 2:
        word = words[0] if words else ""
        return [
            name for name in (*COMMANDS, *(_FLAGS if word.startswith("-") else ())) if name.startswith(word)
        ]
    command, last = words[0], words[-1]
    from gvla2.commands.primary import PRIMARY

    if command == "memory":  # verbs first, then overrides
        from gvla2.commands import memory

        own = [word for word in memory.complete(words[1:]) if word.startswith(last)]
        given = [word for word in words[2:-1] if "=" in word]
        return own if len(words) < 3 or last.startswith("-") else _overrides(command, [*given, last])
    if command in PRIMARY:
        if last.startswith("-"):
            return [flag for flag in _HYDRA_FLAGS if flag.startswith(last)]
        own = words[1:]
        if command == "bench":  # a suite first, then overrides
            from gvla2.commands.bench import SUITES

            if len(own) == 1:
                return [name for name in SUITES if name.startswith(last)] + _overrides(command, own)
            own = [f"suite={own[0]}" if own[0] in SUITES else own[0], *own[1:]]
        return _overrides(command, own)
    if command in COMMANDS:
        offered: list[str] = import_module(f"gvla2.commands.{command}").complete(words[1:])
        return [word for word in offered if word.startswith(last)]
    return []


def _overrides(command: str, words: list[str]) -> list[str]:
    """Hydra's completion of the last of ``words``; the others are overrides and flags already given."""
    from hydra.errors import HydraException
    from hydra.plugins.completion_plugin import DefaultCompletionPlugin
    from hydra.types import RunMode

    from gvla2.plugins.registry import load_plugins

    registry = load_plugins()
    with hydra_application(registry) as application:
        completer = DefaultCompletionPlugin(application.config_loader)
        # argparse exits on an incomplete flag; there is nothing to suggest then
        with contextlib.suppress(HydraException, SystemExit), contextlib.redirect_stderr(io.StringIO()):
            offered = completer._query(config_name=command, line=" ".join(words))
            # A component's name cannot be set: the choice `planner=skill` fills it in.
            offered = [
                word for word in offered if word not in {f"{group}.name=" for group in registry.groups}
            ]
            # Hydra offers every command's groups.
            composed = application.compose_config(command, [], RunMode.RUN)
            known = {*composed, *composed.hydra.runtime.choices}
            return [word for word in offered if re.split(r"[=./]", word.lstrip("+~"))[0] in known]
    return []


@contextlib.contextmanager
def hydra_application(registry: Registry | None = None) -> Iterator[Any]:
    """Hydra outside a job, with every component of the registry (or of the installed plugins) as a choice."""
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    from gvla2.commands.primary import CONFIG_MODULE, PRIMARY, VERSION_BASE
    from gvla2.plugins.hydra_config import register
    from gvla2.plugins.registry import load_plugins

    register(load_plugins() if registry is None else registry, PRIMARY)
    with initialize_config_module(version_base=VERSION_BASE, config_module=CONFIG_MODULE):
        yield GlobalHydra.instance().hydra
