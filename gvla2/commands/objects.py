"""``gvla2 objects teach NAME``: an object that a run saw becomes an entry of a gallery of known objects."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.errors import ConfigurationError, Gvla2Error, did_you_mean, reading
from gvla2.record.text import printable

if TYPE_CHECKING:
    from gvla2.planning.scene import Scene

USAGE = "gvla2 objects teach NAME run=FOLDER object=ID to=FOLDER [alone=true] [replace=true]"
DESCRIPTION = """\
Makes a gallery entry, NAME.glb, from an object that a run saw: what its cameras saw of it, completed by symmetry.
Runs with perceiver.gallery=FOLDER recognise it from then on. run= is the folder of a run of `gvla2 run`, object= the
id of the object on its page (o3, or several pieces of it: o3,o4), to= the gallery, made if it does not exist. All that
hangs together with the object is taken with it; alone=true takes only what lies in the boxes of the ids.
replace=true writes over an entry of that name.
"""
OPTIONS = ("run", "object", "to", "alone", "replace")
LITTLE = 0.3
"""Share of the surface below which so little was seen that another look is recommended."""


@dataclass(frozen=True)
class TeachRequest:
    """Teach ``name`` from the objects ``ids`` of the run in the folder ``run`` to the gallery in the folder ``to``."""

    name: str
    run: Path
    ids: tuple[str, ...]
    to: Path
    alone: bool = False
    replace: bool = False


def main(argv: Sequence[str]) -> int:
    """Teach an object; returns 1 when that fails, 2 for wrong usage."""
    parser = argparse.ArgumentParser("gvla2 objects", usage=USAGE, description=DESCRIPTION)
    parser.add_argument("verb", choices=["teach"])
    parser.add_argument("name", metavar="NAME")
    parser.add_argument("options", nargs="*", metavar="KEY=VALUE")
    asked = parser.parse_args(argv)
    options = {key: value for key, _, value in (word.partition("=") for word in asked.options)}
    if unknown := [name for name in options if name not in OPTIONS]:
        parser.error(f"there is no option '{unknown[0]}='.{did_you_mean(unknown[0], OPTIONS)}")
    if missing := [name for name in OPTIONS[:3] if not options.get(name)]:
        parser.error(f"{missing[0]}= is required")
    if wrong := [name for name in OPTIONS[3:] if options.get(name, "true") not in ("true", "false")]:
        parser.error(f"{wrong[0]}= is true or false")
    request = TeachRequest(
        asked.name,
        Path(options["run"]).expanduser(),
        tuple(options["object"].split(",")),
        Path(options["to"]).expanduser(),
        options.get("alone") == "true",
        options.get("replace") == "true",
    )
    try:
        print(printable(teach(request)))
    except Gvla2Error as error:
        from gvla2.commands.hydra_job import report

        return report(error)
    return 0


def teach(request: TeachRequest) -> str:
    """Write the entry, whole or not at all; returns sentences on what it is.

    Raises :class:`ConfigurationError` for a run or an object that does not exist and for a name that is taken or
    cannot name a file, :class:`~gvla2.errors.PerceptionError` where too little of the object is seen.
    """
    from gvla2.geometry.mesh_files import write_mesh
    from gvla2.geometry.view_folders import VIEWS, read_views
    from gvla2.io.files import make_folder
    from gvla2.perception.scans import entry_file
    from gvla2.perception.teaching import taught

    target = entry_file(request.to, request.name, replace=request.replace)
    scene = read_scene(request.run)
    by_id = {obj.id: obj for obj in scene.objects}
    if absent := [one for one in request.ids if one not in by_id]:
        there = ", ".join(f"{obj.id} ({obj.label})" for obj in scene.objects) or "none"
        raise ConfigurationError(f"The run {request.run} has no object '{absent[0]}'. It saw: {there}.")
    made = taught(read_views(request.run / VIEWS), scene, request.ids, alone=request.alone)
    make_folder(request.to)
    write_mesh(target, made.mesh)
    low, high = 1e3 * made.mesh.bounds
    size = " x ".join(f"{side:.0f}" for side in high - low)
    lines = [f"{request.name}: {size} mm, {100 * made.seen:.0f} % of its surface was seen: {target}"]
    if more := [f"{one} ({by_id[one].label})" for one in made.objects if one not in request.ids]:
        lines.append(f"Taken with it: {', '.join(more)}. If they are objects of their own: alone=true.")
    if made.seen < LITTLE:
        lines.append("Little of it was seen: a run in which the cameras see more of it teaches it better.")
    return "\n".join(lines)


def read_scene(folder: Path) -> Scene:
    """The scene of a run's folder; its objects have boxes and labels, their points are not kept.

    Raises :class:`ConfigurationError` for a folder that is not that of a run that has perceived something.
    """
    import numpy as np

    from gvla2.geometry.view_folders import CAMERAS, VIEWS
    from gvla2.planning.scene import Box, Scene, SceneObject

    if not folder.is_dir():
        raise ConfigurationError(f"There is no folder '{folder}'.")
    needed = ("scene.json", f"{VIEWS}/{CAMERAS}")
    if absent := [name for name in needed if not (folder / name).is_file()]:
        episodes = sorted(path.parent.name for path in folder.glob("*/scene.json"))
        hint = f" It holds episodes: run={folder / episodes[0]}, ..." if episodes else ""
        raise ConfigurationError(
            f"'{folder}' has no {absent[0]}: it is not the folder of a run that perceived a scene.{hint}"
        )
    with reading("a scene", folder / "scene.json", ConfigurationError):
        kept: dict[str, Any] = json.loads((folder / "scene.json").read_text("utf-8-sig"))
        objects = tuple(
            SceneObject(
                each["id"],
                each["label"],
                each["shape"],
                each["colour"],
                np.array(each["world_from_object"]),
                np.array(each["extents"]),
                np.zeros((0, 3)),
            )
            for each in kept["objects"]
        )
        workspace = Box(np.array(kept["workspace"]["low"]), np.array(kept["workspace"]["high"]))
        return Scene(objects, float(kept["table_height"]), workspace)
