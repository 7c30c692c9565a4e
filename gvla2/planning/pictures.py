"""Pictures for vision models: the options of planners that show one, the prompt's picture, and the answer's points.

Answers have the formats that RoboPoint and HAMSTER publish: a list ``[(0.41, 0.52), <action>Close Gripper</action>,
...]`` of (x, y), x to the right and y down, each from 0 to 1 of the picture; gripper actions follow the point where
they happen, and a path is enclosed in ``<ans>`` and ``</ans>``. Models with coordinates up to 1000 or in pixels have
another ``scale``. Text is parsed, never run.
"""

from __future__ import annotations

import io
import re
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
MAX_POINTS = 200
"""Maximum number of points in an answer; more mean that the model is repeating itself."""
MAX_CHARACTERS = 20_000

# Possessive throughout: any model output is read in linear time, without backtracking.
_NUMBER = r"[-+]?(?:\d++(?:\.\d*+)?(?:e[-+]?\d++)?|\.\d++|nan|inf(?:inity)?)"
_POINT = rf"\(\s*+{_NUMBER}(?:\s*+,\s*+{_NUMBER})*+[\s,]*+\)"
_ACTION = r"<action>\s*+(?:open|close)\s++gripper\s*+</action>"
_TOKEN = re.compile(rf"(?P<point>{_POINT})|(?P<action>{_ACTION})", re.IGNORECASE)
_ANSWER = re.compile(r"<ans>([^<]*+(?:<(?!/ans>|ans>)[^<]*+)*+)</ans>", re.IGNORECASE)
_LIST = re.compile(rf"\[(?:[\s,]*+(?:{_POINT}|{_ACTION}))++[\s,]*+\]", re.IGNORECASE)


@dataclass(kw_only=True)
class PictureOptions:
    """Options of such planners, light enough to be a configuration's schema; the run's ``language`` must accept images.

    ``camera`` is the one whose picture is shown, "" for the first. ``scale`` is the range of the model's coordinates: 1
    as published for HAMSTER and RoboPoint, 1000 for Qwen3-VL or Gemini. The picture's longer side is at most
    ``longest`` pixels. After an unusable answer the model is asked again, with the reason, ``tries`` times in all.
    Raises :class:`~gvla2.errors.ConfigurationError` for numbers out of range.
    """

    camera: str = ""
    scale: float = 1.0
    longest: int = 1024
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

        png = encoded(view, self.longest)
        content: list[dict[str, Any]] = [picture(png), {"type": "text", "text": "\n\n".join(words)}]
        return [{"role": "user", "content": content}]


def encoded(view: View, longest: int) -> bytes:
    """The view's image as PNG with its longer side at most ``longest`` pixels; shares of the picture stay the same."""
    import numpy as np
    from PIL import Image

    image = Image.fromarray(np.asarray(view.image))
    image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    stream = io.BytesIO()
    image.save(stream, "PNG")
    return stream.getvalue()


@dataclass(frozen=True)
class Stroke:
    """One point of a drawn path: ``u``, ``v`` in shares of the picture, and the hand's ``gripper`` from there on.

    ``event`` says whether the hand changes to open (1) or closed (0) here.
    """

    u: float
    v: float
    gripper: float = 1.0
    event: bool = False


def read_points(text: str, scale: float = 1.0) -> tuple[tuple[float, float], ...]:
    """Points (u, v) in shares of the picture; raises :class:`ValueError` with what is wrong."""
    return tuple((s.u, s.v) for s in read_path(text, scale))


def read_path(text: str, scale: float = 1.0) -> tuple[Stroke, ...]:
    """A path with the events of its gripper, which is open at first; raises :class:`ValueError` with what is wrong.

    ``scale`` is the range of coordinates. An event before the first point is the hand's state from the start on.
    """
    strokes: list[Stroke] = []
    gripper = 1.0
    for token in _TOKEN.finditer(_list_in(text)):
        if point := token["point"]:
            u, v = _place(point, scale)
            strokes.append(Stroke(u, v, gripper))
        else:
            before, gripper = gripper, 1.0 if "open" in token["action"].lower() else 0.0
            if strokes and gripper != before:
                last = strokes.pop()
                strokes.append(Stroke(last.u, last.v, gripper, event=True))
        if len(strokes) > MAX_POINTS:
            raise ValueError(f"The list has more than {MAX_POINTS} points; give a few.")
    if not strokes:
        raise ValueError("The list has no point; give tuples (x, y).")
    return tuple(strokes)


def _list_in(text: str) -> str:
    """The answer's one list: what ``<ans>`` encloses, else the only list of points in the text."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"The answer has {len(text)} characters; give the list alone.")
    found = {answer.strip() for answer in _ANSWER.findall(text)} or set(_LIST.findall(text))
    if not found:
        raise ValueError("There is no list of points such as [(0.41, 0.52), (0.38, 0.47)] in the answer.")
    if len(found) > 1:
        raise ValueError("There are several lists of points in the answer; give one.")
    (answer,) = found
    if rest := _TOKEN.sub("", answer).strip(" \t\r\n,[]"):
        raise ValueError(f"'{rest[:60]}' is neither a point (x, y) nor an action of the gripper.")
    return answer


def _place(point: str, scale: float) -> tuple[float, float]:
    values = [float(number) for number in point.strip("()").strip(" \t\r\n,").split(",")]
    if len(values) != 2:
        raise ValueError(f"{point[:60]} has {len(values)} numbers; a point has two.")
    u, v = values
    if not (0.0 <= u <= scale and 0.0 <= v <= scale):
        raise ValueError(f"The point {point[:60]} lies outside the picture; coordinates are 0 to {scale:g}.")
    return u / scale, v / scale
