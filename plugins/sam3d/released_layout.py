"""Trees of the authors' released code: ``<root>/<object>/5views/result.{ply,glb}``."""

from __future__ import annotations

import os
from pathlib import Path

from gvla2.errors import GeometryError


def result_folder(root: str | os.PathLike[str], name: str, views: int = 5) -> Path:
    """``<root>/<name>/<views>views``; raises :class:`GeometryError` saying which objects or folders there are."""
    tree = Path(root)
    folder = tree / name / f"{views}views"
    if folder.is_dir():
        return folder
    if not tree.is_dir():
        raise GeometryError(f"There is no result tree {tree}.")
    if not (tree / name).is_dir():
        present = ", ".join(objects(tree, views)) or "none"
        raise GeometryError(f"The result tree {tree} has no object '{name}'. Objects there: {present}.")
    present = ", ".join(sorted(p.name for p in (tree / name).iterdir() if p.is_dir())) or "none"
    raise GeometryError(f"There is no folder {folder}. Folders of '{name}': {present}.")


def objects(root: str | os.PathLike[str], views: int = 5) -> tuple[str, ...]:
    """The objects of a tree that have a result of so many views."""
    tree = Path(root)
    return (
        tuple(sorted(p.name for p in tree.iterdir() if (p / f"{views}views").is_dir()))
        if tree.is_dir()
        else ()
    )
