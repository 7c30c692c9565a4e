"""``gvla2 tasks`` and ``gvla2 data``: the tasks that a robot can be given, and data that come with a robot's world."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from gvla2.commands.hydra_job import composed, report
from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.plugins.registry import Registry, load_plugins

TASKS = """\
Lists the tasks that `gvla2 run` takes, with the chosen robot: its own, by their instructions, if it has a world of its
own, else those of the plugins.
"""
DATA = """\
Writes the gallery of known objects that comes with a robot's world, as perceivers take it:
`gvla2 data libero_gallery to=FOLDER`, then `gvla2 run robot=libero task=libero_object/3 perceiver.gallery=FOLDER`.
"""
GALLERY = "_gallery"


def tasks(argv: Sequence[str]) -> int:
    """Print the list of tasks; the exit status is 1 when the robot can't be made."""
    parser = argparse.ArgumentParser(prog="gvla2 tasks", description=TASKS)
    parser.add_argument("overrides", nargs="*", metavar="robot=NAME robot.option=VALUE", help="as for run")
    overrides = parser.parse_args(argv).overrides
    registry = load_plugins()
    try:
        found = tasks_of(overrides, registry)
    except (Gvla2Error, HydraException, OmegaConfBaseException) as error:
        return report(error, registry)
    from gvla2.commands.tables import console, row, table

    listing = table("task", "")
    for name, sentence in found.items():
        row(listing, name, sentence)
    console().print(listing)
    return 0


def tasks_of(overrides: Sequence[str], registry: Registry) -> dict[str, str]:
    """The tasks by name for the robot that the overrides choose: their instructions, or their summaries."""
    from gvla2.robot.backend import OffersTasks

    config, _ = composed("run", [*overrides, "task=none"], registry)
    if any(word.startswith("robot") for word in overrides):
        with closing(registry.build(config, "robot")) as robot:
            if isinstance(robot, OffersTasks):
                return dict(robot.tasks())
    return {name: component.summary for name, component in registry.components("task").items()}


def data(argv: Sequence[str]) -> int:
    """Write the data that were asked for; the exit status is 1 when that is not possible."""
    parser = argparse.ArgumentParser(prog="gvla2 data", description=DATA)
    parser.add_argument("name", help="ROBOT_gallery, such as libero_gallery")
    parser.add_argument("to", help="to=FOLDER")
    options = parser.parse_args(argv)
    folder = options.to.removeprefix("to=")
    try:
        names = write_gallery(options.name, Path(folder).expanduser())
    except Gvla2Error as error:
        return report(error)
    print(f"{len(names)} objects in {folder}: {', '.join(names)}")
    return 0


def write_gallery(name: str, folder: Path) -> Sequence[str]:
    """The names of the objects written; raises :class:`ConfigurationError` for a robot that has none."""
    from gvla2.robot.backend import OffersGallery

    registry, robot = load_plugins(), name.removesuffix(GALLERY)
    if robot != name and robot in registry.components("robot"):
        with closing(registry.build({"robot": {"name": robot}}, "robot")) as made:
            if isinstance(made, OffersGallery):
                return made.write_gallery(folder)
    raise ConfigurationError(
        f"There is no '{name}'. A gallery is called ROBOT{GALLERY}, after a robot whose world comes with meshes of its "
        "objects: libero_gallery."
    )
