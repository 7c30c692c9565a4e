"""The run's page: one self-contained HTML file that explains an episode."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import math
import pickle
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import BytecodeCache, Environment, FunctionLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup

from gvla2.episode.memory_reporting import turns_of
from gvla2.episode.record import EpisodeRecord
from gvla2.errors import OutputError
from gvla2.io.array_cache import cache_folder
from gvla2.io.files import write_whole
from gvla2.record import sections, wording
from gvla2.record.drawing import css_colour, marker_colour
from gvla2.record.pictures import Pictures
from gvla2.record.text import count, listing, one_line


def render_page(
    record: EpisodeRecord,
    pictures: Pictures,
    config_yaml: str = "",
    command: str = "run",
    beside: Sequence[str] = (),
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
        finding=lambda stage: wording.finding(record, stage),
    )


def render(template: str, **values: Any) -> str:
    """A template of this package with ``values``; every text in them is escaped."""
    return templates().get_template(template).render(**values)


@cache
def templates() -> Environment:
    """The package's templates. Its own files are trusted; everything from a run is escaped."""
    environment = Environment(
        loader=FunctionLoader(_source),
        autoescape=lambda name: name != "findings.jinja",
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_Compiled(),
    )
    script = f"{_source('page.js')}{_source('viewer.js')}".strip()
    environment.globals.update(
        source=lambda name: Markup(_source(name)),
        script=Markup(script),
        script_digest=base64.b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        data_uri=data_uri,
        executed=lambda record: wording.told(record, "execute"),
        marker_colour=marker_colour,
        sections=sections,
        turns_of=turns_of,
        wording=wording,
    )
    environment.filters.update(
        base64=lambda data: base64.b64encode(data).decode("ascii"),
        called=sections.called,
        counted=count,
        css=css_colour,
        degrees=math.degrees,
        finite=lambda value: value if value and math.isfinite(value) else 0.0,
        direction=sections.direction,
        figure=sections.figure,
        fixed=wording.fixed,
        label_of=sections.label_of,
        listing=listing,
        number=wording.number,
        one_line=one_line,
        seconds=wording.seconds,
        share=sections.share,
    )
    return environment


class _Compiled(BytecodeCache):
    """Compiled templates in the user's cache, by their names and their text; without a place they are compiled anew."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Fill the bucket, if it was kept."""
        with contextlib.suppress(OSError, EOFError, ValueError, pickle.UnpicklingError):
            bucket.bytecode_from_string(self._path(bucket).read_bytes())

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keep what was compiled."""
        with contextlib.suppress(OSError, OutputError):
            self._path(bucket).parent.mkdir(parents=True, exist_ok=True)
            write_whole(self._path(bucket), bucket.bytecode_to_string())

    @staticmethod
    def _path(bucket: Bucket) -> Path:
        return cache_folder() / "templates" / f"{bucket.key}-{bucket.checksum}"


def data_uri(data: bytes) -> str:
    """A GIF, JPEG, PNG or MP4 file as a URI that holds it."""
    kinds = {b"GIF8": "image/gif", b"\xff\xd8": "image/jpeg"}
    kind = next((kind for start, kind in kinds.items() if data.startswith(start)), "image/png")
    kind = "video/mp4" if data[4:8] == b"ftyp" else kind
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _source(name: str) -> str:
    return (files("gvla2.record") / name).read_text(encoding="utf-8")
