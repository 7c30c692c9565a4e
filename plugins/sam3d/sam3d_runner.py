"""Runs SAM 3D Objects on one picture, inside its own environment and checkout (the working folder).

    python sam3d_runner.py --image scene/single/image.png --output out

The mask is ``0.png`` beside the picture. Writes ``result.ply``, ``result.glb`` and ``params.npz``, as MV-SAM3D does.
It imports nothing of gvla2.
"""

import argparse
from pathlib import Path


def main() -> None:
    """Parse, load, run, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--image", type=Path, required=True)
    parser.add_argument("--output", type=Path, required=True)
    parser.add_argument("--config", type=Path, default=Path("checkpoints/hf/pipeline.yaml"))
    parser.add_argument("--seed", type=int, default=42)
    arguments = parser.parse_args()

    import numpy as np
    from inference import Inference, load_image, load_single_mask  # the checkout's notebook/inference.py

    image = load_image(str(arguments.image))
    mask = load_single_mask(str(arguments.image.parent), index=0)
    made = Inference(str(arguments.config), compile=False)(image, mask, seed=arguments.seed)
    arguments.output.mkdir(parents=True, exist_ok=True)
    made["gs"].save_ply(str(arguments.output / "result.ply"))
    if made.get("glb") is not None:
        made["glb"].export(str(arguments.output / "result.glb"))
    pose = {
        name: np.asarray(made[name].detach().cpu() if hasattr(made[name], "detach") else made[name])
        for name in ("scale", "rotation", "translation")
        if made.get(name) is not None
    }
    if pose:
        np.savez(arguments.output / "params.npz", **pose)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
