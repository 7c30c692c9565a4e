"""MV-SAM3D as a reconstructor: the scene that it reads, running it to its end, and its result."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from gvla2.component import check_ranges
from gvla2.errors import GeometryError, Gvla2Error, MissingDependencyError
from gvla2.geometry.view_folders import write_plain
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Reconstruction
from gvla2_plugins.geofuse.results import align_result, read_result

if TYPE_CHECKING:
    from gvla2_plugins.geofuse import ExternalConfig


TITLE, ASKED = "MV-SAM3D", "reconstructor=mv_sam3d"
SOURCE, SCRIPT = "https://github.com/devinli123/MV-SAM3D", "run_inference_weighted.py"
"""Its repository, and the file by which a checkout is known."""
_LICENCE = "SAM License of Meta"
_WEIGHTS = (
    "request access to facebook/sam-3d-objects on Hugging Face, `hf auth login`, then `hf download --repo-type model "
    "--local-dir checkpoints/hf-download facebook/sam-3d-objects` and move checkpoints/hf-download/checkpoints to "
    "checkpoints/hf"
)
OBJECT = "object"
"""The prompt, and the folder of masks."""
_TAIL = 15  # lines of the log in a message


def write_scene(scene: Path, views: Views) -> None:
    """Write the views that show the object below ``scene``; raises :class:`GeometryError` when none does."""
    shown = tuple(view for view in views if view.mask is not None and (view.mask > 0.5).any())
    if not shown:
        raise GeometryError(f"No view has a mask that shows the object, and {TITLE} needs one.")
    write_plain(scene, Views(shown))
    (scene / OBJECT).mkdir()
    for number, view in enumerate(shown):
        # RGBA whose alpha is the mask, hard: readers take any alpha above 0 for the object.
        alpha = np.where(view.mask > 0.5, 255, 0).astype(np.uint8)  # type: ignore[operator]  # it has a mask
        Image.fromarray(np.dstack([view.image, alpha])).save(scene / OBJECT / f"{number}.png")


class ExternalRunError(Gvla2Error):
    """The program failed, exceeded its time or left no result; the message ends with the end of its log."""


def run_program(command: Sequence[str], folder: Path, log: Path, timeout_s: float) -> None:
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
                f"'{command[0]}' ({error})", TITLE, f"reconstructor.python=PATH of {TITLE}'s environment"
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
        raise ExternalRunError("\n  ".join([f"{TITLE} {how}: {' '.join(command)}", *lines]))


class ExternalReconstructor:
    """Runs MV-SAM3D once for each call.

    Checks the checkout and the weights when it is made, before any work is done. Raises
    :class:`MissingDependencyError` for what is missing and :class:`ConfigurationError` for invalid options.
    """

    def __init__(self, config: ExternalConfig) -> None:
        check_ranges(config, "reconstructor", {"timeout_s": (1e-3, 1e9, "s")})
        self._config, self._checkout = config, Path(config.checkout).expanduser().resolve()
        clone = f"git clone {SOURCE}, follow its installation, then reconstructor.checkout=PATH"
        if not config.checkout or not (self._checkout / SCRIPT).is_file():
            what = f"a checkout of {TITLE} (no {SCRIPT} in reconstructor.checkout='{config.checkout}')"
            raise MissingDependencyError(what, ASKED, clone, _LICENCE)
        if not (self._checkout / "checkpoints/hf/pipeline.yaml").exists():
            what = f"checkpoints/hf/pipeline.yaml in the checkout {self._checkout} (the weights)"
            raise MissingDependencyError(what, ASKED, _WEIGHTS, _LICENCE)

    def reconstruct(self, views: Views) -> Reconstruction:
        """The program's result in the views' frame.

        Raises :class:`ExternalRunError` when it fails, takes too long or leaves no result, and
        :class:`gvla2.errors.GeometryError` when its result cannot be read.
        """
        with tempfile.TemporaryDirectory(prefix="gvla2_") as folder:
            place = Path(folder).resolve()
            scene = place / place.name  # the program names its results after it, so it must be unique
            write_scene(scene, views)
            command = [self._config.python, SCRIPT, "--input_path", str(scene), "--mask_prompt", OBJECT]
            run_program(command, self._checkout, place / "log.txt", self._config.timeout_s)
            pattern = f"visualization/{scene.name}/{OBJECT}/*/result.glb"
            found = max(
                self._checkout.glob(pattern), key=lambda f: (f.stat().st_mtime_ns, f.name), default=None
            )
            if found is None:
                raise ExternalRunError(f"{TITLE} ended well but left no result; looked for {pattern}.")
            return align_result(*read_result(found.parent), views, self._config.gaussians)
