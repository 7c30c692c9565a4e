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

from gvla2.component import ComponentConfig
from gvla2.errors import ConfigurationError, GeometryError
from gvla2.reconstruction.options import BranchOptions
from gvla2.record.text import count, listing

if TYPE_CHECKING:
    from gvla2.geometry.mesh import TriangleMesh
    from gvla2.geometry.views import Views
    from gvla2.plugins.registry import Registry
    from gvla2.reconstruction.contracts import Reconstruction, StageReport
    from gvla2.record.progress import Progress
    from gvla2.record.reconstruction import ReconstructionRecord

KINDS = ("reconstructor", "prior", "axis", "fusion", "renderer")
NO_TARGETS = "none"
LEAST_TRUTH_SUPPORT = 0.3
"""Mean mask support below which a true mesh is assumed to be in another frame; masks may be occluded in part."""
GSO_TRUTH = Path("meshes") / "model.obj"

log = logging.getLogger(__name__)


@dataclass
class ReconstructConfig:
    """One object from calibrated views.

    ``views`` is their folder, ``views_spec`` which of them are the input (``0-4``, or ``[0-4,7]`` where a comma is
    needed; by default the protocol's 0-4 of a GSO-30 tree and all of another folder), ``size`` their longer side in
    pixels. ``targets`` are views held out to judge by (by default the protocol's 10-24 of a GSO-30 tree; ``none``
    leaves them out), ``truth`` is a mesh file in the views' frame. ``object`` is the name to show, the folder's by
    default; ``measure`` judges by held-out views and true mesh even if ``targets`` and ``truth`` are not given;
    ``frames`` the turntable's pictures; ``quiet`` leaves only errors on the terminal.
    """

    views: str | None = None
    views_spec: Any = None
    size: int | None = None
    targets: Any = None
    truth: str | None = None
    object: str | None = None
    measure: bool = False
    frames: int = 12
    quiet: bool = False
    reconstructor: ComponentConfig = field(default_factory=ComponentConfig)
    prior: ComponentConfig = field(default_factory=ComponentConfig)
    axis: ComponentConfig = field(default_factory=ComponentConfig)
    fusion: ComponentConfig = field(default_factory=ComponentConfig)
    renderer: ComponentConfig = field(default_factory=ComponentConfig)
    branch: BranchOptions = field(default_factory=BranchOptions)

    def __post_init__(self) -> None:
        self.views_spec = spec_of("views_spec", self.views_spec)
        self.targets = spec_of("targets", self.targets)
        if self.size is not None and self.size < 8:
            raise ConfigurationError(f"size is {self.size}; views need at least 8 pixels.")
        if not 2 <= self.frames <= 120:
            raise ConfigurationError(f"frames is {self.frames}; the page's turntable has 2 to 120.")


def spec_of(option: str, value: Any) -> str | None:
    """A view spec as text, from what the command line makes of ``0-4``, ``7``, ``[0-4,7]`` or ``null``."""
    if value is None or (isinstance(value, str | int) and not isinstance(value, bool)):
        return None if value is None else str(value)
    if isinstance(value, Sequence):
        return ",".join(map(str, value))
    raise ConfigurationError(f"{option} is {value!r}; write views such as 0-4 or [0-4,7].")


def job(config: ReconstructConfig, registry: Registry, folder: Path) -> float:
    """As :func:`reconstruct`; the mean symmetric IoU with the input masks, for sweepers."""
    record = reconstruct(config, registry, folder)
    assert record.measures is not None
    return record.measures.after.numbers()["symmetric_iou"]


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


def reconstruct(config: ReconstructConfig, registry: Registry, folder: Path) -> ReconstructionRecord:
    """Reconstruct into ``folder``; returns what was done and measured.

    Raises :class:`gvla2.errors.Gvla2Error` for views, components or files that cannot be used.
    """
    from gvla2.reconstruction.branch import BranchComponents, refine_geometry
    from gvla2.record.progress import Progress
    from gvla2.record.reconstruction import STATES, ReconstructionRecord, ReconstructionRecorder, summary_line
    from gvla2.record.reconstruction_measures import measure

    with Progress(quiet=config.quiet) as progress:
        steps = _Steps(progress)
        with steps.step("read"):
            given = read_inputs(config)
        views, size = given.views, given.views[0].camera
        steps.report("read", f"{count(len(views), 'view')} of {given.name}, {size.width} x {size.height}")
        recorder = ReconstructionRecorder(folder, OmegaConf.to_yaml(OmegaConf.structured(config)))
        built = registry.build_all(config, KINDS)

        with steps.step("reconstruct"):
            g0 = _checked(built["reconstructor"].reconstruct(views), config, registry)
        steps.report("reconstruct", _sizes(g0), warn=g0.status != "ok")
        with steps.step("refine"):
            chosen = BranchComponents(*(built[kind] for kind in ("prior", "axis", "fusion", "renderer")))
            result = refine_geometry(g0, views, chosen, config.branch)
            stages = tuple(_with_unused_prior(stage, config, views) for stage in result.stages)
            result = replace(result, stages=stages)
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
            truth=given.truth_file,
            timings=steps.timings,
        )
        recorder.numbers(record)

        with steps.step("measure"):
            # Held-out views cost more than the branch: they are measured on request.
            asked = config.measure or config.targets is not None or config.truth is not None
            held_out, truth = (given.held_out, given.truth) if asked else (None, None)
            measures = measure(result, views, built["renderer"], held_out, truth)
        record = replace(record, measures=measures)
        steps.report("measure", ", ".join(measures.groups).replace("_", " "))
        with steps.step("draw"):
            pictures = recorder.pictures(record, built["renderer"], config.frames)
        page = recorder.page(record, pictures)
        steps.report("draw", "; ".join(recorder.notes) or "pictures and page", warn=bool(recorder.notes))
        progress.say(summary_line(record))
        progress.say(f"-> {page}")
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


