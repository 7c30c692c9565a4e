"""The files of an episode worth sending to a tracker."""

from __future__ import annotations

from pathlib import Path

NAMES = ("index.html", "result.json", "config.yaml", "after.png", "episode.gif", "episode.mp4")


def files_of(folder: Path) -> list[Path]:
    """The existing ones."""
    return [folder / name for name in NAMES if (folder / name).is_file()]
