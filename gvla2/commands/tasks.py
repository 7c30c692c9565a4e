"""``gvla2 tasks``: the tasks that a robot can be given, by name."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing

from gvla2.errors import Gvla2Error

DESCRIPTION = """\
Lists the tasks that `gvla2 run` takes, with the chosen robot: its own, by their instructions, if it has a world of its
own, else those of the plugins.
"""


def main(argv: Sequence[str]) -> int:
    """Print the list; the exit status is 1 when the robot can't be made."""
    parser = argparse.ArgumentParser(prog="gvla2 tasks", description=DESCRIPTION)
    parser.add_argument("overrides", nargs="*", metavar="robot=NAME robot.option=VALUE", help="as for run")
    overrides = parser.parse_args(argv).overrides
    try:
        tasks = tasks_of(overrides)
    except Gvla2Error as error:
        print(f"gvla2: {error}", file=sys.stderr)
        return 1
    from gvla2.commands.tables import console, row, table

    listing = table("task", "")
    for name, sentence in tasks.items():
        row(listing, name, sentence)
    console().print(listing)
    return 0


def tasks_of(overrides: Sequence[str]) -> dict[str, str]:
    """The tasks by name for the robot that the overrides choose: their instructions, or their summaries."""
    from gvla2.commands.hydra_job import composed
    from gvla2.robot.backend import OffersTasks

    config, registry = composed("run", [*overrides, "task=none"])
    if any(word.startswith("robot") for word in overrides):
        with closing(registry.build(config, "robot")) as robot:
            if isinstance(robot, OffersTasks):
                return dict(robot.tasks())
    return {name: component.summary for name, component in registry.components("task").items()}
