"""The command line: ``gvla2 <command> [overrides]``. It only dispatches, so it starts at once."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
import traceback
from collections.abc import Sequence

COMMANDS = {
    "run": "run one episode, or many: observe, plan, execute, verify, learn",
    "reconstruct": "refine an object's geometry from a folder of calibrated views",
    "bench": "measure reconstruction, the robot with and without memory, or agents; makes tables",
    "report": "make tables of measured results: terminal, Markdown, LaTeX, HTML",
    "memory": "search and list a memory bank, verify it, import, export, forget",
    "export": "write runs as a data set for training: LeRobot",
    "data": "write the gallery of known objects that comes with a robot's world",
    "objects": "teach an object that a run saw, as an entry of a gallery of known objects",
    "tasks": "list the tasks that a robot can be given",
    "plugins": "list robots, planners, memories and everything else to choose from, with options",
    "doctor": "check this installation, list data sets, and say how to get what is missing",
}
"""Sub-commands and what they do."""


def run_command(command: str, argv: list[str]) -> int:
    """Run one of :data:`COMMANDS`; only its own module is imported."""
    match command:
        case "run":
            from gvla2.commands.run import main
        case "reconstruct":
            from gvla2.commands.reconstruct import main
        case "bench":
            from gvla2.commands.bench import main
        case "report":
            from gvla2.commands.report import main
        case "memory":
            from gvla2.commands.memory import main
        case "export":
            from gvla2.commands.export import main
        case "data":
            from gvla2.commands.worlds import data as main
        case "objects":
            from gvla2.commands.objects import main
        case "tasks":
            from gvla2.commands.worlds import tasks as main
        case "plugins":
            from gvla2.commands.plugins import main
        case _:
            from gvla2.commands.doctor import main
    return main(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a sub-command; returns the exit status (0 success, 1 error, 2 wrong usage, 130 interrupted)."""
    # Imports and configurations make many objects that stay: collecting garbage among them costs 8 % of the start.
    gc.set_threshold(500_000, 50, 50)
    # Workers and probes of ours must not import what lies in the current folder, which a stranger may have filled.
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        status = _dispatch(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of our output left: `gvla2 plugins | head`
        _silence_stdout()
        return 141
    except OSError as error:  # a full disk behind stdout; commands report their own files themselves
        _silence_stdout()
        print(f"gvla2: cannot write: {error.strerror or error}.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("gvla2: interrupted.", file=sys.stderr)
        return 130
    except SystemExit as leaving:  # argparse: 0 after --help, 2 for wrong usage
        return int(leaving.code or 0)
    except Exception:  # a fault of ours; the text in it may be another's, and must not control the terminal
        from gvla2.record.text import printable

        print(printable(traceback.format_exc()), file=sys.stderr)
        return 1
    return status


def _silence_stdout() -> None:
    """Discard what is still buffered: the interpreter would complain about it at exit."""
    with contextlib.suppress(OSError, ValueError):  # ValueError: a stdout without a file of its own
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _dispatch(arguments: list[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        print(usage(), file=sys.stdout if arguments else sys.stderr)
        return 0 if arguments else 2
    command, *rest = arguments
    if command in ("-V", "--version", "version"):
        from gvla2 import __version__

        print(f"gvla2 {__version__}")
        return 0
    if command not in COMMANDS:
        from gvla2.errors import did_you_mean

        hint = did_you_mean(command, COMMANDS)
        print(f"gvla2: no command '{command}'.{hint} Commands: {', '.join(COMMANDS)}.", file=sys.stderr)
        return 2
    return run_command(command, rest)


def usage() -> str:
    """The text of ``gvla2 --help``."""
    width = max(len(name) for name in COMMANDS)
    commands = "\n".join(f"  {name:<{width}}  {what}" for name, what in COMMANDS.items())
    return f"""\
gvla2: geometry-aware, memory-guided robot planning, every component a plugin.

Usage: gvla2 <command> [key=value ...]

Commands:
{commands}

Options:
  -h, --help             this text; `gvla2 <command> --help` explains a command
  -V, --version          the version

Examples:
  gvla2 run task=push_block seed=3
  gvla2 run -m memory=none,governed seed=0,1,2
  gvla2 plugins planner
"""


if __name__ == "__main__":
    sys.exit(main())
