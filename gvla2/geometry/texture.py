"""Textures of a surface, filtered to the size of the pixels that see it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from gvla2.geometry.textured_mesh import TexturedMesh
from gvla2.geometry.transform import FloatArray

LEVELS = 7
"""Levels of a pyramid: from the image's own texels to 64 of them in one."""


@dataclass(frozen=True)
class Texture:
    """The images on a surface's faces, each as a pyramid of averages.

    ``uv`` (F, 3, 2) texture coordinates of each face's corners, v upwards; ``image`` (F,) which image, -1 for none;
    ``density`` (F,) texels a metre; ``pyramids``: per image, levels (H, W, 3) float32 in [0, 1], each half of the
    one before.

    A pixel that spans many texels shows their mean, as a camera's does; taking one of them would turn fine print into
    noise. Unused parts of an image (often black) do not enter the means.
    """

    uv: NDArray[np.float32]
    image: NDArray[np.int64]
    density: FloatArray
    pyramids: tuple[tuple[NDArray[np.float32], ...], ...]

    @classmethod
    def of(cls, textured: TexturedMesh) -> Texture | None:
        """The texture of a mesh; None if it has none."""
        if not textured.images:
            return None
        uv = np.asarray(textured.uv, dtype=np.float32)
        inside = (
            uv
            - np.where((uv.min(axis=1) < 0) | (uv.max(axis=1) > 1), np.floor(uv.mean(axis=1)), 0.0)[:, None]
        )
        uv = np.clip(inside, 0.0, 1.0).astype(np.float32)
        sizes = np.array([image.shape[1::-1] for image in textured.images], dtype=np.float64)  # (I, 2) w, h
        texels = uv * sizes[np.maximum(textured.texture, 0)][:, None]
        a, b = texels[:, 1] - texels[:, 0], texels[:, 2] - texels[:, 0]
        painted = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        area = textured.mesh.areas
        density = np.sqrt(np.divide(painted, area, out=np.zeros_like(area), where=area > 0))
        pyramids = tuple(
            _pyramid(image, uv[textured.texture == number]) for number, image in enumerate(textured.images)
        )
        return cls(uv, np.asarray(textured.texture, dtype=np.int64), density, pyramids)

    def at(self, faces: NDArray[np.int64], weights: FloatArray, footprint: FloatArray) -> FloatArray:
        """(N, 3) colours in [0, 1] where pixels meet faces (N,) at barycentric ``weights`` (N, 3).

        ``footprint`` (N,) is how many metres of the surface a pixel spans there. White where a face has no image.
        """
        colours = np.ones((len(faces), 3))
        spot = np.einsum("nk,nkc->nc", weights, self.uv[faces])
        with np.errstate(divide="ignore"):
            level = np.rint(np.log2(np.maximum(footprint * self.density[faces], 1.0))).astype(int)
        for number, pyramid in enumerate(self.pyramids):
            mine = self.image[faces] == number
            for depth in np.unique(np.minimum(level[mine], len(pyramid) - 1)):
                chosen = mine & (np.minimum(level, len(pyramid) - 1) == depth)
                colours[chosen] = bilinear(pyramid[depth], spot[chosen])
        return colours


def _pyramid(image: NDArray[np.uint8], uv: NDArray[np.float32]) -> tuple[NDArray[np.float32], ...]:
    """The image's averages over the texels that faces ``uv`` (F, 3, 2) use."""
    height, width = image.shape[:2]
    canvas = Image.new("1", (width, height))
    draw = ImageDraw.Draw(canvas)
    corners = (uv * (width, height)).astype(np.float64)
    corners[..., 1] = height - corners[..., 1]
    for face in corners:
        draw.polygon([(float(x), float(y)) for x, y in face], fill=1, outline=1)
    weight = np.asarray(canvas, dtype=np.float32)[..., None]
    colour = np.asarray(image, dtype=np.float32) / 255.0
    total = colour * weight
    levels = [_mean(total, weight, colour)]
    while len(levels) < LEVELS and min(total.shape[:2]) >= 2:
        total, weight = _halved(total), _halved(weight)
        levels.append(_mean(total, weight, _halved(levels[-1]) / 4.0))
    return tuple(levels)


def _mean(
    total: NDArray[np.float32], weight: NDArray[np.float32], otherwise: NDArray[np.float32]
) -> NDArray[np.float32]:
    used = weight > 0
    return np.where(used, total / np.where(used, weight, 1.0), otherwise).astype(np.float32)


def _halved(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums of blocks of two by two; an odd last row or column is left out."""
    height, width = image.shape[0] // 2 * 2, image.shape[1] // 2 * 2
    blocks = image[:height, :width].reshape(height // 2, 2, width // 2, 2, -1)
    return np.asarray(blocks.sum(axis=(1, 3)), dtype=np.float32)


def bilinear(image: NDArray[np.uint8] | NDArray[np.float32], uv: FloatArray) -> FloatArray:
    """(N, 3) of an image (H, W, 3) at uv (N, 2), between texel centres at ((i + .5) / W, 1 - (j + .5) / H)."""
    height, width = image.shape[:2]
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1.0 - uv[:, 1]) * height - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    right, below = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    across, down = (x - left)[:, None], (y - top)[:, None]
    upper = image[top, left] * (1 - across) + image[top, right] * across
    lower = image[below, left] * (1 - across) + image[below, right] * across
    return np.asarray(upper * (1 - down) + lower * down)
