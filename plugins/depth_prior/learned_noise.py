"""Errors of a network's depth: the options of ``prior=depth prior.noise=learned``."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class LearnedNoise:
    """Errors of a network's depth of S views; isolate a part by setting the others to 0.

    ``global_scale``: a factor on all depths and poses, drawn within +- this share. ``view_scale`` and ``view_shift``:
    the same for each view by itself; a shift is a share of its median depth. ``low_frequency``: standard deviation of a
    smooth relative error, correlated over ``correlation`` picture widths. ``slope``: depth tilts by up to this share
    from the middle of the object to its rim, in a different direction for each view. ``pose_degrees`` and
    ``pose_shift`` (share of the camera's distance): errors of the cameras that the estimate carries. ``edge_blur``:
    standard deviation in pixels by which depth mixes with what lies behind it. ``outliers``: share of the picture under
    round patches that lie up to ``outlier_size`` off. ``confidence``: 0 reports the error's true size, 1 is right only
    half of the time.
    """

    global_scale: float = 0.3
    view_scale: float = 0.0
    view_shift: float = 0.0
    low_frequency: float = 0.01
    correlation: float = 0.1
    slope: float = 0.0
    pose_degrees: float = 1.0
    pose_shift: float = 0.01
    edge_blur: float = 1.0
    outliers: float = 0.0
    outlier_size: float = 0.15
    confidence: float = 0.5
