"""Pages over many: the episodes of one command, and the tasks of a gallery."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from gvla2.episode.record import EpisodeRecord
from gvla2.geometry.views import View
from gvla2.io.files import write_json, write_text
from gvla2.record.drawing import png
from gvla2.record.page import data_uri, render


def episode_folder(folder: Path, index: int) -> Path:
    """The folder of episode ``index`` (from 0) of a run in ``folder``: ``episode_000``."""
    return folder / f"episode_{index:03d}"


def write_index(folder: Path, episodes: Sequence[EpisodeRecord]) -> Path:
    """Write ``index.html`` over the episodes of a run, in their order, with links to their folders' pages.

    Thumbnails come from the folders' pictures, so records may have been stripped of their observations.
    Returns its path; raises :class:`~gvla2.errors.OutputError` when the folder cannot be written to.
    """
    places = [episode_folder(folder, index) for index in range(len(episodes))]
    rows = [(record, place.name, _thumbnail(place)) for record, place in zip(episodes, places, strict=True)]
    html = render("overview.html.jinja", episodes=list(episodes), rows=rows)
    return write_text(folder / "index.html", html)


def write_summary(folder: Path, episodes: Sequence[EpisodeRecord]) -> Path:
    """Write ``result.json`` over the episodes of a run: counts, and one row per episode in order.

    ``success_share`` (and ``success_share_strict``) count an unjudged episode as a failure. ``seconds`` are the sum of
    an episode's stages. Returns its path; raises :class:`~gvla2.errors.OutputError` when the folder cannot be written
    to.
    """
    rows = []
    for index, record in enumerate(episodes):
        told = record.result("run")
        same = ("task", "seed", "instruction", "success", "success_strict", "verdict", "failure")
        own = {"seconds": round(record.seconds, 3), "folder": episode_folder(folder, index).name}
        rows.append({**{key: told[key] for key in same}, **own})
    relaxed, strict = (sum(bool(row[key]) for row in rows) for key in ("success", "success_strict"))
    summary = {
        "command": "run",
        "task": rows[0]["task"] if rows else None,
        "episodes": len(rows),
        "succeeded": relaxed,
        "succeeded_strict": strict,
        "success_share": relaxed / len(rows) if rows else None,
        "success_share_strict": strict / len(rows) if rows else None,
        "rows": rows,
    }
    return write_json(folder / "result.json", summary)


def _thumbnail(folder: Path, width: int = 192) -> str:
    for name in ("after.png", "before.png"):
        try:
            with Image.open(folder / name) as picture:
                small = picture.convert("RGB")
                small.thumbnail((width, width))
        except OSError:  # missing or incomplete picture: the row has none
            continue
        stream = io.BytesIO()
        small.save(stream, format="JPEG", quality=82)
        return data_uri(stream.getvalue())
    return ""


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
