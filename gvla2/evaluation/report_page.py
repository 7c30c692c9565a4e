"""The report as one self-contained HTML page: tables, pictures, and the runs that every number comes from."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from gvla2.evaluation.results import Run
from gvla2.evaluation.sheets import Exhibit, Sheet, explanations


def render_report(sheets: Sequence[Sheet], runs: Sequence[Run], title: str, curve: str = "") -> str:
    """The page, ``curve`` (SVG) on top. Pictures that are still on disk are embedded, films linked."""
    used = {number for sheet in sheets for number in sheet.runs}
    return (
        template("report.html.jinja").render(
            title=title,
            curve=Markup(curve),
            explanation=explanations(sheets),
            sheets=[(sheet, _shown(sheet)) for sheet in sheets],
            runs=[(run, _versions(run)) for run in runs if run.id in used],
        )
        + "\n"
    )


def template(name: str) -> Template:
    """A template of this package; every text in its values is escaped."""
    loader = PackageLoader("gvla2.evaluation", ".")
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined).get_template(name)


def _shown(sheet: Sheet) -> list[dict[str, Any]]:
    """The exhibits of a table; of those that no page tells about, only the ones with a picture."""
    found = [_exhibit(exhibit) for exhibit in sheet.gallery.exhibits] if sheet.gallery else []
    return [one for one in found if one["page"] or one["sources"]]


def _exhibit(exhibit: Exhibit) -> dict[str, Any]:
    """Films are linked, not embedded: they would make it hundreds of megabytes."""
    files = [Path(path) for path in exhibit.pictures if Path(path).is_file()]
    if exhibit.page:
        sources, page = [file.as_uri() for file in files], Path(exhibit.page).as_uri()
        return {"caption": exhibit.caption, "sources": sources, "page": page}
    coded = (base64.b64encode(file.read_bytes()).decode("ascii") for file in files)
    return {"caption": exhibit.caption, "sources": [f"data:image/png;base64,{c}" for c in coded], "page": ""}


def _versions(run: Run) -> str:
    try:
        return ", ".join(f"{name} {version}" for name, version in json.loads(run.versions).items())
    except json.JSONDecodeError:
        return run.versions
