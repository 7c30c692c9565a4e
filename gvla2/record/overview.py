"""The page over many episodes of one command."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from gvla2.record import wording
from gvla2.record.contents import EpisodeRecord
from gvla2.record.files import write_text
from gvla2.record.page import render


@dataclass(frozen=True)
class EpisodeRow:
    """One line of the overview."""

    record: EpisodeRecord
    link: str
    headline: str
    tone: str
    story: str
    thumbnail: str


def episode_folder(folder: Path, index: int) -> Path:
    """Where the episode of this ``index`` (from 0) of a run in ``folder`` goes: ``episode_000``."""
    return folder / f"episode_{index:03d}"


def write_index(folder: Path, episodes: Sequence[EpisodeRecord], command: str = "run") -> Path:
    """Write ``index.html`` over the episodes of a run, in their order, with links to their folders' pages.

    Thumbnails come from the folders' pictures, so records may have been stripped of their observations.
    Returns its path; raises :class:`~gvla2.errors.OutputError` when the folder cannot be written to.
    """
    rows = []
    for index, record in enumerate(episodes):
        title, tone = wording.headline(record)
        rows.append(
            EpisodeRow(
                record,
                f"{episode_folder(folder, index).name}/index.html",
                title,
                tone,
                " · ".join(wording.details(record)),
                _thumbnail(episode_folder(folder, index)),
            )
        )
    judged = [r.judgement for r in episodes if r.judgement is not None]
    whole = len(episodes) if judged else 0  # without a referee's word an episode counts as not succeeded
    ruled = [
        (r.verdict.outcome == "verified_success", r.judgement.eased)
        for r in episodes
        if r.judgement is not None
        and r.verdict is not None
        and r.verdict.outcome in ("verified_success", "verified_fail")
    ]
    counts = [
        ("episodes", str(len(episodes)), "info"),
        ("referee: eased", _share(sum(j.eased for j in judged), whole), "good"),
        ("referee: strict", _share(sum(j.strict for j in judged), whole), "good"),
        ("verifier agrees with the referee", _share(sum(a == b for a, b in ruled), len(ruled)), "info"),
    ]
    html = render("overview.html.jinja", rows=rows, counts=counts, command=command)
    return write_text(folder / "index.html", html)


def _share(part: int, whole: int) -> str:
    return f"{part} of {whole}" if whole else "–"


def _thumbnail(folder: Path, width: int = 192) -> str:
    for name in ("after.png", "before.png"):
        try:
            with Image.open(folder / name) as picture:
                small = picture.convert("RGB")
                small.thumbnail((width, width))
        except OSError:  # no such picture, or not a whole one: the row goes without
            continue
        stream = io.BytesIO()
        small.save(stream, format="JPEG", quality=82)
        return f"data:image/jpeg;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
    return ""
