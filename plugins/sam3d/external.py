"""External programs as reconstructors: which there are, the scene they read, running one to its end, and its result."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from gvla2.component import check_ranges
from gvla2.errors import GeometryError, Gvla2Error, MissingDependencyError
from gvla2.geometry.view_folders import write_plain
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Reconstruction
from gvla2_plugins.sam3d.results import align_result, read_result

if TYPE_CHECKING:
    from gvla2_plugins.sam3d import ExternalConfig


@dataclass(frozen=True)
class ExternalProgram:
    """One external program: its repository, a file by which a checkout is known, its command and its results.

    ``command`` runs in the checkout. Its words and ``results``, a pattern below the checkout or the output folder, have
    places: ``{python}``, ``{runner}``, ``{scene}``, ``{name}`` (of the scene's folder), ``{output}``, ``{image}``.
    """

    title: str
    source: str
    script: str
    command: tuple[str, ...]
    results: str


_SAM = "SAM License of Meta"
_WEIGHTS = (
    "request access to facebook/sam-3d-objects on Hugging Face, `hf auth login`, then `hf download --repo-type model "
    "--local-dir checkpoints/hf-download facebook/sam-3d-objects` and move checkpoints/hf-download/checkpoints to "
    "checkpoints/hf"
)
PROGRAMS = {
    "mv_sam3d": ExternalProgram(
        "MV-SAM3D", "https://github.com/devinli123/MV-SAM3D", "run_inference_weighted.py",
        ("{python}", "run_inference_weighted.py", "--input_path", "{scene}", "--mask_prompt", "object"),
        "visualization/{name}/object/*/result.glb",
    ),
    "sam3d": ExternalProgram(
        "SAM 3D Objects", "https://github.com/facebookresearch/sam-3d-objects", "notebook/inference.py",
        ("{python}", "{runner}", "{image}", "{output}"),
        "{output}/result.glb",
    ),
    "fast_sam3d": ExternalProgram(
        "Fast-SAM3D", "https://github.com/wlfeng0509/Fast-SAM3D", "notebook/infer.py",
        ("{python}", "notebook/infer.py", "--image_path", "{image}", "--mask_index", "0", "--output_dir", "{output}",
         "--enable_acceleration"),
        "{output}/**/*.glb",
    ),
}  # fmt: skip
OBJECT = "object"
"""The prompt, and the folder of masks."""
_TAIL = 15  # lines of the log in a message


def write_scene(scene: Path, views: Views) -> Path:
    """Write the views below ``scene`` and return the picture of the view that shows most of the object.

    Raises :class:`GeometryError` when no view has a mask.
    """
    shown = tuple(view for view in views if view.mask is not None and (view.mask > 0.5).any())
    if not shown:
        raise GeometryError("No view has a mask that shows the object, and external programs need one.")
    write_plain(scene, Views(shown))
    single = scene / "single"
    single.mkdir()
    (scene / OBJECT).mkdir()
    # RGBA whose alpha is the mask, hard: readers take any alpha above 0 for the object.
    alphas = [np.where(view.mask > 0.5, 255, 0).astype(np.uint8) for view in shown if view.mask is not None]
    cut_out = [Image.fromarray(np.dstack([v.image, a])) for v, a in zip(shown, alphas, strict=True)]
    for number, picture in enumerate(cut_out):
        picture.save(scene / OBJECT / f"{number}.png")
    best = int(np.argmax([alpha.mean() for alpha in alphas]))
    Image.fromarray(shown[best].image).save(single / "image.png")
    cut_out[best].save(single / "0.png")
    return single / "image.png"


class ExternalRunError(Gvla2Error):
    """An external program failed, exceeded its time or left no result; the message ends with the end of its log."""


def run_program(title: str, command: Sequence[str], folder: Path, log: Path, timeout_s: float) -> None:
    """Run ``command`` in ``folder`` with its output in ``log``; whatever it started is killed at the end.

    Raises :class:`ExternalRunError`, and :class:`MissingDependencyError` when the command does not exist.
    """
    paths = [str(folder), str(folder / "notebook"), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in paths if p)}
    with log.open("wb") as stream:
        pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": stream, "stderr": subprocess.STDOUT}
        try:
            process = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, **pipes)
        except (OSError, ValueError) as error:
            raise MissingDependencyError(
                f"'{command[0]}' ({error})", title, f"reconstructor.python=PATH of {title}'s environment"
            ) from error
        how = ""
        try:
            if (code := process.wait(timeout=timeout_s)) != 0:
                how = f"ended with exit status {code}"
        except subprocess.TimeoutExpired:
            how = f"was ended after {timeout_s:g} s; reconstructor.timeout_s sets the limit"
        finally:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    if how:
        lines = log.read_text("utf-8", errors="replace").strip().splitlines()[-_TAIL:]
        raise ExternalRunError("\n  ".join([f"{title} {how}: {' '.join(command)}", *lines]))


class ExternalReconstructor:
    """Runs one of :data:`PROGRAMS` once for each call.

    Checks the checkout and the weights when it is made, before any work is done. Raises
    :class:`MissingDependencyError` for what is missing and :class:`ConfigurationError` for invalid options.
    """

    def __init__(self, program: str, config: ExternalConfig) -> None:
        self._program, self._config = PROGRAMS[program], config
        check_ranges(config, "reconstructor", {"timeout_s": (1e-3, 1e9, "s")})
        self._checkout = self._find_checkout()

    def reconstruct(self, views: Views) -> Reconstruction:
        """The program's result in the views' frame.

        Raises :class:`ExternalRunError` when it fails, takes too long or leaves no result, and
        :class:`gvla2.errors.GeometryError` when its result cannot be read.
        """
        c, program, checkout = self._config, self._program, self._checkout
        with tempfile.TemporaryDirectory(prefix="gvla2_") as folder:
            place = Path(folder).resolve()
            # The program may name its own folders after the scene's, so that name must be unique.
            scene, output = place / place.name, place / "output"
            output.mkdir()
            image, runner = write_scene(scene, views), Path(__file__).with_name("sam3d_runner.py")
            names = {"python": c.python, "runner": runner, "scene": scene, "name": scene.name}
            names |= {"output": output, "image": image}
            command = [word.format(**names) for word in program.command]
            run_program(program.title, command, checkout, place / "log.txt", c.timeout_s)
            pattern = program.results.format(**names).removeprefix(f"{output}/")
            found = [*checkout.glob(pattern), *output.glob(pattern)]
            if not found:
                raise ExternalRunError(
                    f"{program.title} ended well but left no result; looked for {pattern}."
                )
            newest = max(found, key=lambda f: (f.stat().st_mtime_ns, f.name))
            return align_result(*read_result(newest.parent, newest.stem), views, c.gaussians)

    def _find_checkout(self) -> Path:
        p, c, asked = self._program, self._config, f"reconstructor={self._config.name}"
        clone = f"git clone {p.source}, follow its installation, then reconstructor.checkout=PATH"
        checkout = Path(c.checkout).expanduser().resolve()
        if not c.checkout or not (checkout / p.script).is_file():
            what = f"a checkout of {p.title} (no {p.script} in reconstructor.checkout='{c.checkout}')"
            raise MissingDependencyError(what, asked, clone, _SAM)
        if not (checkout / "checkpoints/hf/pipeline.yaml").exists():
            what = f"checkpoints/hf/pipeline.yaml in the checkout {checkout} (the weights)"
            raise MissingDependencyError(what, asked, _WEIGHTS, _SAM)
        return checkout
