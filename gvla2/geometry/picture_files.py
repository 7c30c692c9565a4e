"""Image files as arrays: colour on white, and masks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from gvla2.errors import GeometryError


def read_picture(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.float32] | None]:
    """Colour (H, W, 3) uint8 laid on white, and alpha (H, W) in [0, 1], None for an opaque file."""
    with _open(path) as picture:
        if "A" not in picture.getbands() and "transparency" not in picture.info:
            return np.asarray(picture.convert("RGB")), None
        rgba = np.asarray(picture.convert("RGBA"), dtype=np.float32) / np.float32(255)
    alpha = rgba[..., 3:]
    on_white = rgba[..., :3] * alpha + (1 - alpha)
    return np.asarray(255 * np.clip(on_white, 0, 1), dtype=np.uint8), np.ascontiguousarray(alpha[..., 0])


def read_mask(path: Path) -> NDArray[np.float32]:
    """(H, W) in [0, 1]: the alpha of a transparent file, else its grey value."""
    with _open(path) as picture:
        transparent = "A" in picture.getbands() or "transparency" in picture.info
        layer = picture.convert("RGBA").getchannel("A") if transparent else picture.convert("L")
        return np.asarray(layer, dtype=np.float32) / np.float32(255)


def _open(path: Path) -> Image.Image:
    try:
        picture = Image.open(path)
        picture.load()
    except FileNotFoundError:
        raise GeometryError(f"The image {path} is missing.") from None
    except (OSError, UnidentifiedImageError, SyntaxError, ValueError) as error:
        raise GeometryError(f"Cannot read the image {path}: {error}") from error
    return picture
