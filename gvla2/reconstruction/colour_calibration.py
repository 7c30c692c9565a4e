"""One global affine of an object's base colours, fitted to the input views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.gaussians import SH_C0
from gvla2.geometry.transform import FloatArray
from gvla2.geometry.views import View, Views
from gvla2.reconstruction.appearance import fit_affine
from gvla2.reconstruction.contracts import Reconstruction, Renderer, StageReport
from gvla2.reconstruction.support import mask_of

SOLID = 0.9
"""Pixels count where mask and rendered alpha are above this: silhouettes' edges are no evidence of colour."""

LEAST_GAIN = 0.10
"""The mean absolute error must fall by this share, or the colours stay as they are: colours that came from the inputs
themselves always leave a per cent or two to gain, at the cost of the views that nobody saw."""


def calibrate_colours(
    thing: Reconstruction, views: Views, renderer: Renderer
) -> tuple[Reconstruction, StageReport]:
    """The object with its base colours (SH-DC, mesh colours) under the median of the views' affines (g, b).

    Kept only when the renders come nearer to the inputs; geometry, opacity and higher harmonics are untouched.
    """
    if thing.gaussians is None:
        return thing, StageReport("appearance", "skipped", "There are no Gaussians to render.")
    shots = [(view, *renderer.render(thing.gaussians, view.camera)) for view in views]
    fits = [fit_affine(rendered, view.image, _solid(view, alpha)) for view, rendered, alpha in shots]
    clear = [(fit.gain, fit.bias) for fit in fits if not fit.reason]
    if not clear:
        reason = "No view shows enough of the object to compare colours."
        return thing, StageReport("appearance", "skipped", reason)
    before = float(np.nanmean([_error(*shot) for shot in shots]))
    gain, bias = np.median(clear, axis=0)
    # A picture of solid things takes the affine as its Gaussians do: what cannot gain so is not rendered again.
    after = float(np.nanmean([_error(view, gain * image + bias, alpha) for view, image, alpha in shots]))
    calibrated = _recoloured(thing, gain, bias)
    if after <= (1 - LEAST_GAIN) * before:
        assert calibrated.gaussians is not None
        painted = ((view, *renderer.render(calibrated.gaussians, view.camera)) for view in views)
        after = float(np.nanmean([_error(*shot) for shot in painted]))
    measures = {"colour_error": before}, {"colour_error": after}
    if after > (1 - LEAST_GAIN) * before:
        reason = "An affine of the colours does not bring the renders nearer to the inputs."
        return thing, StageReport("appearance", "rejected", reason, *measures)
    reason = f"Gain {np.round(gain, 3).tolist()}, bias {np.round(bias, 3).tolist()}."
    return calibrated, StageReport("appearance", "applied", reason, *measures)


def _error(view: View, rendered: np.ndarray, alpha: np.ndarray) -> float:
    solid = _solid(view, alpha)
    error = np.abs(rendered[solid] - view.image[solid] / 255.0)
    return float(error.mean()) if error.size else float("nan")


def _solid(view: View, alpha: np.ndarray) -> np.ndarray:
    return np.asarray((mask_of(view) > SOLID) & (alpha > SOLID))


def _recoloured(thing: Reconstruction, gain: FloatArray, bias: FloatArray) -> Reconstruction:
    assert thing.gaussians is not None
    sh_dc = ((gain * thing.gaussians.rgb + bias - 0.5) / SH_C0).astype(np.float32)
    gaussians, mesh = replace(thing.gaussians, sh_dc=sh_dc), thing.mesh
    if mesh is not None and mesh.colours is not None:
        mesh = replace(mesh, colours=np.clip(gain * mesh.colours + bias, 0.0, 1.0))
    return replace(thing, gaussians=gaussians, mesh=mesh)
