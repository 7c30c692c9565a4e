"""Points and paths as vision models write them: ``[(0.41, 0.52), <action>Close Gripper</action>, ...]``.

The formats are those that RoboPoint and HAMSTER publish: a list of (x, y), x to the right and y down, each from 0 to 1
of the picture; a box (x0, y0, x1, y1) stands for its middle; gripper actions follow the point where they happen, and a
path is enclosed in ``<ans>`` and ``</ans>``. Models with coordinates up to 1000 or in pixels have another ``scale``.
Text is read, never run.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

MOST = 200
"""Most points of an answer; more mean that the model is repeating itself."""
LONGEST = 20_000
"""Most characters of an answer."""

# Possessive throughout: any model output is read in linear time, without backtracking.
_NUMBER = r"[-+]?(?:\d++(?:\.\d*+)?(?:e[-+]?\d++)?|\.\d++|nan|inf(?:inity)?)"
_TUPLE = rf"[(\[]\s*+{_NUMBER}(?:\s*+,\s*+{_NUMBER})*+[\s,]*+[)\]]"
_ACTION = r"<action>\s*+(?:open|close)\s++gripper\s*+</action>"
_TOKEN = re.compile(rf"(?P<numbers>{_TUPLE})|(?P<action>{_ACTION})", re.IGNORECASE)
_OPEN, _CLOSE = re.compile("<ans>", re.IGNORECASE), re.compile("</ans>", re.IGNORECASE)
_BETWEEN = " \t\r\n,"


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
        if len(strokes) > MOST:
            raise ValueError(f"The list has more than {MOST} points; give a few.")
    if not strokes:
        raise ValueError("The list has no point; give tuples (x, y).")
    return tuple(strokes)


def _tokens(text: str) -> list[re.Match[str]]:
    """The points and actions of the answer's one list."""
    if len(text) > LONGEST:
        raise ValueError(f"The answer has {len(text)} characters; give the list alone.")
    closed = [_CLOSE.split(piece, maxsplit=1) for piece in _OPEN.split(text)[1:]]
    answers = {piece[0].strip() for piece in closed if len(piece) == 2}
    if len(answers) > 1:
        raise ValueError("There are several answers between <ans> and </ans>; give one.")
    for answer in answers:
        inside = answer[1:-1] if answer.startswith("[") and answer.endswith("]") else answer
        runs = _runs(inside)
        before, after = (inside[: runs[0][0].start()], inside[runs[0][-1].end() :]) if runs else (inside, "")
        if rest := f"{before} {after}".strip(_BETWEEN):
            raise ValueError(f"'{rest[:60]}' is neither a point (x, y) nor an action of the gripper.")
        return runs[0] if runs else []
    runs = [r for r in _runs(text) if _enclosed(text, r[0].start(), r[-1].end())]
    if not runs:
        raise ValueError("There is no list of points such as [(0.41, 0.52), (0.38, 0.47)] in the answer.")
    if len({text[r[0].start() : r[-1].end()] for r in runs}) > 1:
        raise ValueError("There are several lists of points in the answer; give one.")
    return runs[0]


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
            f"The point {numbers[:60]} lies outside the picture; coordinates go from 0 to {scale:g}."
        )
    return u / scale, v / scale
