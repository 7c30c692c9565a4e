"""Writes a run's folder during the run, so that an interrupted one leaves everything up to that point."""

from __future__ import annotations

import logging
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gvla2.episode.record import EpisodeRecord
from gvla2.episode.refine import masked_views, objects_of_interest
from gvla2.errors import OutputError
from gvla2.geometry.view_folders import CAMERAS, VIEWS, write_plain
from gvla2.geometry.views import Observation, Views
from gvla2.io.files import make_folder, plain, write_bytes, write_json, write_text
from gvla2.planning.contracts import Plan
from gvla2.planning.scene import Scene
from gvla2.planning.trajectory import Trajectory
from gvla2.record.drawing import contact_sheet_of
from gvla2.record.motion import FILM, STATES, UNFINISHED, Motion
from gvla2.record.origin import Origin
from gvla2.record.page import render_page
from gvla2.record.pictures import SHOWN, Pictures, Shots
from gvla2.record.scene_model import scene_glb
from gvla2.record.transcript import kept
from gvla2.robot.backend import Moment

log = logging.getLogger(__name__)

T = TypeVar("T")


class FolderRecorder:
    """The folder of a run: ``config.yaml`` immediately, and ``notes`` on what could not be made.

    ``config`` is the composed configuration as text, ``origin`` how it was asked for. Of an earlier run in the folder
    the files named in ``WRITTEN`` are removed: what this run does not get to must not look like its own. Raises
    :class:`~gvla2.errors.OutputError` if the folder cannot be written to.
    """

    WRITTEN: Collection[str] = ()

    def __init__(self, folder: Path, config: str, origin: Origin | None = None) -> None:
        self.folder, self.config, self.origin = make_folder(folder), config, origin or Origin()
        self.notes: list[str] = []
        self._unwritable = False
        try:
            for name in self.WRITTEN:
                (folder / name).unlink(missing_ok=True)
        except OSError as error:
            raise OutputError(f"Cannot remove {folder / name} of an earlier run: {error}.") from error
        write_text(folder / "config.yaml", config)

    def attempt(self, what: str, make: Callable[[], T]) -> T | None:
        """Return ``make()``; a failure becomes a note and a warning, never an error, and None is returned."""
        try:
            return make()
        except Exception as error:
            self.complain(what, error)
            return None

    def complain(self, what: str, error: Exception) -> None:
        """Note once what could not be made and why; a full disk, which many files meet, is one warning."""
        note = f"{what} could not be made: {type(error).__name__}: {error}"
        if note in self.notes:
            return
        self.notes.append(note)
        if not isinstance(error, OutputError):
            log.warning(note, exc_info=error)
        elif not self._unwritable:
            self._unwritable = True
            log.warning(note)

    def there(self) -> list[str]:
        """The names of the files in the folder."""
        return [path.name for path in self.folder.iterdir() if path.is_file()]


def _fields(made: Any, *without: str) -> dict[str, Any]:
    return {f.name: plain(getattr(made, f.name)) for f in fields(made) if f.name not in without}


def scene_json(scene: Scene) -> dict[str, Any]:
    """The scene X_t with each object's pose and size, metres; point clouds only as their counts."""
    objects = [{**_fields(o, "points"), "points": len(o.points)} for o in scene.objects]
    return {**_fields(scene, "objects"), "objects": objects}


def plan_json(plan: Plan) -> dict[str, Any]:
    """The plan without its trajectory, which has its own file."""
    return {
        **_fields(plan, "trajectory", "transcript", "program"),
        "transcript": kept(plan.transcript),
        "waypoints": len(plan.trajectory) if plan.trajectory is not None else 0,
        "program": plan.program.to_json() if plan.program else None,
    }


def trajectory_json(trajectory: Trajectory) -> dict[str, Any]:
    """The paper's view tau = [(x, y, z, g)], metres and opening in [0, 1], and the full waypoints."""
    return {"frame": "world", "tau": plain(trajectory.xyzg()), "waypoints": trajectory.to_json()}


def attempt_json(attempt: EpisodeRecord) -> dict[str, Any]:
    """One of the earlier attempts, or parts of a program: what was planned, executed and found."""
    parts = ("plan.json", "trajectory.json", "report.json", "verdict.json")
    made = {name.removesuffix(".json"): STAGE_FILES[name](attempt) for name in parts}
    return {**attempt.attempted(), **made, "parts": [attempt_json(part) for part in attempt.parts]}


def _made(value: Any, write: Callable[[Any], Any] = plain) -> Any:
    """The value as JSON; None while it is empty."""
    return None if value is None or value == () else write(value)


def _attempts_json(records: Sequence[EpisodeRecord]) -> list[Any]:
    return [attempt_json(record) for record in records]


STAGE_FILES: Mapping[str, Callable[[EpisodeRecord], Any]] = {
    "scene.json": lambda r: _made(r.scene, scene_json),
    "recalled.json": lambda r: _made(r.recalled),
    "plan.json": lambda r: _made(r.plan, plan_json),
    "trajectory.json": lambda r: _made(r.plan and r.plan.trajectory, trajectory_json),
    "checks.json": lambda r: _made(r.checks, lambda checks: checks.to_json()),
    "report.json": lambda r: _made(r.report, lambda report: report.to_json()),
    "scene_after.json": lambda r: _made(r.after_scene, scene_json),
    "attempts.json": lambda r: _made(r.attempts, _attempts_json),
    "parts.json": lambda r: _made(r.parts, _attempts_json),
    "verdict.json": lambda r: _made(r.verdict),
    "learned.json": lambda r: _made(r.learned),
}
"""The content of each file, None while the record lacks it, in the order of the loop."""


