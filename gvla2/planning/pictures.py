"""Pictures for vision models: the options of planners that show one, the prompt's picture, and the answer's points.

Answers have the formats that RoboPoint and HAMSTER publish: a list ``[(0.41, 0.52), <action>Close Gripper</action>,
...]`` of (x, y), x to the right and y down, each from 0 to 1 of the picture; a box (x0, y0, x1, y1) stands for its
middle; gripper actions follow the point where they happen, and a path is enclosed in ``<ans>`` and ``</ans>``. Models
with coordinates up to 1000 or in pixels have another ``scale``. Text is read, never run.
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
GRID_LINES = 10
"""The grid's cells across and down; each line is labelled with its coordinate."""
MAX_POINTS = 200
"""Most points of an answer; more mean that the model is repeating itself."""
MAX_CHARACTERS = 20_000

# Possessive throughout: any model output is read in linear time, without backtracking.
_NUMBER = r"[-+]?(?:\d++(?:\.\d*+)?(?:e[-+]?\d++)?|\.\d++|nan|inf(?:inity)?)"
_TUPLE = rf"[(\[]\s*+{_NUMBER}(?:\s*+,\s*+{_NUMBER})*+[\s,]*+[)\]]"
_ACTION = r"<action>\s*+(?:open|close)\s++gripper\s*+</action>"
_TOKEN = re.compile(rf"(?P<numbers>{_TUPLE})|(?P<action>{_ACTION})", re.IGNORECASE)
_ANSWER = re.compile(r"<ans>([^<]*+(?:<(?!/ans>|ans>)[^<]*+)*+)</ans>", re.IGNORECASE)
_BETWEEN = " \t\r\n,"


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

        png = encoded(view, self.longest, grid=self.grid, scale=self.scale)
        content: list[dict[str, Any]] = [picture(png), {"type": "text", "text": "\n\n".join(words)}]
        return [{"role": "user", "content": content}]


def encoded(view: View, longest: int, *, grid: bool = False, scale: float = 1.0) -> bytes:
    """The view's image as PNG with its longer side at most ``longest`` pixels; shares of the picture stay the same.

    With ``grid``, thin lines every tenth are labelled with their coordinates, up to ``scale``.
    """
    import numpy as np
    from PIL import Image, ImageDraw

    image = Image.fromarray(np.asarray(view.image))
    image.thumbnail((longest, longest), Image.Resampling.LANCZOS)
    if grid:
        pen = ImageDraw.Draw(image, "RGBA")
        for k in range(1, GRID_LINES):
            x, y = image.width * k / GRID_LINES, image.height * k / GRID_LINES
            pen.line([(x, 0), (x, image.height)], fill=(255, 255, 255, 90))
            pen.line([(0, y), (image.width, y)], fill=(255, 255, 255, 90))
            text = f"{scale * k / GRID_LINES:g}"
            pen.text((x + 2, 1), text, fill=(255, 255, 0, 255))
            pen.text((1, y + 1), text, fill=(255, 255, 0, 255))
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
    """Points (u, v) in shares of the picture; raises :class:`ValueError` that says what is wrong."""
    return tuple((s.u, s.v) for s in read_path(text, scale))


def read_path(text: str, scale: float = 1.0) -> tuple[Stroke, ...]:
    """A path with its gripper's events, open at first; raises :class:`ValueError` that says what is wrong.

    ``scale`` is the range of coordinates. An event before the first point is the hand's state from the start on.
    """
    strokes: list[Stroke] = []
    gripper = 1.0
    for token in _tokens(text):
        if numbers := token["numbers"]:
            u, v = _place(numbers, scale)
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


def _tokens(text: str) -> list[re.Match[str]]:
    """The points and actions of the answer's one list: what ``<ans>`` encloses, else the only list in the text."""
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"The answer has {len(text)} characters; give the list alone.")
    marked = {answer.strip() for answer in _ANSWER.findall(text)}
    if len(marked) > 1:
        raise ValueError("There are several answers between <ans> and </ans>; give one.")
    for answer in marked:
        inside = answer[1:-1] if answer.startswith("[") and answer.endswith("]") else answer
        if rest := _TOKEN.sub("", inside).strip(_BETWEEN):
            raise ValueError(f"'{rest[:60]}' is neither a point (x, y) nor an action of the gripper.")
        return list(_TOKEN.finditer(inside))
    lists = [run for run in _runs(text) if _enclosed(text, run[0].start(), run[-1].end())]
    if not lists:
        raise ValueError("There is no list of points such as [(0.41, 0.52), (0.38, 0.47)] in the answer.")
    if len({text[run[0].start() : run[-1].end()] for run in lists}) > 1:
        raise ValueError("There are several lists of points in the answer; give one.")
    return lists[0]


def _runs(text: str) -> list[list[re.Match[str]]]:
    """Points and actions with nothing but commas and blanks between them, run by run."""
    runs: list[list[re.Match[str]]] = []
    end = -1
    for match in _TOKEN.finditer(text):
        if end < 0 or text[end : match.start()].strip(_BETWEEN):
            runs.append([])
        runs[-1].append(match)
        end = match.end()
    return runs


def _enclosed(text: str, begin: int, end: int) -> bool:
    return text[:begin].rstrip().endswith("[") and text[end:].lstrip(_BETWEEN).startswith("]")


def _place(numbers: str, scale: float) -> tuple[float, float]:
    values = [float(number) for number in numbers.strip("()[],").strip(_BETWEEN).split(",")]
    if len(values) not in (2, 4):
        raise ValueError(f"{numbers[:60]} has {len(values)} numbers; a point has two.")
    u, v = values if len(values) == 2 else (0.5 * (values[0] + values[2]), 0.5 * (values[1] + values[3]))
    if not (0.0 <= u <= scale and 0.0 <= v <= scale):
        raise ValueError(
            f"The point {numbers[:60]} lies outside the picture; coordinates are 0 to {scale:g}."
        )
    return u / scale, v / scale
