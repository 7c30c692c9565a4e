"""An external program as a reconstructor: write the views, run it, read its result."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.errors import ConfigurationError, MissingDependencyError, OutputError
from gvla2.geometry.view_spec import parse_rotation_word
from gvla2.geometry.views import Views
from gvla2.reconstruction.contracts import Reconstruction
from gvla2_plugins.sam3d.process import ExternalRunError, run_program
from gvla2_plugins.sam3d.programs import PROGRAMS
from gvla2_plugins.sam3d.result_tree import align_result, read_result
from gvla2_plugins.sam3d.scene import OBJECT, write_scene

if TYPE_CHECKING:
    from gvla2_plugins.sam3d import ExternalConfig


class ExternalReconstructor:
    """Runs one of :data:`PROGRAMS` once for each call.

    Checks the checkout, the weights and the interpreter when it is made, before any work is done. Raises
    :class:`MissingDependencyError` for a missing part and :class:`ConfigurationError` for invalid options.
    """

    def __init__(self, program: str, config: ExternalConfig) -> None:
        self._program, self._config = PROGRAMS[program], config
        if not config.timeout_s > 0:
            raise ConfigurationError(f"reconstructor.timeout_s is {config.timeout_s}; it must be positive.")
        if not config.command or not config.results:
            raise ConfigurationError("reconstructor.command and reconstructor.results must not be empty.")
        if config.axes != "auto":
            parse_rotation_word(config.axes)
        self._checkout = self._find_checkout(f"reconstructor={program}")
        self._fill(["", *config.command, *config.results], dict.fromkeys(_PLACES, ""))

    def reconstruct(self, views: Views) -> Reconstruction:
        """The program's result in the views' frame.

        Raises :class:`ExternalRunError` when it fails, takes too long or leaves no result, and
        :class:`gvla2.errors.GeometryError` when its result cannot be read.
        """
        place = _work_folder(self._config.keep)
        try:
            return self._run(place, views)
        finally:
            if not self._config.keep:
                shutil.rmtree(place, ignore_errors=True)

    def _run(self, place: Path, views: Views) -> Reconstruction:
        c, title = self._config, self._program.title
        # The program may name its own folders after the scene's, so that name must be unique.
        scene, output = place / place.name, place / "output"
        output.mkdir()
        image = write_scene(scene, views)
        names = {
            "python": c.python,
            "checkout": str(self._checkout),
            "plugin": str(Path(__file__).parent),
            "scene": str(scene),
            "scene_name": scene.name,
            "object": OBJECT,
            "output": str(output),
            "image": str(image),
            "count": str(len(views)),
        }
        paths = [str(self._checkout), str(self._checkout / "notebook"), os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in paths if p)}
        log = place / "log.txt"
        run_program(title, self._fill(c.command, names), self._checkout, environment, log, c.timeout_s)
        found = self._newest(self._fill(c.results, names))
        if found is None:
            patterns = ", ".join(self._fill(c.results, names))
            raise ExternalRunError(f"{title} ended well but left no result; looked for {patterns}.")
        result = read_result(found.parent, found.stem)
        return align_result(result, views, c.axes, c.refine, c.gaussians)

    def _find_checkout(self, asked: str) -> Path:
        p, c = self._program, self._config
        clone = f"git clone {p.source}, follow its installation, then reconstructor.checkout=PATH"
        if not c.checkout:
            raise MissingDependencyError(f"a checkout of {p.title}", asked, clone, p.licence)
        checkout = Path(c.checkout).expanduser().resolve()
        if not checkout.is_dir():
            raise MissingDependencyError(f"the checkout {checkout}", asked, clone, p.licence)
        ours = any("{plugin}" in word for word in c.command)
        script = (
            p.script if ours else next((w for w in c.command if w.endswith(".py") and "{" not in w), p.script)
        )
        if not (checkout / script).is_file():
            raise MissingDependencyError(f"{script} in the checkout {checkout}", asked, clone, p.licence)
        if c.weights and not (checkout / c.weights).exists():
            raise MissingDependencyError(
                f"{c.weights} in the checkout {checkout} (the weights)", asked, p.weights, p.weights_licence
            )
        return checkout

    def _fill(self, words: list[str], names: Mapping[str, str]) -> list[str]:
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


_PLACES = ("python", "checkout", "plugin", "scene", "scene_name", "object", "output", "image", "count")


def _work_folder(keep: str) -> Path:
    """A new folder for one run, below ``keep`` or in the system's temporary place."""
    try:
        if keep:
            Path(keep).expanduser().mkdir(parents=True, exist_ok=True)
        return Path(
            tempfile.mkdtemp(prefix="gvla2_", dir=Path(keep).expanduser() if keep else None)
        ).resolve()
    except OSError as error:
        raise OutputError(f"Cannot make a folder in {keep or tempfile.gettempdir()}: {error}.") from error
