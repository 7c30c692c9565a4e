"""The page of one reconstruction: one self-contained HTML file, in the look of a run's page."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.record.page import render
from gvla2.record.reconstruction import maps, numbers, sections
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.pictures import ReconstructionPictures


def render_reconstruction(
    record: ReconstructionRecord,
    pictures: ReconstructionPictures,
    config_yaml: str = "",
    beside: Sequence[str] = (),
) -> str:
    """The page as HTML text, also without measures and without pictures.

    ``beside`` are names of files beside the page.
    """
    return render(
        "reconstruction.html.jinja",
        record=record,
        pictures=pictures,
        config_yaml=config_yaml,
        beside=beside,
        maps=maps,
        numbers=numbers,
        sections=sections,
    )
