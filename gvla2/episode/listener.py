"""Who hears of an episode while it runs."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gvla2.episode.record import EpisodeRecord, Stage


class EpisodeListener(Protocol):
    """Follows an episode while it runs (a recorder, a progress line). Exceptions stop the episode.

    One that has ``wants_frames`` and it is False gets no frames, which then need not be drawn.
    """

    def begin(self, stage: Stage) -> None:
        """A stage starts."""
        ...

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """A stage ended, successfully or not; ``record`` holds everything so far."""
        ...

    def frame(self, image: NDArray[np.uint8]) -> None:
        """The robot moves: an RGB image (H, W, 3)."""
        ...


class SilentListener(EpisodeListener):
    """Ignores everything."""

    @property
    def wants_frames(self) -> bool:
        """Whether a subclass looks at them."""
        return type(self).frame is not SilentListener.frame

    def begin(self, stage: Stage) -> None:
        """Nothing."""

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """Nothing."""

    def frame(self, image: NDArray[np.uint8]) -> None:
        """Nothing."""