def _with_unused_prior(stage: StageReport, config: ReconstructConfig, views: Views) -> StageReport:
    """The stage's report; a warning where the chosen prior had nothing to say about any view."""
    from gvla2.reconstruction.branch import NO_PRIOR

    if config.prior.name == "none" or stage.reason != NO_PRIOR:
        return stage
    bare = [view.name for view in views if view.depth is None]
    why = f"no depth in {listing(bare, 6)}" if bare else "it gave no depth"
    reason = (
        f"prior={config.prior.name} can use no view: {why}. Give depth/NAME.npy, (H, W) in metres along z."
    )
    return replace(stage, status="rejected", reason=reason)


@dataclass(frozen=True)
class Inputs:
    """``views`` all have masks, at least one of them not empty; ``truth`` lies in their frame.

    ``held_out`` shares no view with them. ``truth_file`` is where the truth was read, "" for none.
    """

    name: str
    folder: Path
    views: Views
    held_out: Views | None
    truth: TriangleMesh | None
    truth_file: str


def read_inputs(config: ReconstructConfig) -> Inputs:
    """Everything that the configuration names, read and checked.

    Raises :class:`ConfigurationError` without a folder, :class:`GeometryError` for files that cannot be used.
    """
    from gvla2.geometry.view_folders import ARCHIVE, read_views, subject_of

    if not config.views:
        raise ConfigurationError(
            "Say which views to reconstruct from: gvla2 reconstruct views=FOLDER. `gvla2 reconstruct --help` lists "
            "the kinds of folders, docs/reconstruction.md says what is in them."
        )
    folder = Path(config.views).expanduser()
    views = _masked(read_views(folder, config.views_spec, config.size), folder)
    held_out = _held_out(folder, config, views)
    truth, truth_file = _truth(folder, config, views)
    name = config.object or subject_of(folder / ARCHIVE) or folder.resolve().name
    return Inputs(name, folder, views, held_out, truth, truth_file)


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
    """The requested views, else those of a GSO-30 tree's protocol that exist and are not inputs."""
    from gvla2.evaluation.protocol import TARGETS
    from gvla2.geometry.view_folders import read_views

    if config.targets == NO_TARGETS:
        return None
    if config.targets is not None:
        held_out = read_views(folder, config.targets, config.size)
        shared = {view.name for view in views} & {view.name for view in held_out}
        if shared:
            raise GeometryError(
                f"The views {', '.join(sorted(shared))} are both input and target; choose other targets."
            )
        return held_out
    model = _gso_model(folder)
    if model is None:
        return None
    used = {int(view.name) for view in views}
    numbers = [n for n in TARGETS if n not in used and (model / f"{n:03d}.npy").is_file()]
    return read_views(folder, ",".join(map(str, numbers)), config.size) if numbers else None


def _gso_model(folder: Path) -> Path | None:
    """The folder of the numbered views if this is an object of a GSO-30 tree, else None."""
    from gvla2.geometry.view_folders import ARCHIVE, CAMERAS, gso_folder

    other = (folder / CAMERAS).is_file() or (folder / ARCHIVE).is_file()
    return None if other else gso_folder(folder)


def _truth(folder: Path, config: ReconstructConfig, views: Views) -> tuple[TriangleMesh | None, str]:
    """The true mesh in the views' frame; a GSO-30 tree brings its own, scaled and turned as its views were."""
    from gvla2.evaluation.datasets import true_mesh
    from gvla2.geometry.mesh_files import read_mesh
    from gvla2.reconstruction.support import mask_support

    if config.truth:
        given = read_mesh(Path(config.truth).expanduser())
        support = float(mask_support(given.vertices, views).mean())
        if support < LEAST_TRUTH_SUPPORT:
            raise GeometryError(
                f"{config.truth} lies outside the masks (mean mask support {support:.2f}): truth must be in the views' "
                "frame and scale."
            )
        return given, config.truth
    brought = folder / GSO_TRUTH
    mesh = true_mesh(brought, views) if _gso_model(folder) is not None and brought.is_file() else None
    return mesh, "" if mesh is None else str(brought)


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 reconstruct [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return launch("reconstruct", {"reconstruct": ReconstructConfig}, job, argv)
