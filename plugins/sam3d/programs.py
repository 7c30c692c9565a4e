"""Each program's name, source and licence."""

from __future__ import annotations

from dataclasses import dataclass

_WEIGHTS = (
    "request access to facebook/sam-3d-objects on Hugging Face, `hf auth login`, then `hf download --repo-type model "
    "--local-dir checkpoints/hf-download facebook/sam-3d-objects` and move checkpoints/hf-download/checkpoints to "
    "checkpoints/hf"
)
_SAM = "SAM License of Meta"


@dataclass(frozen=True)
class ExternalProgram:
    """One external program; ``script`` is a file by which its checkout is known."""

    title: str
    source: str
    script: str
    licence: str
    weights: str = _WEIGHTS
    weights_licence: str = _SAM


PROGRAMS = {
    "mv_sam3d": ExternalProgram(
        "MV-SAM3D", "https://github.com/devinli123/MV-SAM3D", "run_inference_weighted.py", _SAM
    ),
    "sam3d": ExternalProgram(
        "SAM 3D Objects", "https://github.com/facebookresearch/sam-3d-objects", "notebook/inference.py", _SAM
    ),
    "fast_sam3d": ExternalProgram(
        "Fast-SAM3D",
        "https://github.com/wlfeng0509/Fast-SAM3D",
        "notebook/infer.py",
        "MIT, with parts under the SAM License of Meta",
    ),
}
