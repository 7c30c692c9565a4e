"""Conformance of reconstructors, geometry priors, axis compensations, fusion strategies and renderers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gvla2.geometry.camera import Camera
from gvla2.geometry.exchange import require, require_array, require_rigid, require_type
from gvla2.geometry.transform import look_along
from gvla2.reconstruction.contracts import (
    AxisCompensation,
    AxisFit,
    FusionStrategy,
    GeometryEstimate,
    GeometryPrior,
    Reconstruction,
    Reconstructor,
    Renderer,
)
from gvla2.testing import inputs
from gvla2.testing.conformance import allowed, require_members


def check_reconstructor(reconstructor: Reconstructor) -> None:
    """One cube with its silhouettes in three views; the result lies at the cube's place."""
    require_members(reconstructor, "reconstructor")
    with allowed("reconstruct()"):
        made = reconstructor.reconstruct(inputs.views(masked=inputs.RED))
    if made is None:
        return
    require_type(made, Reconstruction, "reconstruct()'s answer")
    require(made.status, "A reconstruction's status is 'ok' or a reason, never empty.")
    if made.status == "ok":
        require(
            made.gaussians is not None or made.mesh is not None, "A reconstruction has Gaussians or a mesh."
        )
    centre = inputs.RED.world_from_block[:3, 3]
    for what, points in (
        ("Gaussians", made.gaussians.centres if made.gaussians is not None else None),
        ("mesh", made.mesh.vertices if made.mesh is not None else None),
    ):
        if points is not None and len(points):
            middle = np.median(require_array(points, (None, 3), f"Points of the {what}"), axis=0)
            gap = float(np.linalg.norm(middle - centre))
            require(gap < inputs.RED.side, f"The {what} lie {gap:.3f} m off the object, in another frame?")


def check_prior(prior: GeometryPrior) -> None:
    """Three views with and one view without depth."""
    require_members(prior, "prior")
    full = inputs.views(masked=inputs.RED)
    colour_only = replace(full, views=(replace(full[0], depth=None, mask=None),))
    for what, views in (("three RGB-D views", full), ("one colour view", colour_only)):
        with allowed(f"predict() of {what}"):
            answer = prior.predict(views)
        if answer is None:
            continue
        require_type(answer, GeometryEstimate, f"predict()'s answer to {what}")
        shape = (len(views), views[0].camera.height, views[0].camera.width)
        depth = require_array(answer.depth, shape, f"depth of {what}", finite=False)
        require(not np.isinf(depth).any(), "Unknown depth is NaN, never infinite.")
        require((depth[np.isfinite(depth)] > 0).all(), "Depth lies before the camera: it must be positive.")
        confidence = require_array(answer.confidence, shape, f"confidence of {what}", finite=False)
        known = confidence[np.isfinite(depth)]
        require((known >= 0).all(), "Confidence must be a number >= 0 wherever depth is known.")
        if answer.world_from_camera is not None:
            poses = require_array(answer.world_from_camera, (len(views), 4, 4), "world_from_camera")
            for i, pose in enumerate(poses):
                require_rigid(pose, f"world_from_camera[{i}]")


def check_axis(axis: AxisCompensation) -> None:
    """A ball in three views, in place and too large, and no points at all."""
    require_members(axis, "axis")
    views = inputs.views(masked=inputs.RED)
    middle = inputs.RED.world_from_block[:3, 3]
    points = middle + 0.5 * inputs.RED.side * np.random.default_rng(5).uniform(-1, 1, (2000, 3))
    for what, given in {"a cube": points, "a swollen cube": middle + 1.05 * (points - middle)}.items():
        with allowed(f"compensate() of {what}"):
            fit = axis.compensate(given, views, middle)
        require_type(fit, AxisFit, f"compensate()'s answer to {what}")
        require(fit.reason, "An axis fit gives its reason, accepted or not.")
        moved = require_array(fit.apply(given), (len(given), 3), f"The fit applied to {what}")
        off = float(np.linalg.norm(moved - given, axis=1).max())
        require(off < inputs.RED.side, f"The fit moves {what} by {off:.3f} m: farther than it is wide.")
        require(
            fit.accepted or off == 0.0, "A fit that is not accepted must leave all points where they are."
        )


def check_fusion(fusion: FusionStrategy) -> None:
    """Two noisy versions of one ball, equal ones, unsupported ones and empty ones."""
    require_members(fusion, "fusion")
    rng = np.random.default_rng(11)
    a = inputs.ball(200).centres.astype(np.float64)
    b = a + rng.normal(scale=0.004, size=a.shape)
    sure, some = np.ones(len(a)), rng.uniform(0, 1, len(a))
    for array in (a, b, sure, some):
        array.setflags(write=False)
    nothing, empty = np.zeros(len(a)), np.zeros((0, 3))
    for what, (p, q, u, v) in {
        "two sources": (a, b, some, sure),
        "equal sources": (a, a, some, some),
        "sources without support": (a, b, nothing, nothing),
        "empty sources": (empty, empty, nothing[:0], nothing[:0]),
    }.items():
        with allowed(f"fuse() of {what}"):
            fused = require_array(fusion.fuse(p, q, u, v), (len(p), 3), f"fuse()'s answer to {what}")
        if p is q and len(p):
            off = float(np.abs(fused - p).max())
            require(off < 1e-6, f"Equal sources must fuse to themselves, got centres {off:.2g} m away.")


def check_renderer(renderer: Renderer) -> None:
    """A ball before the camera, behind it, and nothing at all."""
    require_members(renderer, "renderer")
    background = (0.2, 0.4, 0.6)
    before = Camera.from_fov(0.8, look_along([0.0, -0.5, 0.0], [0.0, 1.0, 0.0]), 33, 25)
    behind = Camera.from_fov(0.8, look_along([0.0, -0.5, 0.0], [0.0, -1.0, 0.0]), 33, 25)
    ball = inputs.ball()
    arrays = ("centres", "log_scales", "rotations", "opacity_logits", "sh_dc")
    none = replace(ball, **{name: getattr(ball, name)[:0] for name in arrays})
    for what, gaussians, camera in (
        ("a ball", ball, before),
        ("a ball behind the camera", ball, behind),
        ("no Gaussians", none, before),
    ):
        with allowed(f"render() of {what}"):
            image, alpha = renderer.render(gaussians, camera, background)
        image = require_array(image, (25, 33, 3), f"The image of {what}")
        alpha = require_array(alpha, (25, 33), f"The alpha of {what}")
        for name, array in (("image", image), ("alpha", alpha)):
            require(array.dtype == np.float32, f"The {name} must be float32, got {array.dtype}.")
            require(
                (array >= -1e-4).all() and (array <= 1 + 1e-4).all(),
                f"The {name} of {what} leaves [0, 1]: {array.min():.3f} to {array.max():.3f}.",
            )
        if what == "a ball":
            require(alpha[12, 16] > 0.5, f"The middle of a ball has alpha {alpha[12, 16]:.2f}; it is opaque.")
            off = float(np.abs(image[12, 16] - [0.9, 0.2, 0.1]).max())
            require(off < 0.15, f"The ball's colour is off by {off:.2f}.")
            corner = float(np.abs(image[0, 0] - background).max())
            require(
                alpha[0, 0] < 0.05 and corner < 0.05, "A corner without Gaussians must show the background."
            )
        else:
            require(alpha.max() < 1e-3, f"{what} must be invisible, but alpha reaches {alpha.max():.3f}.")
