"""``gvla2 data``: data that come with a robot's world, such as meshes of its objects for recognition."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from gvla2.errors import ConfigurationError, Gvla2Error

DESCRIPTION = """\
Writes the gallery of known objects that comes with a robot's world, as perceivers take it:
`gvla2 data libero_gallery to=FOLDER`, then `gvla2 run robot=libero task=libero_object/3 perceiver.gallery=FOLDER`.
"""
GALLERY = "_gallery"


def main(argv: Sequence[str]) -> int:
    """Write what was asked for; the exit status is 1 when that is not possible."""
    parser = argparse.ArgumentParser(prog="gvla2 data", description=DESCRIPTION)
    parser.add_argument("name", help="ROBOT_gallery, such as libero_gallery")
    parser.add_argument("to", help="to=FOLDER")
    options = parser.parse_args(argv)
    try:
        names = write_gallery(options.name, Path(options.to.removeprefix("to=")).expanduser())
    except Gvla2Error as error:
        print(f"gvla2: {error}", file=sys.stderr)
        return 1
    print(f"{len(names)} objects in {options.to.removeprefix('to=')}: {', '.join(names)}")
    return 0


def write_gallery(name: str, folder: Path) -> Sequence[str]:
    """The names of the objects written; raises :class:`ConfigurationError` for a robot that has none."""
    from gvla2.plugins.registry import load_plugins
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
