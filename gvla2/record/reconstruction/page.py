"""The page of one reconstruction: one self-contained HTML file, in the look of a run's page."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files

from markupsafe import Markup

from gvla2.record.drawing import css_colour
from gvla2.record.page import render
from gvla2.record.reconstruction import sections
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.maps import AGREED, CONTOUR, EXCESS, MISSED, scale_css
from gvla2.record.reconstruction.numbers import metric_groups
from gvla2.record.reconstruction.pictures import ReconstructionPictures


def render_reconstruction(
    record: ReconstructionRecord,
    pictures: ReconstructionPictures,
    config_yaml: str = "",
    linked: Sequence[tuple[str, str]] = (),
) -> str:
    """The page as HTML text, also without measures and without pictures.

    ``linked`` are (file name, what it is) of files beside the page.
    """
    title, tone = sections.headline(record)
    folder = files("gvla2.record")
    style = "".join(
        (folder / name).read_text(encoding="utf-8") for name in ("page.css", "reconstruction.css")
    )
    measures = record.measures
    fits = [] if measures is None else list(zip(measures.before.views, measures.after.views, strict=True))
    return render(
        "reconstruction.html.jinja",
        style=Markup(style),
        record=record,
        pictures=pictures,
        config_yaml=config_yaml,
        linked=linked,
        headline=title,
        tone=tone,
        options=sections.unusual_options(record),
        tiles=sections.tiles(record),
        steps=sections.steps(record),
        meanings=sections.MEANINGS,
        states=sections.STATES,
        stage_numbers=sections.stage_numbers,
        sentence=sections.sentence,
        groups=metric_groups(record),
        unmeasured={} if measures is None else dict(measures.unmeasured or {}),
        fits=fits,
        total=sum(record.timings.values()),
        scale=scale_css(),
        colours={
            name: css_colour(colour)
            for name, colour in (
                ("missed", MISSED),
                ("excess", EXCESS),
                ("agreed", AGREED),
                ("contour", CONTOUR),
            )
        },
    )
