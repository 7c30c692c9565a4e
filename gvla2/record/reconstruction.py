"""The record of one reconstruction: inputs, stages and measures, their words, and the folder with its page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gvla2.geometry.gaussians import write_gaussians
from gvla2.geometry.mesh_files import write_mesh
from gvla2.geometry.views import Views
from gvla2.io.files import plain, write_json, write_text
from gvla2.reconstruction.branch import BranchResult
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.options import BranchOptions
from gvla2.reconstruction.view_set import points_of
from gvla2.record import reconstruction_measures
from gvla2.record.origin import Origin
from gvla2.record.page import render
from gvla2.record.reconstruction_measures import (
    Measures,
    ViewPictures,
    drawable,
    view_pictures,
)
from gvla2.record.recorder import FolderRecorder
from gvla2.record.wording import State, fixed


@dataclass(frozen=True)
class ReconstructionRecord:
    """One object's reconstruction, from views to refined geometry.

    ``folder`` is the source of the views; ``choices`` the component names by Hydra group; ``options`` the branch's;
    ``truth`` the mesh file that it was measured against, "" for none; ``timings`` wall seconds per step; ``notes``
    fallbacks and warnings, each a sentence.
    """

    name: str
    folder: str
    views: Views
    choices: Mapping[str, str]
    options: Mapping[str, Any]
    result: BranchResult
    measures: Measures | None = None
    truth: str = ""
    timings: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def changed(self) -> bool:
        """Whether the output differs from the first reconstruction at all."""
        before, after = (drawable(end).sh_dc for end in (self.result.g0, self.result.out))
        return self.displacement > 0 or not np.array_equal(before, after)

    @property
    def displacement(self) -> float:
        """Mean distance that points moved by, in the views' unit; 0 when nothing moved.

        For a new surface, with different points, the mean distance from the nearest point of the first one.
        """
        before, after = points_of(self.result.g0), points_of(self.result.out)
        if before.shape != after.shape:
            return float(np.mean(cKDTree(before).query(after)[0]))
        return float(np.linalg.norm(after - before, axis=1).mean())

    @property
    def size(self) -> float:
        """Longest side of the first reconstruction's box, in the views' unit."""
        points = points_of(self.result.g0)
        return float((points.max(axis=0) - points.min(axis=0)).max())

    def numbers(self) -> dict[str, float]:
        """The result's measures by name, those in held-out views as ``held_out_psnr``, and the seconds of all steps."""
        groups = self.measures.groups if self.measures else {}
        found = {"symmetric_iou": math.nan, "seconds": sum(self.timings.values())}
        for group, prefix in (("inputs", ""), ("held_out", "held_out_"), ("truth", "")):
            found |= {f"{prefix}{name}": value for name, value in groups.get(group, ({}, {}))[1].items()}
        return found

    def summary(self) -> dict[str, Any]:
        """``result.json``: the options and choices, each stage's status with its reason, and all measures."""
        out, measures = self.result.out, self.measures
        return {
            "command": "reconstruct",
            "object": self.name,
            "status": out.status,
            "changed": self.changed,
            "views": {
                "folder": self.folder,
                "count": len(self.views),
                "names": [view.name for view in self.views],
                "sizes": [[view.camera.width, view.camera.height] for view in self.views],
            },
            "choices": dict(self.choices),
            "branch": dict(self.options),
            "gaussians": None if out.gaussians is None else len(out.gaussians),
            "vertices": None if out.mesh is None else len(out.mesh.vertices),
            "faces": None if out.mesh is None else len(out.mesh.faces),
            "displacement": self.displacement,
            "stages": list(self.result.stages),
            "truth": self.truth or None,
            "metrics": None if measures is None else measures.summary(),
            "timings": dict(self.timings),
            "notes": list(self.notes),
        }


STATES: Mapping[str, State] = {
    "applied": "done",
    "partial": "done",
    "rejected": "warn",
    "fallback": "warn",
    "skipped": "skipped",
}
"""The mark of each stage status."""

_STILL = 1e-4  # mean displacement, as a share of the size, below which an object counts as unmoved
_STEADY = 5e-4  # relative change below which a number counts as unchanged


@dataclass(frozen=True)
class BeforeAfter:
    """A number before and after the branch, and how it is shown: its name, decimals, whether more is better."""

    label: str
    digits: int
    more_is_better: bool
    note: str
    before: float = math.nan
    after: float = math.nan

    @property
    def change(self) -> float | None:
        """Relative change; None when undefined."""
        if not self.before or not math.isfinite(self.before) or not math.isfinite(self.after):
            return None
        return (self.after - self.before) / abs(self.before)

    @property
    def tone(self) -> str:
        """Whether the number improved ("good"), got worse ("bad") or hardly changed ("idle")."""
        change = self.change
        if change is None or abs(change) < _STEADY:
            return "idle"
        return "good" if (change > 0) == self.more_is_better else "bad"

    @property
    def change_text(self) -> str:
        """The number before and after ("0.9012 → 0.9311"), or after alone where no change is defined."""
        before, after = fixed(self.before, self.digits), fixed(self.after, self.digits)
        return after if self.change is None else f"{before} → {after}"


