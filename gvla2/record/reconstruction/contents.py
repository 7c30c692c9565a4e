"""The record of one reconstruction: the inputs, each stage, and the measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from gvla2.geometry.views import Views
from gvla2.reconstruction.branch import BranchResult
from gvla2.reconstruction.contracts import Reconstruction
from gvla2.reconstruction.view_set import points_of
from gvla2.record.reconstruction.measures import Measures


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
        return self.displacement > 0 or self.recoloured

    @property
    def recoloured(self) -> bool:
        """Whether any base colour differs."""
        return self._colours(self.result.out) != self._colours(self.result.g0)

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

    def _colours(self, thing: Reconstruction) -> bytes:
        of_points = b"" if thing.gaussians is None else thing.gaussians.sh_dc.tobytes()
        if thing.mesh is None or thing.mesh.colours is None:
            return of_points
        return of_points + thing.mesh.colours.tobytes()
