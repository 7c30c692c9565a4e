"""One self-contained page of tasks: how each starts and how it ends, from every camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from PIL import Image

from gvla2.geometry.views import View
from gvla2.record.drawing import png
from gvla2.record.page import render


@dataclass(frozen=True)
class TaskShown:
    """One task of the gallery. ``ending`` says how it reached its ``after``; ``done`` whether it counts.

    ``problem`` is what went wrong, "" if nothing.
    """

    name: str
    summary: str
    instruction: str = ""
    goal: str = ""
    wordings: tuple[str, ...] = ()
    before: tuple[View, ...] = ()
    after: tuple[View, ...] = ()
    ending: str = ""
    done: bool = False
    problem: str = ""


def gallery_page(tasks: Sequence[TaskShown], seed: int) -> str:
    """The page as HTML with embedded pictures."""
    pictured = {"png": lambda image: png(Image.fromarray(image))}
    return render("gallery.html.jinja", tasks=tasks, seed=seed, **pictured)
