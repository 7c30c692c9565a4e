"""The run's page: one self-contained HTML file that explains an episode."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from gvla2.record import sections, wording
from gvla2.record.attempts import attempt_rows, part_rows
from gvla2.record.contents import EpisodeRecord
from gvla2.record.conversation import turns_of
from gvla2.record.pictures import Pictures


def render_page(
    record: EpisodeRecord,
    pictures: Pictures,
    config_yaml: str = "",
    command: str = "run",
    linked: Sequence[tuple[str, str]] = (),
) -> str:
    """The page of one episode as HTML text, also for a record whose later stages are None.

    Pictures, film and 3D scene are data URIs, styles and the one script are inside, and a content policy forbids
    the browser to load anything else. ``linked`` are (file name, what it is) of files beside the page.
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
        story=sections.story(record),
        tiles=sections.tiles(record),
        steps=sections.steps(record),
        attempts=attempt_rows(record),
        parts=part_rows(record),
        total=record.seconds,
        objects=sections.object_rows(record.scene, record.plan) if record.scene else [],
        parameters=parameters,
        plan_notes=plan_notes,
        candidates=sections.ranked_candidates(record.plan) if record.plan else [],
        checks=sections.check_cards(record.checks) if record.checks else [],
        executed=wording.executed(record),
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
        # The package's own files go in as they are; all that a run brings along is escaped.
        style=Markup(_source("page.css")),
        script=Markup(script),
        script_digest=digest,
        data_uri=data_uri,
        terms=sections.terms,
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
        counted=wording.count,
        called=sections.called,
    )
    return environment.get_template(template).render(**values)


def data_uri(data: bytes) -> str:
    """A GIF, JPEG, PNG or MP4 file as a URI that holds it."""
    kinds = ((b"GIF8", "image/gif"), (b"\xff\xd8", "image/jpeg"))
    kind = (
        "video/mp4"
        if data[4:8] == b"ftyp"
        else next((k for s, k in kinds if data.startswith(s)), "image/png")
    )
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _source(name: str) -> str:
    return (files("gvla2.record") / name).read_text(encoding="utf-8")
