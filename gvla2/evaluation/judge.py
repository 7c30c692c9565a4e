"""Judging a reconstruction of one object by its held-out views and its true shape."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gvla2.evaluation.lpips import Features, Lpips
from gvla2.evaluation.metrics import (
    SURFACE_SAMPLES,
    Truth,
    cd_official,
    cd_surface,
    psnr,
    ssim,
    surface_points,
)
from gvla2.evaluation.protocol import ObjectViews
from gvla2.geometry.gaussians import Gaussians
from gvla2.reconstruction.contracts import Reconstruction, Renderer

MEASURES = ("cd_surface", "cd_official", "psnr", "ssim", "lpips")


@dataclass(frozen=True)
class ReconstructionScores:
    """The measures by name (None: not measured), and which points the surface distance used."""

    measures: Mapping[str, float | None]
    cd_points: str


@dataclass
class ReconstructionJudge:
    """Measures reconstructions of one object; the truth is prepared once.

    ``workers`` is the number of threads for nearest neighbours, -1 for all cores;
    ``samples`` how many points of a surface are compared. Equal reconstructions are measured
    once, so a branch that changed nothing has exactly its input's numbers.
    """

    views: ObjectViews
    renderer: Renderer
    lpips: Lpips | None = None
    workers: int = -1
    samples: int = SURFACE_SAMPLES
    _truth: Truth | None = field(init=False, repr=False)
    _targets: list[NDArray[np.float32]] = field(init=False, repr=False)
    _features: list[Features] | None = field(init=False, repr=False)
    _known: dict[str, ReconstructionScores] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._truth = None if self.views.mesh is None else Truth.of(self.views.mesh, self.samples)
        self._targets = [(view.image / 255).astype(np.float32) for view in self.views.targets]
        self._features = None if self.lpips is None else [self.lpips.features(t) for t in self._targets]

    def measure(self, thing: Reconstruction) -> ReconstructionScores:
        """All measures; the image measures are means over the target views."""
        digest = _digest(thing)
        if digest not in self._known:
            self._known[digest] = self._measure(thing)
        return self._known[digest]

    def _measure(self, thing: Reconstruction) -> ReconstructionScores:
        measures: dict[str, float | None] = dict.fromkeys(MEASURES)
        points = "none"
        if self._truth is not None:
            centres = None if thing.gaussians is None else thing.gaussians.centres.astype(np.float64)
            surface, points = surface_points(thing.mesh, centres, self.samples)
            vertices = thing.mesh.vertices if thing.mesh is not None and points == "mesh" else surface
            measures["cd_surface"] = cd_surface(surface, self._truth, self.workers)
            measures["cd_official"] = cd_official(vertices, self._truth, self.workers)
        if thing.gaussians is not None:
            images = self.pictures(thing.gaussians)
            pairs = list(zip(images, self._targets, strict=True))
            measures["psnr"] = float(np.mean([psnr(*pair) for pair in pairs]))
            measures["ssim"] = float(np.mean([ssim(*pair) for pair in pairs]))
            if self.lpips is not None and self._features is not None:
                seen = [self.lpips.features(image) for image in images]
                distances = map(self.lpips.between, seen, self._features)
                measures["lpips"] = float(np.mean(list(distances)))
        return ReconstructionScores(measures, points)

    def pictures(self, gaussians: Gaussians, count: int | None = None) -> list[NDArray[np.float32]]:
        """The target views (the first ``count``) rendered on white, each (H, W, 3) in [0, 1]."""
        cameras = [view.camera for view in self.views.targets][:count]
        return [np.clip(self.renderer.render(gaussians, camera)[0], 0, 1) for camera in cameras]


def _digest(thing: Reconstruction) -> str:
    digest = hashlib.sha256()
    if thing.gaussians is not None:
        g = thing.gaussians
        for array in (g.centres, g.log_scales, g.rotations, g.opacity_logits, g.sh_dc, g.sh_rest):
            digest.update(b"-" if array is None else np.ascontiguousarray(array).tobytes())
    if thing.mesh is not None:
        digest.update(np.ascontiguousarray(thing.mesh.vertices).tobytes())
        digest.update(np.ascontiguousarray(thing.mesh.faces).tobytes())
    return digest.hexdigest()
