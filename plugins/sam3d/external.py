"""External programs as reconstructors: which there are, the scene they read, running one to its end, and its result."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gvla2.errors import ConfigurationError, GeometryError, Gvla2Error, MissingDependencyError
from gvla2.geometry.view_folders import write_plain
from gvla2.geometry.views import View, Views
from gvla2.io.files import write_whole
from gvla2.reconstruction.contracts import Reconstruction
from gvla2_plugins.sam3d.result_tree import align_result, read_result

if TYPE_CHECKING:
    from gvla2_plugins.sam3d import ExternalConfig


@dataclass(frozen=True)
class ExternalProgram:
    """One external program: its repository, a file by which a checkout is known, and its usual command and results."""

    title: str
    source: str
    script: str
    licence: str
    command: tuple[str, ...]
    results: tuple[str, ...]


_SAM = "SAM License of Meta"
_WEIGHTS = (
    "request access to facebook/sam-3d-objects on Hugging Face, `hf auth login`, then `hf download --repo-type model "
    "--local-dir checkpoints/hf-download facebook/sam-3d-objects` and move checkpoints/hf-download/checkpoints to "
    "checkpoints/hf"
)
PROGRAMS = {
    "mv_sam3d": ExternalProgram(
        "MV-SAM3D", "https://github.com/devinli123/MV-SAM3D", "run_inference_weighted.py", _SAM,
        ("{python}", "run_inference_weighted.py", "--input_path", "{scene}", "--mask_prompt", "{object}"),
        ("visualization/{scene_name}/{object}/*/result.*", "{output}/**/result.*"),
    ),
    "sam3d": ExternalProgram(
        "SAM 3D Objects", "https://github.com/facebookresearch/sam-3d-objects", "notebook/inference.py", _SAM,
        ("{python}", "{plugin}/sam3d_runner.py", "--image", "{image}", "--output", "{output}"),
        ("{output}/**/result.*",),
    ),
    "fast_sam3d": ExternalProgram(
        "Fast-SAM3D", "https://github.com/wlfeng0509/Fast-SAM3D", "notebook/infer.py", f"MIT and {_SAM}",
        ("{python}", "notebook/infer.py", "--image_path", "{image}", "--mask_index", "0", "--output_dir", "{output}",
         "--enable_acceleration"),
        ("{output}/**/result.*", "{output}/splat-faster-0.*"),
    ),
}  # fmt: skip
OBJECT = "object"
_PLACES = ("python", "checkout", "plugin", "scene", "scene_name", "object", "output", "image", "count")
_TAIL = 15  # lines of the log in a message
_GRACE_S = 5.0  # between asking a program to end and ending it


def write_scene(scene: Path, views: Views) -> Path:
    """Write the views below ``scene`` and return the picture of the view that shows most of the object.

    Raises :class:`GeometryError` when no view has a mask.
    """
    masked = tuple(v for v in views if _shown(v).any())
    if not masked:
        raise GeometryError("No view has a mask that shows the object, and external programs need one.")
    shown = Views(masked)
    write_plain(scene, shown)
    (scene / OBJECT).mkdir(exist_ok=True)
    for number, view in enumerate(shown):
        write_whole(scene / OBJECT / f"{number}.png", _cut_out(view))
    single = scene / "single"
    single.mkdir(exist_ok=True)
    best = max(shown, key=lambda view: float(_shown(view).mean()))
    write_whole(single / "image.png", _png(best.image))
    write_whole(single / "0.png", _cut_out(best))
    return single / "image.png"


def _shown(view: View) -> NDArray[np.bool_]:
    """(H, W) the pixels of the view's mask; none without a mask."""
    return np.zeros(view.image.shape[:2], dtype=bool) if view.mask is None else view.mask > 0.5


def _cut_out(view: View) -> bytes:
    """RGBA whose alpha is the mask, hard: readers take any alpha above 0 for the object."""
    alpha = np.where(_shown(view), 255, 0).astype(np.uint8)
    return _png(np.dstack([view.image, alpha]))


