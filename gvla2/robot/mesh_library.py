"""A folder of meshes as a table of things by name."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path

from gvla2.errors import ConfigurationError

SUFFIXES = (".obj", ".glb", ".ply")

FAVOURITES = ("textured", "model", "mesh", "nontextured")
"""Stems that scanned data sets use for an object's own mesh, the best first."""

NOT_SHOWN = ("collision", "convex", "coacd", "decomp")
"""Words in the names of files made for physics engines."""


def mesh_library(root: str | os.PathLike[str]) -> dict[str, Path]:
    """The mesh of each thing in a folder, by name: a file's own stem, or the name of a folder with a mesh in it.

    ``mug.glb`` and ``mug/textured.obj`` are both the thing "mug"; deeper folders (``mug/google_16k/textured.obj``) are
    searched too. Raises :class:`ConfigurationError` for a folder that is missing or holds no mesh, two meshes of one
    name, and a thing's folder with several meshes, none of them called :data:`FAVOURITES`.
    """
    if not str(root):
        raise ConfigurationError("task=tabletop_objects needs a folder of meshes: task.objects.root=FOLDER.")
    folder = Path(root).expanduser()
    if not folder.is_dir():
        raise ConfigurationError(f"There is no folder {folder} to take objects from.")
    found: dict[str, Path] = {}
    for entry in sorted(folder.iterdir()):
        path = _mesh_in(entry) if entry.is_dir() else entry if entry.suffix.lower() in SUFFIXES else None
        if path is None or entry.name.startswith("."):
            continue
        name = entry.name if entry.is_dir() else entry.stem
        if name in found:
            raise ConfigurationError(
                f"Two meshes in {folder} are called '{name}': {_inside(found[name], folder)} and "
                f"{_inside(path, folder)}. Rename one."
            )
        found[name] = path
    if not found:
        raise ConfigurationError(
            f"The folder {folder} holds no meshes. It needs {', '.join(SUFFIXES)} files, or folders with one each."
        )
    return found


def chosen(library: Mapping[str, Path], names: Sequence[str]) -> dict[str, Path]:
    """The things of these names, all of them without any; spaces may replace underscores.

    Raises :class:`ConfigurationError` for a name that is unknown or given twice.
    """
    if not names:
        return dict(library)
    plain = {spoken(name): name for name in library}
    picked: dict[str, Path] = {}
    for name in names:
        known = name if name in library else plain.get(spoken(name))
        if known is None:
            near = get_close_matches(name, library, n=1)
            hint = f" Did you mean '{near[0]}'?" if near else ""
            raise ConfigurationError(f"There is no object '{name}'.{hint} Available: {', '.join(library)}.")
        if known in picked:
            raise ConfigurationError(
                f"The object '{known}' is named twice; an instruction could not tell them apart."
            )
        picked[known] = library[known]
    return picked


def spoken(name: str) -> str:
    """The everyday name of the object of that name: "cracker box" for ``003_cracker_box``."""
    words = name.replace("_", " ").replace("-", " ").lower().split()
    return " ".join(words[1:] if len(words) > 1 and words[0].isdigit() else words)


def _mesh_in(folder: Path) -> Path | None:
    """The mesh of a thing's own folder; None where there is none."""
    meshes = sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in SUFFIXES and not any(word in path.stem.lower() for word in NOT_SHOWN)
    )
    for stem in FAVOURITES:
        named = [path for path in meshes if path.stem.lower() == stem]
        if named:
            return named[0]
    if len(meshes) > 1:
        raise ConfigurationError(
            f"The folder {folder} holds {len(meshes)} meshes ({', '.join(p.name for p in meshes[:4])}, ...): name one "
            f"of them {FAVOURITES[0]}{meshes[0].suffix}, or leave only one."
        )
    return meshes[0] if meshes else None


def _inside(path: Path, folder: Path) -> str:
    return str(path.relative_to(folder))
