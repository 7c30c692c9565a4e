"""Looking up colours where rays hit a textured mesh: a numba kernel."""

from __future__ import annotations

import math
from typing import Any

from gvla2.reconstruction.compiled import compiled


@compiled
def paint(
    faces: Any, us: Any, vs: Any, pixels: Any, shades: Any, uv: Any, rgb: Any, texture: Any,
    texels: Any, images: Any, sums: Any,
) -> None:  # fmt: skip
    """Add the colours of N hits, and their number, to their pixels.

    ``faces`` (N,), ``us`` and ``vs`` (N,) barycentric coordinates of corners 1 and 2, ``pixels`` (N,) rows of
    ``sums`` (P, 4); ``shades`` (F,); ``uv`` (F, 3, 2), ``rgb`` (F, 3, 3), ``texture`` (F,) as in
    :class:`gvla2.geometry.textured_mesh.TexturedMesh`; ``texels`` all images in a row, ``images`` (I, 3) each
    one's start, height and width. Bilinear between texel centres, which lie at ((i + .5) / W, 1 - (j + .5) / H);
    coordinates outside [0, 1] repeat the image.
    """
    for n in range(len(faces)):
        face, u, v, pixel = faces[n], us[n], vs[n], pixels[n]
        w = 1.0 - u - v
        shade = shades[face]
        sums[pixel, 3] += 1.0
        which = texture[face]
        if which < 0:
            for k in range(3):
                sums[pixel, k] += shade * (w * rgb[face, 0, k] + u * rgb[face, 1, k] + v * rgb[face, 2, k])
            continue
        start, height, width = images[which]
        x = w * uv[face, 0, 0] + u * uv[face, 1, 0] + v * uv[face, 2, 0]
        y = w * uv[face, 0, 1] + u * uv[face, 1, 1] + v * uv[face, 2, 1]
        # Only what leaves [0, 1] repeats: at exactly 1 the image's own border is meant.
        if x < 0.0 or x > 1.0:
            x -= math.floor(x)
        if y < 0.0 or y > 1.0:
            y -= math.floor(y)
        x = x * width - 0.5
        y = (1.0 - y) * height - 0.5
        left, top = math.floor(x), math.floor(y)
        right, down = x - left, y - top
        # Half a texel at the border is clamped: wrapping there would mix the image's opposite edges.
        first, second = max(left, 0), min(left + 1, width - 1)
        above, below = max(top, 0) * width, min(top + 1, height - 1) * width
        for k in range(3):
            high = texels[start + 3 * (above + first) + k] * (1.0 - right)
            high += texels[start + 3 * (above + second) + k] * right
            low = texels[start + 3 * (below + first) + k] * (1.0 - right)
            low += texels[start + 3 * (below + second) + k] * right
            tint = w * rgb[face, 0, k] + u * rgb[face, 1, k] + v * rgb[face, 2, k]
            sums[pixel, k] += shade * tint * (high * (1.0 - down) + low * down) / 255.0