def _png(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    Image.fromarray(array).save(stream, "PNG")
    return stream.getvalue()


class ExternalRunError(Gvla2Error):
    """An external program failed, exceeded its time or left no result; the message ends with the end of its log."""


def run_program(title: str, command: Sequence[str], folder: Path, log: Path, timeout_s: float) -> None:
    """Run ``command`` in ``folder`` with its output in ``log``; it and its children end within the time or are ended.

    Raises :class:`ExternalRunError`, and :class:`MissingDependencyError` when the command does not exist.
    """
    paths = [str(folder), str(folder / "notebook"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in paths if p)}
    with log.open("wb") as stream:
        try:
            process = subprocess.Popen(
                list(command),
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            raise MissingDependencyError(
                f"'{command[0]}' ({error})", title, f"reconstructor.python=PATH of {title}'s environment"
            ) from error
        how = ""
        try:
            if (code := process.wait(timeout=timeout_s)) != 0:
                how = f"ended by signal {-code}" if code < 0 else f"ended with exit status {code}"
        except subprocess.TimeoutExpired:
            how = f"was ended after {timeout_s:g} s; reconstructor.timeout_s sets the limit"
        finally:
            _end(process)
    if how:
        lines = log.read_text("utf-8", errors="replace").strip().splitlines()[-_TAIL:]
        raise ExternalRunError("\n  ".join([f"{title} {how}: {' '.join(command)}", *lines]))


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the process and its children: the whole group, gently first."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, sign)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=_GRACE_S)
            if sign is signal.SIGTERM and not _group_lives(process.pid):
                return


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except (ProcessLookupError, PermissionError):
        return False
    return True


class ExternalReconstructor:
    """Runs one of :data:`PROGRAMS` once for each call.

    Checks the checkout, the weights and the interpreter when it is made, before any work is done. Raises
    :class:`MissingDependencyError` for what is missing and :class:`ConfigurationError` for invalid options.
    """

    def __init__(self, program: str, config: ExternalConfig) -> None:
        self._program, self._config = PROGRAMS[program], config
        if not config.timeout_s > 0:
            raise ConfigurationError(f"reconstructor.timeout_s is {config.timeout_s}; it must be positive.")
        self._checkout = self._find_checkout(f"reconstructor={program}")
        self._command = config.command or self._program.command
        self._results = config.results or self._program.results
        self._fill([*self._command, *self._results], dict.fromkeys(_PLACES, ""))

    def reconstruct(self, views: Views) -> Reconstruction:
        """The program's result in the views' frame.

        Raises :class:`ExternalRunError` when it fails, takes too long or leaves no result, and
        :class:`gvla2.errors.GeometryError` when its result cannot be read.
        """
        c, title = self._config, self._program.title
        with tempfile.TemporaryDirectory(prefix="gvla2_") as folder:
            place = Path(folder).resolve()
            # The program may name its own folders after the scene's, so that name must be unique.
            scene, output = place / place.name, place / "output"
            output.mkdir()
            image = write_scene(scene, views)
            places = (
                c.python,
                self._checkout,
                Path(__file__).parent,
                scene,
                scene.name,
                OBJECT,
                output,
                image,
            )
            names = dict(zip(_PLACES, map(str, (*places, len(views))), strict=True))
            run_program(
                title, self._fill(self._command, names), self._checkout, place / "log.txt", c.timeout_s
            )
            found = self._newest(self._fill(self._results, names))
            if found is None:
                patterns = ", ".join(self._fill(self._results, names))
                raise ExternalRunError(f"{title} ended well but left no result; looked for {patterns}.")
            return align_result(read_result(found.parent, found.stem), views, c.gaussians)

    def _find_checkout(self, asked: str) -> Path:
        p, c = self._program, self._config
        clone = f"git clone {p.source}, follow its installation, then reconstructor.checkout=PATH"
        checkout = Path(c.checkout).expanduser().resolve()
        if not c.checkout or not checkout.is_dir():
            raise MissingDependencyError(f"a checkout of {p.title} ('{c.checkout}')", asked, clone, p.licence)
        if not (checkout / p.script).is_file():
            raise MissingDependencyError(f"{p.script} in the checkout {checkout}", asked, clone, p.licence)
        if c.weights and not (checkout / c.weights).exists():
            what = f"{c.weights} in the checkout {checkout} (the weights)"
            raise MissingDependencyError(what, asked, _WEIGHTS, _SAM)
        return checkout

    def _fill(self, words: Sequence[str], names: Mapping[str, str]) -> list[str]:
        try:
            return [word.format_map(names) for word in words]
        except (KeyError, ValueError, IndexError) as error:
            raise ConfigurationError(
                f"reconstructor.command or reconstructor.results cannot be filled in ({error!r}); the places are "
                f"{', '.join('{' + name + '}' for name in _PLACES)}."
            ) from error

    def _newest(self, patterns: list[str]) -> Path | None:
        """The newest result file of the first pattern that has any."""
        for pattern in patterns:
            root = Path(Path(pattern).anchor) if Path(pattern).is_absolute() else self._checkout
            relative = str(Path(pattern).relative_to(root)) if Path(pattern).is_absolute() else pattern
            files = [p for p in root.glob(relative) if p.suffix in (".ply", ".glb") and p.is_file()]
            if files:
                return max(files, key=lambda p: (p.stat().st_mtime_ns, p.name))
        return None
