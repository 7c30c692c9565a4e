"""Eyes for servers in the place of vision models: they answer from the picture that was sent to them, and no more."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from gvla2.planning.colours import COLOURS

ALIKE = 0.955
"""Cosine between colours from which on they are the same, whatever the light."""


class Eyes:
    """Finds things by the name of their colour in the picture of a chat request."""

    @staticmethod
    def picture(request):
        """(H, W, 3) the picture of the last user's message."""
        parts = [p for m in request["messages"] if isinstance(m["content"], list) for p in m["content"]]
        (url,) = [p["image_url"]["url"] for p in parts if p["type"] == "image_url"]
        head, _, data = url.partition(",")
        assert head == "data:image/png;base64"
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)

    @staticmethod
    def words(request):
        """All text of a chat request."""
        contents = [m["content"] for m in request["messages"]]
        texts = [c if isinstance(c, str) else "\n".join(p.get("text", "") for p in c) for c in contents]
        return "\n".join(texts)

    def mask(self, request, colour):
        """(H, W) where the picture shows the colour."""
        image = self.picture(request).astype(float)
        wanted = np.asarray(COLOURS[colour], dtype=float)
        bright = np.linalg.norm(image, axis=-1)
        return (image @ wanted / np.maximum(bright * np.linalg.norm(wanted), 1e-9) > ALIKE) & (bright > 40.0)

    def middle(self, request, colour):
        """(x, y) in shares of the picture: the middle of what shows the colour, on it."""
        mask = self.mask(request, colour)
        assert mask.any(), f"nothing {colour} is in the picture"
        at = np.argwhere(mask) + 0.5
        nearest = at[np.argmin(np.linalg.norm(at - at.mean(axis=0), axis=1))]
        return float(nearest[1] / mask.shape[1]), float(nearest[0] / mask.shape[0])

    def some(self, request, colour, count=5):
        """``count`` points spread over what shows the colour."""
        mask = self.mask(request, colour)
        at = np.argwhere(mask)
        chosen = at[np.linspace(0, len(at) - 1, count + 2).astype(int)[1:-1]] + 0.5
        return [(float(c / mask.shape[1]), float(r / mask.shape[0])) for r, c in chosen]


@pytest.fixture
def eyes():
    return Eyes()
