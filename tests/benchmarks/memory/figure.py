"""One measured figure of the memory suite, and the tests that give them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gvla2.errors import Gvla2Error

if TYPE_CHECKING:
    from setting import Setting

Better = Literal["lower", "higher"]


class NotMeasuredError(Gvla2Error):
    """Something that a test needs is missing; the table shows the message."""


@dataclass(frozen=True)
class FigureRow:
    """A row of the table: its ``name`` (``test`` of a result), ``title`` and unit; ``goal`` is None for none."""

    name: str
    title: str
    unit: str
    better: Better
    goal: float | None = None
    digits: int = 2


@dataclass(frozen=True)
class Figure:
    """A number beside its peer's; None if not measured, with the reason in ``note``.

    ``peer`` names the source of ``peer_value``; ``n`` is the number of samples, if it is not the test's own
    size; ``goal`` replaces the row's.
    """

    value: float | None
    peer: str = ""
    peer_value: float | None = None
    note: str = ""
    n: int | None = None
    goal: float | None = None


@dataclass(frozen=True)
class Test:
    """A test of one size: its name, its rows, and how to measure them.

    ``size`` is at scale 1, and at least ``least``; ``on`` distinguishes tests of the same name and size (a database, a
    kind of attack).
    """

    __test__ = False  # not a pytest test

    name: str
    rows: tuple[FigureRow, ...]
    measure: Callable[[Setting, int, str], Mapping[str, Figure]]
    size: int
    least: int = 20
    on: str = ""

    def scaled(self, scale: float) -> int:
        """The size at a scale."""
        return min(self.size, max(self.least, round(self.size * scale)))

    @property
    def label(self) -> str:
        """The name, with ``on``."""
        return f"{self.name}, {self.on}" if self.on else self.name


def passed(value: float | None, goal: float | None, better: Better) -> bool | None:
    """Whether a value reaches its goal; None without a value or a goal."""
    if value is None or goal is None:
        return None
    return value <= goal if better == "lower" else value >= goal
