"""Copy a checkpoint of LeRobot, its weights in half precision: `python scripts/gpu/pack.py CHECKPOINT TO`."""

import shutil
import sys
from pathlib import Path

from safetensors.torch import load_file, save_file

WEIGHTS = "model.safetensors"

checkpoint, to = map(Path, sys.argv[1:])
shutil.copytree(checkpoint, to, ignore=shutil.ignore_patterns(WEIGHTS))
weights = load_file(checkpoint / WEIGHTS).items()
save_file({name: one.half() if one.is_floating_point() else one for name, one in weights}, to / WEIGHTS)