class RunRecorder(FolderRecorder):
    """The folder of one episode: ``config.yaml`` first, then each stage's output, the page at the end.

    Numbers come first: ``result.json`` and the stages' JSON
    files are written before any picture, and a picture that cannot be made becomes a note and a warning, never an
    error. Pictures are made beside the run, on another core; :meth:`finish` waits for them. With ``keep`` "light" no
    film, views and 3D scene are made, with "none" ``config.yaml`` and ``result.json`` are all.
    Raises :class:`~gvla2.errors.OutputError` when the folder cannot be written to.
    """

    WRITTEN = (
        "result.json",
        *STAGE_FILES,
        *(shown.file for shown in SHOWN.values() if shown.file),
        *(f"{VIEWS}/{CAMERAS}", "scene.glb", FILM, UNFINISHED, STATES, "index.html"),
    )

    def __init__(
        self,
        folder: Path,
        config_yaml: str,
        command: str = "run",
        origin: Origin | None = None,
        keep: str = "full",
    ) -> None:
        super().__init__(folder, config_yaml, origin)
        self._command, self._pictured = command, keep != "none"
        self.films = keep == "full"
        self._motion = Motion(folder)
        self._pictures = Pictures()
        self._written: dict[str, Any] = {}
        self._studio = ThreadPoolExecutor(1, "pictures")  # one: the run needs the other cores
        self._awaited: list[Future[Any]] = []

    def frame(self, image: NDArray[np.uint8]) -> None:
        """Keep a frame (H, W, 3) uint8 of the moving robot. Never raises: that would stop the robot."""
        if self.films:
            self.attempt("A frame of the film", lambda: self._motion.frame(image))

    def moment(self, moment: Moment) -> None:
        """Keep the robot's state at the next frame. Never raises."""
        if self.films:
            self._motion.moment(moment)

    def stage(self, record: EpisodeRecord, stage: str) -> None:
        """Write what ``record`` holds since the last call; call it after each finished (or failed) stage.

        Its pictures follow within a moment, see :meth:`settle`.
        """
        if self._pictured:
            self._write_numbers(record)
            self._write_pictures(record)

    def finish(self, record: EpisodeRecord) -> Path:
        """Write everything still missing, the film and the page; returns the page's path."""
        page = self.folder / "index.html"
        if self._pictured:
            self._write_numbers(record)
            self._write_pictures(record)
            self._write_model(record)
            self.attempt("The film", self._finish_film)
            self.settle()
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
        result = {**self._noted(record).result(self._command), "origin": plain(self.origin)}
        write_json(self.folder / "result.json", result, flushed=last)
        for name, content in STAGE_FILES.items() if self._pictured else ():
            value = content(record)
            if value is not None and self._written.get(name) != value:
                write_json(self.folder / name, value, flushed=last)
                self._written[name] = value

    def _write_pictures(self, record: EpisodeRecord) -> None:
        for name, shown in SHOWN.items():
            inputs = shown.inputs(record)
            if not any(each is None for each in inputs):
                self._once(shown.called, partial(self._show, name, shown.file, shown.make, *inputs), *inputs)
        if self.films and record.scene is not None and record.observation is not None:
            keep = partial(self._keep_views, record.scene, record.instruction, record.observation)
            self._once("The views", keep, record.observation)
        if record.checks is not None:
            self._write_model(record)

    def _write_model(self, record: EpisodeRecord) -> None:
        """The scene in 3D, once for what it shows; at the latest at the end."""
        if not self.films:
            return
        make = partial(self._show, "model", "scene.glb", scene_glb, record)
        self._once("The 3D scene", make, record.observation, record.scene, record.plan, record.checks)

    def _show(self, name: str, file: str, make: Callable[..., bytes | Shots], *inputs: Any) -> None:
        """Put what ``make(*inputs)`` gives on the page, and into ``file`` if it has one: several on one sheet."""
        made = make(*inputs)
        setattr(self._pictures, name, made)
        if file and made:
            data = made if isinstance(made, bytes) else contact_sheet_of(made)
            write_bytes(self.folder / file, data, flushed=False)

    def _keep_views(self, scene: Scene, instruction: str, observation: Observation) -> None:
        """The views for ``gvla2 objects teach``, with the named object's silhouette as their mask, empty where it is
        not in sight, for ``gvla2 reconstruct views=FOLDER``.
        """
        objects = objects_of_interest(scene, instruction)
        shown = (masked_views(observation, objects[0]) if objects else None) or ()
        masks = {view.name: view.mask for view in shown}
        empty = {view.name: np.zeros(view.image.shape[:2], np.float32) for view in observation.views}
        views = Views(tuple(replace(view, mask=(empty | masks)[view.name]) for view in observation.views))
        write_plain(self.folder / VIEWS, views, objects[0].label if objects else "")

    def _finish_film(self) -> None:
        self._motion.finish()
        film = self.folder / FILM
        if film.is_file():
            self._pictures.film = film.read_bytes()

    def _page(self, record: EpisodeRecord) -> str:
        return render_page(
            self._noted(record), self._pictures, self.config, self._command, self.there(), self.origin
        )

    def _noted(self, record: EpisodeRecord) -> EpisodeRecord:
        return replace(record, notes=(*record.notes, *self.notes))

    def _once(self, what: str, make: Callable[[], object], *inputs: Any) -> None:
        """Run ``make`` beside the run unless it already ran for the same inputs: records are frozen, so by identity."""
        before = self._written.get(what, ())
        if len(before) != len(inputs) or not all(map(operator.is_, before, inputs)):
            self._written[what] = inputs
            self._later(what, make)
