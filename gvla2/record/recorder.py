"""Writes a run's folder during the run, so that an interrupted one leaves everything up to that point."""

from __future__ import annotations

import operator
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gvla2.episode.record import EpisodeRecord
from gvla2.episode.refine import masked_views, objects_of_interest
from gvla2.geometry.view_folders import write_views
from gvla2.geometry.views import Observation
from gvla2.io.files import write_bytes, write_json, write_text
from gvla2.planning.scene import Scene
from gvla2.record.animation import FrameReel, gif
from gvla2.record.drawing import contact_sheet_of
from gvla2.record.files import FolderRecorder
from gvla2.record.motion import FILM, STATES, Motion
from gvla2.record.overview import write_index
from gvla2.record.page import render_page
from gvla2.record.pictures import SHOWN, Pictures, Shots
from gvla2.record.scene_model import scene_glb
from gvla2.record.stages import STAGE_FILES
from gvla2.robot.backend import Moment

__all__ = ["RunRecorder", "write_index"]

LARGEST_FILM = 6_000_000
"""Most bytes of an embedded film; a longer one is linked and the animation is shown."""


class RunRecorder(FolderRecorder):
    """The folder of one episode: ``config.yaml`` first, then each stage's output, the page at the end.

    ``config_yaml`` is the composed configuration as text. Numbers come first: ``result.json`` and the stages' JSON
    files are written before any picture, and a picture that cannot be made becomes a note and a warning, never an
    error. Pictures are made beside the run, on another core; :meth:`finish` waits for them.
    Raises :class:`~gvla2.errors.OutputError` when the folder cannot be written to.
    """

    WRITTEN = (
        "result.json",
        *STAGE_FILES,
        *(shown.file for shown in SHOWN.values() if shown.file),
        *("views.npz", "scene.glb", "episode.gif", FILM, STATES, "index.html"),
    )

    def __init__(self, folder: Path, config_yaml: str, command: str = "run") -> None:
        super().__init__(folder, config_yaml)
        self._command = command
        self._reel = FrameReel()
        self._motion = Motion(folder)
        self._pictures = Pictures()
        self._written: dict[str, Any] = {}
        self._studio = ThreadPoolExecutor(1, "pictures")  # one: the run needs the other cores
        self._awaited: list[Future[Any]] = []
        self._modelled: tuple[object, ...] = (self, None, None, None)  # nothing yet

    def frame(self, image: NDArray[np.uint8]) -> None:
        """Keep a frame (H, W, 3) uint8 of the moving robot. Never raises: that would stop the robot."""
        try:
            self._reel.add(image)
            self._motion.frame(image)
        except Exception as error:
            self.complain("A frame of the animation", error)

    def moment(self, moment: Moment) -> None:
        """Keep the robot's state at the next frame. Never raises."""
        self._motion.moment(moment)

    def stage(self, record: EpisodeRecord, stage: str) -> None:
        """Write what ``record`` holds since the last call; call it after each finished (or failed) stage.

        Its pictures follow within a moment, see :meth:`settle`.
        """
        self._write_numbers(record)
        self._write_pictures(record)

    def finish(self, record: EpisodeRecord) -> Path:
        """Write everything still missing, the animation and the page; returns the page's path."""
        self._write_numbers(record)
        self._write_pictures(record)
        self._write_model(record)
        if self._reel.frames:
            self._later(
                "The animation", partial(self._show, "episode", "episode.gif", gif, self._reel.frames)
            )
        self.attempt("The film", self._finish_film)
        self.settle()
        page = self.folder / "index.html"
        self.attempt("The page", lambda: write_text(page, self._page(record)))
        self._write_numbers(record, last=True)  # again, with the notes about pictures
        return page

    def settle(self) -> None:
        """Wait until all pictures asked for are made."""
        while self._awaited:
            self._awaited[0].result()
            del self._awaited[0]

    def _later(self, what: str, make: Callable[[], Any]) -> None:
        self._awaited.append(self._studio.submit(self.attempt, what, make))

    def _write_numbers(self, record: EpisodeRecord, last: bool = False) -> None:
        write_json(self.folder / "result.json", self._noted(record).result(self._command), flushed=last)
        for name, content in STAGE_FILES.items():
            value = content(record)
            if value is not None and self._written.get(name) != value:
                write_json(self.folder / name, value, flushed=last)
                self._written[name] = value

    def _write_pictures(self, record: EpisodeRecord) -> None:
        for name, shown in SHOWN.items():
            make = partial(self._show, name, shown.file, shown.make)
            self._once(shown.called, make, *shown.inputs(record))
        if record.scene is not None:
            keep = partial(self._keep_views, record.scene, record.instruction)
            self._once("The views", keep, record.observation)
        if record.checks is not None:
            self._write_model(record)

    def _write_model(self, record: EpisodeRecord) -> None:
        """The scene in 3D, once for what it shows; at the latest at the end."""
        shown = (record.observation, record.scene, record.plan, record.checks)
        if not all(map(operator.is_, shown, self._modelled)):
            self._modelled = shown
            self._later("The 3D scene", partial(self._show, "model", "scene.glb", scene_glb, record))

    def _show(self, name: str, file: str, make: Callable[..., bytes | Shots], *inputs: Any) -> None:
        """Put what ``make(*inputs)`` gives on the page, and into ``file`` if it has one: several on one sheet."""
        made = make(*inputs)
        setattr(self._pictures, name, made)
        if file and made:
            data = made if isinstance(made, bytes) else contact_sheet_of(made)
            write_bytes(self.folder / file, data, flushed=False)

    def _keep_views(self, scene: Scene, instruction: str, observation: Observation) -> None:
        """The views with the named object's silhouette as their mask, for ``gvla2 reconstruct views=FOLDER``."""
        things = objects_of_interest(scene, instruction)
        views = masked_views(observation, things[0]) if things else None
        if views is not None:
            write_views(self.folder, views, things[0].label)

    def _finish_film(self) -> None:
        self._motion.finish()
        film = self.folder / FILM
        if film.is_file() and film.stat().st_size <= LARGEST_FILM:
            self._pictures.film = film.read_bytes()

    def _page(self, record: EpisodeRecord) -> str:
        return render_page(self._noted(record), self._pictures, self.config, self._command, self.there())

    def _noted(self, record: EpisodeRecord) -> EpisodeRecord:
        return replace(record, notes=(*record.notes, *self.notes))

    def _once(self, what: str, make: Callable[..., object], *inputs: Any) -> None:
        """Have ``make(*inputs)`` run beside the run when all inputs are there, once for these very ones.

        Records are frozen, so identity tells.
        """
        if any(each is None for each in inputs):
            return
        if list(map(id, self._written.get(what, ()))) == list(map(id, inputs)):
            return
        self._written[what] = inputs
        self._later(what, partial(make, *inputs))
