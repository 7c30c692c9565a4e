"""``gvla2 reconstruct``: from a folder of calibrated views to refined geometry and a page that explains it."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from gvla2.commands.sweeps import Measured, conclude, kept_job
from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, GeometryError
from gvla2.evaluation.config import ResultsConfig
from gvla2.reconstruction.options import BranchOptions
from gvla2.record.text import count

if TYPE_CHECKING:
    from gvla2.geometry.mesh import TriangleMesh
    from gvla2.geometry.views import Views
    from gvla2.plugins.registry import Registry
    from gvla2.reconstruction.contracts import Reconstruction
    from gvla2.record.progress import Progress
    from gvla2.record.reconstruction import ReconstructionRecord

KINDS = ("reconstructor", "prior", "axis", "fusion", "renderer")
LEAST_AGREEMENT = 0.4
"""Least symmetric IoU of a result with the masks that it was made of; wrong cameras reach .3, poor priors above .6."""
LEAST_TRUTH_SUPPORT = 0.3
"""Mean mask support below which a true mesh is assumed to be in another frame; masks may be occluded in part."""

log = logging.getLogger(__name__)


@dataclass
class ReconstructConfig:
    """One object from calibrated views.

    ``views`` is their folder, ``views_spec`` which of them are the input (``0-4``, or ``[0-4,7]`` where a comma is
    needed; by default the protocol's 0-4 of a GSO-30 tree and all of another folder), ``size`` their longer side in
    pixels. ``targets`` are views held out to judge by, ``truth`` is a mesh file in the views' frame. ``object`` is the
    name to show, the folder's by default; ``quiet`` prints only the result. A sweep puts its jobs into the
    database ``results``; finished jobs in its folder are kept, unless ``results.fresh``.
    """

    views: str | None = None
    views_spec: Any = None
    size: int | None = None
    targets: Any = None
    truth: str | None = None
    object: str | None = None
    quiet: bool = False
    reconstructor: ComponentConfig = field(default_factory=ComponentConfig)
    prior: ComponentConfig = field(default_factory=ComponentConfig)
    axis: ComponentConfig = field(default_factory=ComponentConfig)
    fusion: ComponentConfig = field(default_factory=ComponentConfig)
    renderer: ComponentConfig = field(default_factory=ComponentConfig)
    branch: BranchOptions = field(default_factory=BranchOptions)
    results: ResultsConfig = field(default_factory=ResultsConfig)

    def __post_init__(self) -> None:
        self.views_spec = spec_of("views_spec", self.views_spec)
        self.targets = spec_of("targets", self.targets)
        if self.size is not None and self.size < 8:
            raise ConfigurationError(f"size is {self.size}; views need at least 8 pixels.")


def spec_of(option: str, value: Any) -> str | None:
    """A view spec as text, from what the command line makes of ``0-4``, ``7``, ``[0-4,7]`` or ``null``."""
    if value is None or (isinstance(value, str | int) and not isinstance(value, bool)):
        return None if value is None else str(value)
    if isinstance(value, Sequence):
        return ",".join(map(str, value))
    raise ConfigurationError(f"{option} is {value!r}; write views such as 0-4 or [0-4,7].")


def job(config: ReconstructConfig, registry: Registry, folder: Path) -> float:
    """As :func:`reconstruct`; the mean symmetric IoU with the input masks, for sweepers.

    A job of a sweep is not run again in a folder where it is done.
    """

    def run(label: str) -> tuple[float, list[Measured]]:
        record = reconstruct(config, registry, folder, label)
        numbers = record.numbers()
        row = Measured({"object": record.name}, numbers, {"folder": str(folder.absolute())})
        return numbers["symmetric_iou"], [row]

    return kept_job(config, folder, run)


class _Steps:
    """Times the steps of the job and reports them on the terminal and in the log."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.timings: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self.progress.begin(name)
        began = time.perf_counter()
        yield
        self.timings[name] = time.perf_counter() - began

    def report(self, name: str, result: str, *, warn: bool = False) -> None:
        log.info("%s: %s (%.2f s)", name, result, self.timings[name])
        self.progress.line("warn" if warn else "done", name, self.timings[name], result)


def reconstruct(
    config: ReconstructConfig, registry: Registry, folder: Path, label: str = ""
) -> ReconstructionRecord:
    """Reconstruct into ``folder``; returns what was done and measured. ``label`` begins each line on the terminal.

    Raises :class:`gvla2.errors.Gvla2Error` for views, components or files that cannot be used.
    """
    from gvla2.plugins.assembly import refuse_idle
    from gvla2.reconstruction.branch import BranchComponents, refine_geometry
    from gvla2.record.origin import origin_of
    from gvla2.record.progress import Progress
    from gvla2.record.reconstruction import STATES, ReconstructionRecord, ReconstructionRecorder, summary_line
    from gvla2.record.reconstruction_measures import measure

    refuse_idle(config, registry, config.branch)
    with Progress(quiet=config.quiet, label=label) as progress:
        steps = _Steps(progress)
        with steps.step("read"):
            given = read_inputs(config)
        views, size = given.views, given.views[0].camera
        steps.report("read", f"{count(len(views), 'view')} of {given.name}, {size.width} x {size.height}")
        recorder = ReconstructionRecorder(
            folder, OmegaConf.to_yaml(OmegaConf.structured(config)), origin_of(config, "reconstruct")
        )
        built = registry.build_all(config, KINDS)

        with steps.step("reconstruct"):
            g0 = _checked(built["reconstructor"].reconstruct(views), config, registry)
        steps.report("reconstruct", _sizes(g0), warn=g0.status != "ok")
        with steps.step("refine"):
            chosen = BranchComponents(*(built[kind] for kind in ("prior", "axis", "fusion", "renderer")))
            result = refine_geometry(g0, views, chosen, config.branch)
        for stage in result.stages:
            log.info("%s: %s. %s (%.2f s)", stage.stage, stage.status, stage.reason, stage.seconds)
            line = f"{stage.status}: {stage.reason}" if stage.reason else stage.status
            progress.line(STATES[stage.status], stage.stage, stage.seconds, line)
        recorder.geometry(result.out)
        record = ReconstructionRecord(
            given.name,
            str(given.folder),
            views,
            {kind: getattr(config, kind).name for kind in KINDS},
            asdict(config.branch),
            result,
            truth=config.truth or "",
            timings=steps.timings,
        )
        recorder.numbers(record)

        with steps.step("measure"):
            measures = measure(result, views, built["renderer"], given.held_out, given.truth)
        agreement = measures.after.numbers()["symmetric_iou"]
        if agreement < LEAST_AGREEMENT:
            raise GeometryError(
                f"{given.folder}: the result and its views' masks agree by {agreement:.2f} (symmetric IoU), so "
                "the views contradict each other. Is K of pictures of another size, are poses inverted or of another "
                "convention, are masks of another object?"
            )
        record = replace(record, measures=measures)
        steps.report("measure", ", ".join(measures.groups).replace("_", " "))
        with steps.step("draw"):
            pictures = recorder.pictures(record)
        page = recorder.page(record, pictures)
        steps.report("draw", "; ".join(recorder.notes) or "pictures and page", warn=bool(recorder.notes))
        progress.say(summary_line(record), always=True)
        progress.say(f"-> {page}", always=True)
    return record


def _checked(made: Reconstruction | None, config: ReconstructConfig, registry: Registry) -> Reconstruction:
    name = config.reconstructor.name
    if made is None:
        others = ", ".join(other for other in registry.components("reconstructor") if other != "none")
        raise ConfigurationError(
            f"The reconstructor '{name}' makes no object: there is nothing to refine. "
            f"Choose another with reconstructor=NAME: {others}."
        )
    if not (
        (made.gaussians is not None and len(made.gaussians))
        or (made.mesh is not None and len(made.mesh.faces))
    ):
        raise GeometryError(f"The reconstructor '{name}' made an empty object (status: {made.status}).")
    return made


def _sizes(made: Reconstruction) -> str:
    sizes = []
    if made.gaussians is not None:
        sizes.append(f"{len(made.gaussians)} Gaussians")
    if made.mesh is not None:
        sizes.append(f"{len(made.mesh.faces)} triangles")
    return ", ".join(sizes) + ("" if made.status == "ok" else f" ({made.status})")


@dataclass(frozen=True)
class Inputs:
    """``views`` all have masks, at least one of them not empty; ``truth`` lies in their frame.

    ``held_out`` shares no view with them.
    """

    name: str
    folder: Path
    views: Views
    held_out: Views | None
    truth: TriangleMesh | None


def read_inputs(config: ReconstructConfig) -> Inputs:
    """Everything that the configuration names, read and checked.

    Raises :class:`ConfigurationError` without a folder, :class:`GeometryError` for files that cannot be used.
    """
    from gvla2.geometry.view_folders import read_views, subject_of

    if not config.views:
        raise ConfigurationError(
            "Say which views to reconstruct from: gvla2 reconstruct views=FOLDER. `gvla2 reconstruct --help` lists "
            "the kinds of folders, docs/reconstruction.md says what is in them."
        )
    folder = Path(config.views).expanduser()
    views = _masked(read_views(folder, config.views_spec, config.size), folder)
    name = config.object or subject_of(folder) or folder.resolve().name
    return Inputs(name, folder, views, _held_out(folder, config, views), _truth(config, views))


def _masked(views: Views, folder: Path) -> Views:
    bare = [view.name for view in views if view.mask is None]
    if bare:
        raise GeometryError(
            f"{folder}: the views {', '.join(bare)} have no mask. The object's silhouette is needed in every view: "
            "save transparent PNG files, or put masks/<name>.png beside images/."
        )
    if not any(view.mask is not None and (view.mask > 0.5).any() for view in views):
        raise GeometryError(f"{folder}: all {len(views)} masks are empty, so no view shows the object.")
    return views


def _held_out(folder: Path, config: ReconstructConfig, views: Views) -> Views | None:
    """The views to judge by."""
    from gvla2.geometry.view_folders import read_views

    if config.targets is None:
        return None
    held_out = read_views(folder, config.targets, config.size)
    shared = {view.name for view in views} & {view.name for view in held_out}
    if shared:
        raise GeometryError(
            f"The views {', '.join(sorted(shared))} are both input and target; choose other targets."
        )
    return held_out


def _truth(config: ReconstructConfig, views: Views) -> TriangleMesh | None:
    """The true mesh in the views' frame."""
    from gvla2.geometry.mesh_files import read_mesh
    from gvla2.reconstruction.support import mask_support

    if config.truth is None:
        return None
    given = read_mesh(Path(config.truth).expanduser())
    support = float(mask_support(given.vertices, views).mean())
    if support < LEAST_TRUTH_SUPPORT:
        raise GeometryError(
            f"{config.truth} lies outside the masks (mean mask support {support:.2f}): truth must be in the views' "
            "frame and scale."
        )
    return given


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 reconstruct [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return conclude("reconstruct", launch("reconstruct", {"reconstruct": ReconstructConfig}, job, argv), argv)
