"""``gvla2 doctor``: is this installation fit for each command's default run, and if not, what to do."""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gvla2.commands.tables import console, row, table
from gvla2.plugins.registry import load_plugins

if TYPE_CHECKING:
    from gvla2.commands.checkup import Check

DESCRIPTION = """\
Checks plugins, configurations, libraries, the components of each command's default run, the memory's database and
the output folder. The exit status is 1 when something that a command needs is broken; the last line says which.
A check without an answer in time is called slow, not broken.
"""


def main(argv: Sequence[str]) -> int:
    """Print the checks; 1 when one fails."""
    parser = argparse.ArgumentParser("gvla2 doctor", description=DESCRIPTION)
    parser.add_argument("--json", action="store_true", help="the same for programs")
    as_json = parser.parse_args(argv).json
    from gvla2.commands.checkup import broken_commands, examine, healthy

    checks = examine(load_plugins())
    well = healthy(checks)
    if as_json:
        print(json.dumps({"healthy": well, "checks": [dataclasses.asdict(c) for c in checks]}, indent=2))
        return 0 if well else 1
    out = console()
    listing = table("check", "status", "found")
    for check in checks:
        row(listing, check.name, check.status, check.found)
        if check.advice:
            row(listing, "", "", f"-> {check.advice}")
    out.print(listing)
    out.print(_praise(checks) if well else _complaint(broken_commands(checks)))
    return 0 if well else 1


def _praise(checks: Sequence[Check]) -> str:
    slow = any(check.status == "slow" for check in checks)
    return (
        "Nothing is broken, but some checks gave no answer in time." if slow else "The default runs can go."
    )


def _complaint(broken: Sequence[str]) -> str:
    named = ", ".join(f"`gvla2 {name}`" for name in broken)
    what = f"Something that {named} needs is broken" if broken else "Something is broken"
    return f"{what}; the default run can go." if broken and "run" not in broken else f"{what}."


def complete(words: Sequence[str]) -> list[str]:
    """Completions of the last word."""
    return ["--json"]
