"""A curve of measured results as a picture: lines of points with their intervals, as SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gvla2.evaluation.report_page import template

_LEFT, _RIGHT, _TOP, _BOTTOM = 64, 620, 34, 328  # of the plot, in a picture of 640 x 380


@dataclass(frozen=True)
class CurvePoint:
    """A measured value ``y`` at ``x``; ``bar`` is its interval, None if it is not known."""

    x: float
    y: float
    bar: tuple[float, float] | None = None


@dataclass(frozen=True)
class CurveLine:
    """The points of one method, by x."""

    name: str
    colour: str
    points: Sequence[CurvePoint]


def draw_curve(
    title: str,
    lines: Sequence[CurveLine],
    across: Mapping[float, str],
    up: Mapping[float, str],
    limits: tuple[float, float],
    below: str,
) -> str:
    """An SVG: ``across`` and ``up`` label values of x and y, ``limits`` are the least and the greatest y.

    The x axis begins at 0; ``below`` says what it is.
    """
    most, (low, high) = max(across), limits
    return template("curve.svg.jinja").render(
        title=title,
        lines=lines,
        across=across,
        up=up,
        below=below,
        x=lambda value: _LEFT + (_RIGHT - _LEFT) * value / most,
        y=lambda value: _TOP + (_BOTTOM - _TOP) * (high - value) / (high - low),
    )
