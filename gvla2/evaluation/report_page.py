"""The report as one self-contained HTML page: tables, pictures, and the runs that every number comes from."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gvla2.evaluation.perception.table import PerceptionTable
from gvla2.evaluation.results import Cell, Run
from gvla2.evaluation.robot.tables import Film, RobotTable
from gvla2.evaluation.runs import RunJob, RunTable
from gvla2.evaluation.sheets import explanations
from gvla2.evaluation.table_formats import EXPLANATION, AnyTable, sheet_of
from gvla2.evaluation.tables import Table

MOST_PICTURES = 60
"""Objects shown below one table: the page stays small enough for e-mail."""


def render_report(
    tables: Sequence[AnyTable], cells: Sequence[Cell], runs: Sequence[Run], title: str, curve: str = ""
) -> str:
    """The page, ``curve`` (SVG) on top. Pictures of the cells that are still on disk are embedded."""
    environment = Environment(
        loader=PackageLoader("gvla2.evaluation", "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=False,
    )
    used = {number for table in tables for number in table.runs}
    page = environment.get_template("report.html.jinja").render(
        title=title,
        curve=Markup(curve),
        explanation=explanations([sheet_of(table) for table in tables]) or EXPLANATION,
        tables=[_table(table, cells) for table in tables],
        runs=[_run(run) for run in runs if run.id in used],
    )
    return page + "\n"


def _table(table: AnyTable, cells: Sequence[Cell]) -> dict[str, Any]:
    sheet = sheet_of(table)
    return {
        "title": sheet.title,
        "headings": sheet.headings,
        "rows": sheet.rows,
        "footnote": sheet.footnote,
        "pictures": _pictures(table, cells) if isinstance(table, Table) else [],
        "films": _films(table),
        "shown": "Jobs" if isinstance(table, RunTable) else "Failures to look at",
        "overlays": _overlays(table) if isinstance(table, PerceptionTable) else [],
    }


def _overlays(table: PerceptionTable) -> list[dict[str, str]]:
    found = [{"caption": caption, "source": _data_uri(path)} for caption, path in table.pictures()]
    return [one for one in found if one["source"]][:MOST_PICTURES]


def _films(table: AnyTable) -> list[dict[str, str]]:
    if isinstance(table, RobotTable):
        return [_film(film) for film in table.films]
    return [_film(job) for job in table.jobs] if isinstance(table, RunTable) else []


def _film(film: Film | RunJob) -> dict[str, str]:
    """Films are linked, not embedded: they would make it hundreds of megabytes."""
    folder = Path(film.folder)
    moving = folder / "episode.gif"
    still = moving if moving.is_file() else folder / "before.png"
    return {
        "caption": film.caption,
        "page": (folder / "index.html").as_uri(),
        "picture": still.as_uri() if still.is_file() else "",
    }


def _pictures(table: Table, cells: Sequence[Cell]) -> list[dict[str, Any]]:
    """One entry per object: its pictures in the order of the table's rows."""
    layout = table.layout
    order = list(layout.labels)
    by_object: dict[str, dict[str, str]] = {}
    for cell in cells:
        if all(str(cell.factors.get(name, "")) == value for name, value in table.group.items()):
            source = _data_uri(str(cell.notes.get("picture", "")))
            if source:
                name = str(cell.factors.get(layout.pair))
                by_object.setdefault(name, {}).setdefault(str(cell.factors.get(layout.row)), source)
    shown = sorted(by_object.items())[:MOST_PICTURES]
    return [
        {
            "caption": name,
            "sources": [
                rows[row] for row in sorted(rows, key=lambda r: order.index(r) if r in order else 99)
            ],
        }
        for name, rows in shown
    ]


def _data_uri(path: str) -> str:
    if not path or not Path(path).is_file():
        return ""
    return "data:image/png;base64," + base64.b64encode(Path(path).read_bytes()).decode("ascii")


def _run(run: Run) -> dict[str, Any]:
    try:
        versions = ", ".join(f"{name} {version}" for name, version in json.loads(run.versions).items())
    except json.JSONDecodeError:
        versions = run.versions
    return {
        "id": run.id,
        "started": run.started,
        "commit": run.commit,
        "folder": run.folder,
        "config": run.config,
        "versions": versions,
    }
