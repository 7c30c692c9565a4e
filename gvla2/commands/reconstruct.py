"""``gvla2 reconstruct``: from a folder of calibrated views to refined geometry and a page that explains it."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from omegaconf import OmegaConf

from gvla2.commands.reconstruct_config import NO_TARGETS
from gvla2.errors import ConfigurationError

if TYPE_CHECKING:
    from gvla2.commands.reconstruct_config import BranchConfig, ReconstructConfig
    from gvla2.geometry.mesh import Mesh
    from gvla2.geometry.views import Views
    from gvla2.plugins import Registry
    from gvla2.reconstruction.branch import BranchOptions, BranchResult
    from gvla2.reconstruction.contracts import Reconstruction
    from gvla2.record.progress import Progress
    from gvla2.record.reconstruction.contents import ReconstructionRecord

KINDS = ("reconstructor", "prior", "fusion", "renderer")
LEAST_TRUTH_SUPPORT = 0.3
"""Mean mask support below which a true mesh is taken to lie in another frame; masks may be occluded in part."""
GSO_TRUTH = Path("meshes") / "model.obj"

log = logging.getLogger(__name__)


def job(config: ReconstructConfig, registry: Registry) -> float:
    """Reconstruct into Hydra's output folder; the mean symmetric IoU with the input masks, for sweepers.

    Raises :class:`gvla2.errors.Gvla2Error` for views, components or files that cannot be used.
    """
    from gvla2.commands.hydra_job import output_folder

    record = reconstruct(config, registry, output_folder())
    assert record.measures is not None
    return record.measures.after.numbers()["symmetric_iou"]


def reconstruct(config: ReconstructConfig, registry: Registry, folder: Path) -> ReconstructionRecord:
    """As :func:`job`, into ``folder``; returns what was done and measured."""
    from gvla2.record.progress import Progress

    with Progress(quiet=config.quiet) as progress:
        return _reconstruct(config, registry, folder, _Steps(progress))


class _Steps:
    """Times the steps of the job and tells them on the terminal and in the log."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.timings: dict[str, float] = {}

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        self.progress.begin(name)
        began = time.perf_counter()
        yield
        self.timings[name] = time.perf_counter() - began

    def tell(self, name: str, found: str, well: bool = True) -> None:
        log.info("%s: %s (%.2f s)", name, found, self.timings[name])
        self.progress.line("done" if well else "warn", name, self.timings[name], found)


def _reconstruct(
    config: ReconstructConfig, registry: Registry, folder: Path, steps: _Steps
) -> ReconstructionRecord:
    from gvla2.reconstruction.branch import refine_geometry
    from gvla2.record.reconstruction.contents import ReconstructionRecord
    from gvla2.record.reconstruction.measures import measure
    from gvla2.record.reconstruction.recorder import ReconstructionRecorder
    from gvla2.record.reconstruction.sections import summary_line
    from gvla2.record.wording import count

    with steps.step("read"):
        source = _folder(config)
        views = _masked(_read(source, config, config.views_spec), source)
        held_out, truth, truth_file = _held_out(source, config, views), *_truth(source, config, views)
        name = config.object or source.resolve().name
    size = views[0].camera
    steps.tell("read", f"{count(len(views), 'view')} of {name}, {size.width} x {size.height}")
    recorder = ReconstructionRecorder(folder, OmegaConf.to_yaml(OmegaConf.structured(config)))
    parts = registry.build_all(config, KINDS)

    with steps.step("reconstruct"):
        g0 = _first(parts["reconstructor"].reconstruct(views), config, registry)
    steps.tell("reconstruct", _made(g0), g0.status == "ok")
    with steps.step("refine"):
        options = branch_options(config.branch)
        result = refine_geometry(g0, views, parts["prior"], parts["fusion"], parts["renderer"], options)
    _tell_stages(result, steps)
    recorder.geometry(result.out)
    record = ReconstructionRecord(
        name,
        str(source),
        views,
        {kind: getattr(config, kind).name for kind in KINDS},
        asdict(config.branch),
        result,
        truth=truth_file,
        timings=steps.timings,
    )
    recorder.numbers(record)

    with steps.step("measure"):
        measures = measure(result, views, parts["renderer"], held_out, truth)
    record = replace(record, measures=measures)
    steps.tell("measure", ", ".join(measures.groups).replace("_", " "))
    with steps.step("draw"):
        pictures = recorder.pictures(record, parts["renderer"], config.frames)
    page = recorder.page(record, pictures)
    steps.tell("draw", "; ".join(recorder.notes) or "pictures and page", not recorder.notes)
    steps.progress.say(summary_line(record))
    steps.progress.say(f"-> {page}")
    return record


