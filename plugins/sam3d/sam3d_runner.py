"""Runs SAM 3D Objects on one picture, inside its own environment and checkout (the working folder).

    python sam3d_runner.py scene/single/image.png out

The mask is ``0.png`` beside the picture. Writes ``result.ply``, ``result.glb`` and ``params.npz``, as MV-SAM3D does.
It imports nothing of gvla2.
"""

import sys
from pathlib import Path
from typing import Any


def main(image: Path, output: Path) -> None:
    """Load, run, write."""
    import numpy as np
    from inference import Inference, load_image, load_single_mask  # the checkout's notebook/inference.py

    picture, mask = load_image(str(image)), load_single_mask(str(image.parent), index=0)
    made = Inference("checkpoints/hf/pipeline.yaml", compile=False)(picture, mask, seed=42)
    made["gs"].save_ply(str(output / "result.ply"))
    if made.get("glb") is not None:
        made["glb"].export(str(output / "result.glb"))
    pose = {name: made[name] for name in ("scale", "rotation", "translation") if made.get(name) is not None}
    tensors = {name: x.detach().cpu() if hasattr(x, "detach") else x for name, x in pose.items()}
    arrays: dict[str, Any] = {name: np.asarray(x) for name, x in tensors.items()}
    np.savez(output / "params.npz", **arrays)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