MEASURES: Mapping[str, BeforeAfter] = {
    "symmetric_iou": BeforeAfter("symmetric IoU", 4, True, "overlap of silhouettes and masks, both ways"),
    "psnr": BeforeAfter("PSNR, dB", 2, True, "colours, on white"),
    "ssim": BeforeAfter("SSIM", 4, True, "structure, uniform 7 × 7 window"),
    "cd_surface": BeforeAfter(
        "CD surface × 10³", 2, False, "in the views’ frame: place, scale and shape count"
    ),
    "cd_official": BeforeAfter("CD official × 10³", 2, False, "each shape in its own unit box"),
}
"""How each measure is shown."""


def compared(record: ReconstructionRecord, group: str, name: str) -> BeforeAfter | None:
    """A number of the record; None when it was not measured."""
    before, after = record.measures.groups.get(group, ({}, {})) if record.measures else ({}, {})
    if name not in after:
        return None
    return replace(MEASURES[name], before=before.get(name, math.nan), after=after[name])


def headline(record: ReconstructionRecord) -> tuple[str, str]:
    """The outcome in a few words, and its tone, by the best evidence: a true mesh, else unused views, else masks."""
    if not record.changed:
        return "Kept as first made", "idle"
    if record.displacement < _STILL * record.size:
        return "Hardly moved", "idle"
    for group, name, worse in (
        ("truth", "cd_surface", "farther from the truth"),
        ("held_out", "psnr", "unused views fit worse"),
        ("inputs", "symmetric_iou", "masks fit a little worse"),
    ):
        number = compared(record, group, name)
        if number is not None:
            return (f"Refined, {worse}", "unsure") if number.tone == "bad" else ("Refined", "good")
    return "Refined", "good"


def unusual_options(record: ReconstructionRecord) -> dict[str, str]:
    """The branch's options that differ from the defaults."""
    return BranchOptions(**record.options).changed()


def summary_line(record: ReconstructionRecord) -> str:
    """The outcome on one line, for the terminal."""
    parts = [headline(record)[0].lower()]
    for group, name, where in (
        ("inputs", "symmetric_iou", ""),
        ("held_out", "psnr", " held out"),
        ("truth", "cd_surface", ""),
    ):
        number = compared(record, group, name)
        if number is not None:
            parts.append(f"{number.label} {number.change_text}{where}")
    return f"{record.name}: {', '.join(parts)}"


PLY, GLB, RESULT, PAGE = "result.ply", "result.glb", "result.json", "index.html"


class ReconstructionRecorder(FolderRecorder):
    """The folder of one reconstruction.

    A picture that cannot be made becomes a note and a warning, never an error. Every method raises
    :class:`gvla2.errors.OutputError` when the folder cannot be written to; each file is then complete or unchanged.
    """

    def geometry(self, made: Reconstruction) -> None:
        """``result.ply`` and ``result.glb``, as far as available."""
        if made.gaussians is not None:
            write_gaussians(self.folder / PLY, made.gaussians)
        else:
            self.notes.append(f"The reconstruction has no Gaussians, so there is no {PLY}.")
        if made.mesh is not None:
            write_mesh(self.folder / GLB, made.mesh)
        else:
            self.notes.append(f"The reconstruction has no mesh, so there is no {GLB}.")

    def numbers(self, record: ReconstructionRecord) -> None:
        """``result.json``."""
        summary = {**self._noted(record).summary(), "origin": plain(self.origin)}
        write_json(self.folder / RESULT, summary)

    def pictures(self, record: ReconstructionRecord) -> tuple[ViewPictures, ...]:
        """The pictures of the views; none where they cannot be made, or nothing was measured."""
        if record.measures is None:
            return ()
        given = (record.views, record.measures)
        return self.attempt("The pictures of the views", lambda: view_pictures(*given)) or ()

    def page(self, record: ReconstructionRecord, pictures: Sequence[ViewPictures]) -> Path:
        """``index.html``; returns its path. ``result.json`` is rewritten with the notes on pictures."""
        path = self.folder / PAGE
        page = render_reconstruction(self._noted(record), pictures, self.config, self.there(), self.origin)
        write_text(path, page)
        self.numbers(record)
        return path

    def _noted(self, record: ReconstructionRecord) -> ReconstructionRecord:
        return replace(record, notes=(*record.notes, *self.notes))


def render_reconstruction(
    record: ReconstructionRecord,
    pictures: Sequence[ViewPictures] = (),
    config_yaml: str = "",
    beside: Sequence[str] = (),
    origin: Origin | None = None,
) -> str:
    """The page as HTML text, also without measures and without pictures.

    ``beside`` are names of files beside the page.
    """
    known = {"record": record, "pictures": pictures, "config_yaml": config_yaml, "beside": beside}
    known["origin"] = origin or Origin()
    words = SimpleNamespace(
        STATES=STATES, compared=compared, headline=headline, unusual_options=unusual_options
    )
    return render("reconstruction.html.jinja", pictured=reconstruction_measures, words=words, **known)