def branch_options(config: BranchConfig) -> BranchOptions:
    """The branch's own options of the configured ones."""
    from gvla2.reconstruction.branch import BranchOptions

    return BranchOptions(**asdict(config))


def _folder(config: ReconstructConfig) -> Path:
    if not config.views:
        raise ConfigurationError(
            "Say which views to reconstruct from: gvla2 reconstruct views=FOLDER. `gvla2 reconstruct --help` lists "
            "the kinds of folders."
        )
    return Path(config.views).expanduser()


def _read(source: Path, config: ReconstructConfig, spec: str | None) -> Views:
    from gvla2.reconstruction.view_folders import read_views

    return read_views(source, spec, config.size)


def _masked(views: Views, source: Path) -> Views:
    """The views, all of which have a mask that shows something somewhere."""
    from gvla2.errors import GeometryError

    bare = [view.name for view in views if view.mask is None]
    if bare:
        raise GeometryError(
            f"{source}: the views {', '.join(bare)} have no mask. The object's silhouette is needed in every view: "
            "save transparent PNG files, or put masks/<name>.png beside images/."
        )
    if not any(view.mask is not None and (view.mask > 0.5).any() for view in views):
        raise GeometryError(f"{source}: all {len(views)} masks are empty, so no view shows the object.")
    return views


def _held_out(source: Path, config: ReconstructConfig, views: Views) -> Views | None:
    """The views to judge by: those asked for, else the protocol's of a GSO-30 tree that are there and no input."""
    from gvla2.errors import GeometryError
    from gvla2.evaluation.protocol import TARGETS
    from gvla2.reconstruction.gso_views import find_model_folder

    if config.targets == NO_TARGETS:
        return None
    if config.targets is not None:
        held_out = _read(source, config, config.targets)
        shared = {view.name for view in views} & {view.name for view in held_out}
        if shared:
            raise GeometryError(
                f"The views {', '.join(sorted(shared))} are both input and target: what was used cannot judge."
            )
        return held_out
    model = None if not is_gso(source) else find_model_folder(source)
    if model is None:
        return None
    used = {int(view.name) for view in views}
    numbers = [n for n in TARGETS if n not in used and (model / f"{n:03d}.npy").is_file()]
    return _read(source, config, ",".join(map(str, numbers))) if numbers else None


def is_gso(source: Path) -> bool:
    """Whether the folder is read as an object of a GSO-30 tree."""
    from gvla2.reconstruction.gso_views import find_model_folder
    from gvla2.reconstruction.plain_views import find_cameras
    from gvla2.reconstruction.view_archive import ARCHIVE

    own = find_cameras(source) is not None or (source / ARCHIVE).is_file()
    return not own and find_model_folder(source) is not None


def _truth(source: Path, config: ReconstructConfig, views: Views) -> tuple[Mesh | None, str]:
    """The true mesh in the views' frame, and its file; a GSO-30 tree brings its own, scaled as its views were."""
    from gvla2.errors import GeometryError
    from gvla2.evaluation.gso_truth import true_mesh
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
    brought = source / GSO_TRUTH
    mesh = true_mesh(brought, views) if is_gso(source) and brought.is_file() else None
    return mesh, "" if mesh is None else str(brought)


def _first(made: Reconstruction | None, config: ReconstructConfig, registry: Registry) -> Reconstruction:
    from gvla2.errors import GeometryError

    name = config.reconstructor.name
    if made is None:
        others = ", ".join(other for other in registry.components("reconstructor") if other != "none")
        raise ConfigurationError(
            f"The reconstructor '{name}' makes no object, so there is nothing to refine. "
            f"Choose another with reconstructor=NAME: {others}."
        )
    if not (
        (made.gaussians is not None and len(made.gaussians))
        or (made.mesh is not None and len(made.mesh.faces))
    ):
        raise GeometryError(f"The reconstructor '{name}' made an empty object (status: {made.status}).")
    return made


def _made(thing: Reconstruction) -> str:
    parts = []
    if thing.gaussians is not None:
        parts.append(f"{len(thing.gaussians)} Gaussians")
    if thing.mesh is not None:
        parts.append(f"{len(thing.mesh.faces)} triangles")
    return ", ".join(parts) + ("" if thing.status == "ok" else f" ({thing.status})")


def _tell_stages(result: BranchResult, steps: _Steps) -> None:
    from gvla2.record.reconstruction.sections import STATES

    for stage in result.stages:
        log.info("%s: %s. %s (%.2f s)", stage.stage, stage.status, stage.reason, stage.seconds)
        found = f"{stage.status}: {stage.reason}" if stage.reason else stage.status
        steps.progress.line(STATES[stage.status], stage.stage, stage.seconds, found)


def main(argv: list[str]) -> int:
    """Entry of ``gvla2 reconstruct [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return launch("reconstruct", job, argv)
