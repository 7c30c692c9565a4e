"""Shared options of planners that show a model a picture: the camera, the size, and the range of coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gvla2.component import check_ranges

if TYPE_CHECKING:
    from gvla2.geometry.views import View
    from gvla2.language import Message
    from gvla2.planning.contracts import PlanRequest


RANGES = {"longest": (64, 4096, "pixels"), "scale": (0.001, 1_000_000, ""), "tries": (1, 1000, "")}
"""Below 64 pixels details are lost, above 4096 servers refuse."""


@dataclass(kw_only=True)
class PictureOptions:
    """Options of such planners, light enough to be a configuration's schema; the run's ``language`` must accept images.

    ``camera`` is the one whose picture is shown, "" for the first. ``scale`` is the range of the model's coordinates: 1
    as published for HAMSTER and RoboPoint, 1000 for Qwen3-VL or Gemini. The picture's longer side is at most
    ``longest`` pixels; ``grid`` draws labelled lines on it, for models not trained to point. After an unusable answer
    the model is asked again, with the reason, ``tries`` times in all. Raises
    :class:`~gvla2.errors.ConfigurationError` for numbers out of range.
    """

    camera: str = ""
    scale: float = 1.0
    longest: int = 1024
    grid: bool = False
    tries: int = 3

    def __post_init__(self) -> None:
        check_ranges(self, "planner", RANGES)

    def view(self, request: PlanRequest) -> View:
        """The camera's view; raises :class:`~gvla2.errors.PlanningError` if there is no such camera."""
        from gvla2.planning.pixels import view_of

        return view_of(request.observation, self.camera)

    def question(self, view: View, words: Sequence[str]) -> list[Message]:
        """The picture, followed by the texts as paragraphs."""
        from gvla2.language import picture
        from gvla2.planning.pictures import shown

        png = shown(view, self.longest, grid=self.grid, scale=self.scale)
        content: list[dict[str, Any]] = [picture(png), {"type": "text", "text": "\n\n".join(words)}]
        return [{"role": "user", "content": content}]
