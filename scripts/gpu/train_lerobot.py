"""`lerobot-train` where no video decoder is installed: OpenCV reads each film once, and memory keeps it.

    python scripts/gpu/train_lerobot.py --dataset.repo_id=local/x --dataset.root=FOLDER --policy.type=act ...

LeRobot 0.4 imports PyAV, 39 MB, also to read; and a part of it does not load with transformers 5, which ACT does not
use. Both are left out here; everything else is LeRobot's own.
"""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import torch

try:
    import av  # noqa: F401
except ImportError:
    sys.modules["av"] = ModuleType("av")
    sys.modules["av"].logging = SimpleNamespace(WARNING=24)

import lerobot.utils.import_utils as available

available._transformers_available = False

from lerobot.datasets import lerobot_dataset  # noqa: E402
from lerobot.scripts.lerobot_train import train  # noqa: E402

films: dict[str, tuple[float, np.ndarray]] = {}


def read(path: str) -> tuple[float, np.ndarray]:
    """Frames a second and pictures (T, 3, H, W) uint8 of a film."""
    if path not in films:
        film, pictures = cv2.VideoCapture(path), []
        fps = film.get(cv2.CAP_PROP_FPS)
        while (frame := film.read())[0]:
            pictures.append(frame[1][..., ::-1].transpose(2, 0, 1))
        films[path] = fps, np.ascontiguousarray(pictures)
    return films[path]


def decode(
    video_path: Path, timestamps: list[float], tolerance_s: float, backend: str | None = None
) -> torch.Tensor:
    """Pictures (N, 3, H, W) in [0, 1] at these seconds."""
    fps, pictures = read(str(video_path))
    return torch.from_numpy(pictures[[round(second * fps) for second in timestamps]]).float() / 255.0


if __name__ == "__main__":
    (root,) = [Path(word.partition("=")[2]) for word in sys.argv if word.startswith("--dataset.root=")]
    for place in sorted(root.glob("videos/**/*.mp4")):  # before the workers fork
        read(str(place))
    lerobot_dataset.decode_video_frames = decode
    train()
