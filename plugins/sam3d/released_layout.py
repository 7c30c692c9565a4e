"""Trees and tables of the authors' released code: ``<root>/<object>/5views/result.{ply,glb}`` and its CSV files."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gvla2.errors import GeometryError

SUMMARIES: Mapping[str, str] = {
    "soft_visual_hull_summary.csv": "soft_hull",
    "axis_refine_meshsync_summary.csv": "axis",
    "geometry_only_blend_summary.csv": "fusion",
}
"""The table's name of each released script, and our stage for it."""


@dataclass(frozen=True)
class SummaryRow:
    """One object's row: ``status`` is ``ok`` or the script's reason; ``measures`` are its numbers by column,
    ``words`` its other cells. Empty cells are left out.
    """

    object: str
    status: str
    measures: Mapping[str, float]
    words: Mapping[str, str]


def find_summaries(root: str | os.PathLike[str]) -> dict[str, Path]:
    """Stage -> table for those of :data:`SUMMARIES` that lie in a tree's root."""
    return {stage: p for name, stage in SUMMARIES.items() if (p := Path(root) / name).is_file()}


def read_summary(path: str | os.PathLike[str]) -> tuple[SummaryRow, ...]:
    """The rows of a table in the file's order; raises :class:`GeometryError`, naming the file, when it is none."""
    source = Path(path)
    try:
        with source.open(newline="", encoding="utf-8") as stream:
            reader = csv.DictReader(stream, restval="")
            if "object" not in (reader.fieldnames or ()):
                raise ValueError("it has no column 'object'")
            return tuple(_row({k: v for k, v in row.items() if isinstance(v, str)}) for row in reader)
    except (OSError, ValueError, csv.Error) as error:
        raise GeometryError(f"Cannot read the summary {source}: {error}.") from error


def _row(cells: Mapping[str, str]) -> SummaryRow:
    measures: dict[str, float] = {}
    words: dict[str, str] = {}
    for name, cell in cells.items():
        if name in ("object", "status") or not cell:
            continue
        try:
            measures[name] = float(cell)
        except ValueError:
            words[name] = cell
    return SummaryRow(cells["object"], cells.get("status", ""), measures, words)


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
