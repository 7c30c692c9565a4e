"""The run's page: one self-contained HTML file that explains an episode."""

from __future__ import annotations

import base64
import hashlib
import math
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from gvla2.record import sections, wording
from gvla2.record.contents import EpisodeRecord
from gvla2.record.conversation import turns_of
from gvla2.record.drawing import css_colour, marker_colour
from gvla2.record.pictures import Pictures
from gvla2.record.text import count, listing, one_line


def render_page(
    record: EpisodeRecord,
    pictures: Pictures,
    config_yaml: str = "",
    command: str = "run",
    linked: Sequence[tuple[str, str]] = (),
) -> str:
    """The page of one episode as HTML text, also for a record whose later stages are None.

    Pictures, film and 3D scene are data URIs, styles and the one script are inside, and a content policy keeps the
    browser from loading anything else. ``linked`` are (file name, what it is) of files beside the page.
    """
    title, tone = wording.headline(record)
    parameters, plan_notes = sections.parameter_rows(record.plan) if record.plan else ([], [])
    return render(
        "page.html.jinja",
        record=record,
        pictures=pictures,
        command=command,
        config_yaml=config_yaml,
        linked=linked,
        headline=title,
        tone=tone,
        steps=sections.steps(record),
        attempts=[*record.attempts, replace(record, attempts=())],
        parameters=parameters,
        plan_notes=plan_notes,
        candidates=sections.ranked_candidates(record.plan) if record.plan else [],
        turns=turns_of(record),
        finding=lambda stage: wording.finding(record, stage),
    )


def render(template: str, **values: Any) -> str:
    """A template of this package with ``values``; every text in them is escaped."""
    environment = Environment(
        loader=FunctionLoader(_source),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    script = f"{_source('page.js')}{_source('viewer.js')}".strip()
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    environment.globals.update(
        # The package's own files are trusted; everything from a run is escaped.
        style=Markup(_source("page.css")),
        script=Markup(script),
        script_digest=digest,
        data_uri=data_uri,
        terms=sections.terms,
        checks=sections.CHECKS,
        outcomes=wording.OUTCOMES,
        tones=wording.TONES,
        executed=wording.executed,
        marker=lambda index: css_colour(marker_colour(index)),
        swatch=sections.swatch,
        roles_of=sections.roles_of,
        call_words=call_words,
        effect_words=sections.effect_words,
        orientation_words=sections.orientation_words,
        guard_words=sections.guard_words,
    )
    environment.filters.update(
        base64=lambda data: base64.b64encode(data).decode("ascii"),
        number=wording.number,
        seconds=wording.seconds,
        fixed=wording.fixed,
        mm=lambda metres: wording.fixed(1000 * metres, 1),
        counted=count,
        called=sections.called,
        finite=lambda value: value if math.isfinite(value) else 0.0,
        label_of=sections.label_of,
        listing=listing,
        one_line=one_line,
    )
    return environment.get_template(template).render(**values)


def call_words(record: EpisodeRecord) -> list[str]:
    """The plan's calls with labels in place of ids: "place(red cube, drawer, in)"."""
    scene, calls = record.scene, record.plan.calls if record.plan else ()
    named = [
        replace(c, theme=sections.called(c.theme, scene), goal=sections.called(c.goal, scene)) for c in calls
    ]
    return list(map(str, named))


def data_uri(data: bytes) -> str:
    """A GIF, JPEG, PNG or MP4 file as a URI that holds it."""
    kinds = {b"GIF8": "image/gif", b"\xff\xd8": "image/jpeg"}
    kind = next((kind for start, kind in kinds.items() if data.startswith(start)), "image/png")
    kind = "video/mp4" if data[4:8] == b"ftyp" else kind
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _source(name: str) -> str:
    return (files("gvla2.record") / name).read_text(encoding="utf-8")
