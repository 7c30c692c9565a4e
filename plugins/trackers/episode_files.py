"""The files of an episode that a tracker is worth sending."""

from __future__ import annotations

from pathlib import Path

NAMES = ("index.html", "result.json", "config.yaml", "after.png", "episode.gif", "episode.mp4")


def files_of(folder: Path) -> list[Path]:
    """Those that are there."""
    return [folder / name for name in NAMES if (folder / name).is_file()]
