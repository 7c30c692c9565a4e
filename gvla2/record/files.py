"""The recorder that fills the folder of a run."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from gvla2.errors import OutputError
from gvla2.io.files import make_folder, write_text

log = logging.getLogger(__name__)

T = TypeVar("T")


class FolderRecorder:
    """The folder of a run: ``config.yaml`` immediately, and ``notes`` on what could not be made.

    ``config`` is the composed configuration as text. Of an earlier run in the folder the files named in ``WRITTEN`` are
    removed: what this run does not get to must not look like its own. Raises :class:`~gvla2.errors.OutputError` if the
    folder cannot be written to.
    """

    WRITTEN: Collection[str] = ()

    def __init__(self, folder: Path, config: str) -> None:
        self.folder, self.config = make_folder(folder), config
        self.notes: list[str] = []
        try:
            for name in self.WRITTEN:
                (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"Cannot remove {folder / name} of an earlier run: {error}.") from error
        write_text(folder / "config.yaml", config)

    def attempt(self, what: str, make: Callable[[], T]) -> T | None:
        """What ``make`` gives; a failure becomes a note and a warning, never an error, and gives None."""
        try:
            return make()
        except Exception as error:
            self.complain(what, error)
            return None

    def complain(self, what: str, error: Exception) -> None:
        """Note once what could not be made and why."""
        note = f"{what} could not be made: {type(error).__name__}: {error}"
        if note not in self.notes:
            self.notes.append(note)
            log.warning(note, exc_info=error)

    def there(self) -> list[str]:
        """The names of the files in the folder."""
        return [path.name for path in self.folder.iterdir() if path.is_file()]
