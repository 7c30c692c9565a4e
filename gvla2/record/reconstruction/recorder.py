"""Writes a reconstruction's folder: geometry and numbers first, then pictures and the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from gvla2.geometry.gaussians import write_gaussians
from gvla2.geometry.mesh import TriangleMesh
from gvla2.geometry.mesh_files import map_glb, read_mesh, write_mesh
from gvla2.io.files import write_bytes, write_json, write_text
from gvla2.reconstruction.contracts import Reconstruction, Renderer
from gvla2.record.files import FolderRecorder
from gvla2.record.page import render
from gvla2.record.reconstruction import maps, sections
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.pictures import ReconstructionPictures, turntables, view_pictures

PLY, GLB, RESULT, PAGE, TURNTABLE = "result.ply", "result.glb", "result.json", "index.html", "turntable.gif"


class ReconstructionRecorder(FolderRecorder):
    """The folder of one reconstruction.

    A picture that cannot be made becomes a note and a warning, never an error. Every method raises
    :class:`gvla2.errors.OutputError` when the folder cannot be written to; each file is then complete or unchanged.
    """

    def geometry(self, thing: Reconstruction) -> None:
        """``result.ply`` and ``result.glb``, as far as available."""
        if thing.gaussians is not None:
            write_gaussians(self.folder / PLY, thing.gaussians)
        else:
            self.notes.append(f"The reconstruction has no Gaussians, so there is no {PLY}.")
        if thing.mesh is not None and not self._textured(thing.mesh, thing.glb):
            write_mesh(self.folder / GLB, thing.mesh)
        elif thing.mesh is None:
            self.notes.append(f"The reconstruction has no mesh, so there is no {GLB}.")

    def _textured(self, mesh: TriangleMesh, source: Path | None) -> bool:
        """Write ``source`` with its vertices moved to the mesh's; False without one, or if the surface differs."""
        if source is None:
            return False
        before = read_mesh(source)
        if not np.array_equal(before.faces, mesh.faces):
            self.notes.append(
                f"The surface is a new one: {GLB} has colours, not the materials of {source.name}."
            )
            return False
        nearest = KDTree(before.vertices)
        map_glb(source, self.folder / GLB, lambda points: mesh.vertices[nearest.query(points)[1]])
        return True

    def numbers(self, record: ReconstructionRecord) -> None:
        """``result.json``."""
        write_json(self.folder / RESULT, self._noted(record).summary())

    def pictures(
        self, record: ReconstructionRecord, renderer: Renderer, frames: int
    ) -> ReconstructionPictures:
        """All pictures that can be made; ``turntable.gif`` into the folder."""
        if record.measures is None:
            return ReconstructionPictures()
        given = (record.views, record.measures, renderer)
        views = self.attempt("The pictures of the views", lambda: view_pictures(*given)) or ()
        hero, turning = self.attempt("The turntable", lambda: turntables(*given, frames)) or (b"", b"")
        if turning:
            write_bytes(self.folder / TURNTABLE, turning)
        return ReconstructionPictures(views, hero, turning)

    def page(self, record: ReconstructionRecord, pictures: ReconstructionPictures) -> Path:
        """``index.html``; returns its path. ``result.json`` is rewritten with the notes on pictures."""
        path = self.folder / PAGE
        page = render_reconstruction(self._noted(record), pictures, self.config, self.there())
        write_text(path, page)
        self.numbers(record)
        return path

    def _noted(self, record: ReconstructionRecord) -> ReconstructionRecord:
        return replace(record, notes=(*record.notes, *self.notes))


def render_reconstruction(
    record: ReconstructionRecord,
    pictures: ReconstructionPictures,
    config_yaml: str = "",
    beside: Sequence[str] = (),
) -> str:
    """The page as HTML text, also without measures and without pictures.

    ``beside`` are names of files beside the page.
    """
    known = {"record": record, "pictures": pictures, "config_yaml": config_yaml, "beside": beside}
    return render("reconstruction.html.jinja", maps=maps, sections=sections, **known)
