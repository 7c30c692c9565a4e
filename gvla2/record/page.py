"""Pages as self-contained HTML: one that explains an episode, and those over many."""

from __future__ import annotations

import base64
import hashlib
import io
import math
import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemBytecodeCache, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from gvla2.episode.record import EpisodeRecord
from gvla2.io.array_cache import cache_folder
from gvla2.io.files import write_json, write_text
from gvla2.record import wording
from gvla2.record.drawing import css_colour, marker_colour
from gvla2.record.origin import Origin
from gvla2.record.pictures import CLOSED_COLOUR, OPEN_COLOUR, Pictures
from gvla2.record.text import count, listing, one_line
from gvla2.record.transcript import turns_of

_FOLDER = Path(__file__).parent


def render_page(
    record: EpisodeRecord,
    pictures: Pictures,
    config_yaml: str = "",
    command: str = "run",
    beside: Sequence[str] = (),
    origin: Origin | None = None,
) -> str:
    """The page of one episode as HTML text, also for a record whose later stages are None.

    Pictures, film and 3D scene are data URIs, styles and the one script are inside, and a content policy keeps the
    browser from loading anything else. ``beside`` are names of files beside the page.
    """
    return render(
        "page.html.jinja",
        record=record,
        pictures=pictures,
        command=command,
        config_yaml=config_yaml,
        beside=beside,
        origin=origin or Origin(),
        finding=lambda stage: wording.finding(record, stage),
    )


def render(template: str, **values: Any) -> str:
    """A template of this package with ``values``; every text in them is escaped."""
    return templates().get_template(template).render(**values)


@cache
def templates() -> Environment:
    """The package's templates. Its own files are trusted; everything from a run is escaped."""
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_bytecode_cache(),
    )
    script = f"{_source('page.js')}{_source('viewer.js')}".strip()
    environment.globals.update(
        source=lambda name: Markup(_source(name)),
        script=Markup(script),
        script_digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        data_uri=data_uri,
        executed=lambda record: wording.result_of(record, "execute"),
        marker_colour=marker_colour,
        open_colour=OPEN_COLOUR,
        closed_colour=CLOSED_COLOUR,
        turns_of=turns_of,
        wording=wording,
    )
    environment.filters.update(
        base64=lambda data: base64.b64encode(data).decode("ascii"),
        called=wording.called,
        counted=count,
        css=css_colour,
        degrees=math.degrees,
        finite=lambda value: value if value and math.isfinite(value) else 0.0,
        fixed=wording.fixed,
        label_of=wording.label_of,
        listing=listing,
        number=wording.number,
        one_line=one_line,
        seconds=wording.seconds,
        share=wording.share,
    )
    return environment


def _bytecode_cache() -> FileSystemBytecodeCache | None:
    """Compiled templates in the user's cache; None, so that they are compiled anew, where there is no place
    that only this user can write to.
    """
    folder = cache_folder() / "templates"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if folder.stat().st_uid != os.geteuid():  # it holds code
            return None
        folder.chmod(0o700)
    except OSError:
        return None
    return FileSystemBytecodeCache(str(folder))


def data_uri(data: bytes) -> str:
    """A JPEG, PNG or MP4 file as a URI that holds it."""
    kind = "image/jpeg" if data.startswith(b"\xff\xd8") else "image/png"
    kind = "video/mp4" if data[4:8] == b"ftyp" else kind
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _source(name: str) -> str:
    return (_FOLDER / name).read_text(encoding="utf-8")


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
        result = record.result("run")
        same = ("task", "seed", "instruction", "success", "success_strict", "verdict", "failure")
        own = {"seconds": round(record.seconds, 3), "folder": episode_folder(folder, index).name}
        rows.append({**{key: result[key] for key in same}, **own})
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
