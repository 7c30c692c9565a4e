"""SAM3D and related programs: finished results, or runs from the user's own checkout in a separate process.

gvla2 ships neither their code nor their weights: both have their own licences.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

from gvla2 import Component, ComponentConfig, hookimpl

if TYPE_CHECKING:
    from gvla2.reconstruction.contracts import Reconstructor


@dataclass
class ResultTreeConfig(ComponentConfig):
    """Options of the ``result_tree`` reconstructor: which ``<root>/<object>/<views>views/result.{ply,glb}``."""

    root: str = ""
    object: str = ""
    views: int = 5
    """The number in the folder's name, ``5views``."""
    axes: str = "auto"
    """From the result's frame to the calibrated one: ``auto``, ``identity`` or a word such as ``perm012_signpnn``."""
    refine: bool = True
    """Refine position, turn and scale on the masks."""
    gaussians: int = 15_000
    """Approximate number of Gaussians on the mesh of a result without any."""


_RUNNER = "{plugin}/sam3d_runner.py"


@dataclass
class ExternalConfig(ComponentConfig):
    """Options of every external reconstructor.

    ``command`` is run in the checkout. In each of its words ``{python}``, ``{checkout}``, ``{plugin}``, ``{scene}``,
    ``{object}``, ``{output}``, ``{image}`` and ``{count}`` are filled in. ``{scene}`` holds the views three times: as
    ``images/0.png`` with RGBA masks ``{object}/0.png``, as ``render_mvs_25/model/000.{png,npy}``, and as
    ``cameras.json``; ``{image}`` is ``image.png`` with its mask ``0.png`` beside it: the view that shows most.
    """

    checkout: str = ""
    """Folder of the program's own repository."""
    python: str = "python"
    """Interpreter of the environment that it was installed into."""
    command: list[str] = field(default_factory=list)
    weights: str = "checkpoints/hf/pipeline.yaml"
    """Path relative to the checkout that must exist for the weights to count as downloaded; empty: none."""
    results: list[str] = field(default_factory=list)
    """Patterns of result files (.ply or .glb), relative to the checkout; the newest counts."""
    timeout_s: float = 3600.0
    keep: str = ""
    """Folder in which scene, output and log are kept; empty: a temporary one."""
    axes: str = "auto"
    """As in ``result_tree``."""
    refine: bool = True
    gaussians: int = 15_000


@dataclass
class MvSam3dConfig(ExternalConfig):
    """Options of ``mv_sam3d``: MV-SAM3D's run_inference_weighted.py on all views."""

    command: list[str] = field(
        default_factory=lambda: [
            "{python}", "run_inference_weighted.py", "--input_path", "{scene}", "--mask_prompt", "{object}",
        ]
    )  # fmt: skip
    results: list[str] = field(
        default_factory=lambda: ["visualization/{scene_name}/{object}/*/result.*", "{output}/**/result.*"]
    )


@dataclass
class Sam3dConfig(ExternalConfig):
    """Options of ``sam3d``: SAM 3D Objects on one view, by a small script of ours since it has no command."""

    command: list[str] = field(
        default_factory=lambda: ["{python}", _RUNNER, "--image", "{image}", "--output", "{output}"]
    )
    results: list[str] = field(default_factory=lambda: ["{output}/**/result.*"])


@dataclass
class FastSam3dConfig(ExternalConfig):
    """Options of ``fast_sam3d``: Fast-SAM3D's notebook/infer.py on one view."""

    command: list[str] = field(
        default_factory=lambda: [
            "{python}", "notebook/infer.py", "--image_path", "{image}", "--mask_index", "0",
            "--output_dir", "{output}", "--enable_acceleration",
        ]
    )  # fmt: skip
    results: list[str] = field(default_factory=lambda: ["{output}/**/result.*", "{output}/splat-faster-0.*"])


def _build(program: str, config: ExternalConfig) -> Reconstructor:
    from gvla2_plugins.sam3d.external import ExternalReconstructor

    return ExternalReconstructor(program, config)


def _finished(config: ResultTreeConfig) -> Reconstructor:
    """Reads a finished result and aligns it with the views' masks."""
    from gvla2_plugins.sam3d.result_tree import ResultTreeReconstructor

    return ResultTreeReconstructor(config)


@hookimpl
def gvla2_reconstructors() -> list[Component[Reconstructor]]:
    """``reconstructor=result_tree | mv_sam3d | sam3d | fast_sam3d``."""
    run = [
        Component(name, config, partial(_build, name), summary=f"Runs your checkout of {what}.")
        for name, config, what in (
            ("mv_sam3d", MvSam3dConfig, "MV-SAM3D on all views"),
            ("sam3d", Sam3dConfig, "SAM 3D Objects on the best view"),
            ("fast_sam3d", FastSam3dConfig, "Fast-SAM3D on the best view"),
        )
    ]
    return [Component("result_tree", ResultTreeConfig, _finished), *run]
