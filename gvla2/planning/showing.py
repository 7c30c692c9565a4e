"""What planners that show a model a picture have in common: whose picture, how large, and what coordinates count to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.geometry.views import View
    from gvla2.language import Message
    from gvla2.planning.contracts import PlanRequest


@dataclass(kw_only=True)
class PictureOptions:
    """Options of such planners, light enough to be a configuration's schema; the run's ``language`` must see.

    ``camera`` is the one whose picture is shown, "" for the first. ``scale`` is what the model's coordinates count to:
    1 as published for HAMSTER and RoboPoint, 1000 for Qwen3-VL or Gemini. The picture's longer side is at most
    ``longest`` pixels; ``grid`` draws labelled lines on it, for models that were not taught to point. An answer that
    cannot be used is asked for anew, with the reason, ``tries`` times in all.
    """

    camera: str = ""
    scale: float = 1.0
    longest: int = 1024
    grid: bool = False
    tries: int = 3

    def check(self) -> None:
        """Raises :class:`ConfigurationError` for what no model can be shown."""
        from gvla2.planning.pictures import check_longest
        from gvla2.planning.pointing import check_scale

        check_longest(self.longest)
        check_scale(self.scale)
        if self.tries < 1:
            raise ConfigurationError(f"tries is {self.tries}; it must be at least 1.")

    def view(self, request: PlanRequest) -> View:
        """What the camera saw; raises :class:`~gvla2.errors.PlanningError` where there is no such camera."""
        from gvla2.planning.pixels import view_of

        return view_of(request.observation, self.camera)

    def question(self, view: View, words: Sequence[str]) -> list[Message]:
        """The picture, and below it the words, a paragraph each."""
        from gvla2.language import picture
        from gvla2.planning.pictures import shown

        png = shown(view, self.longest, grid=self.grid, scale=self.scale)
        content: list[dict[str, Any]] = [picture(png), {"type": "text", "text": "\n\n".join(words)}]
        return [{"role": "user", "content": content}]
