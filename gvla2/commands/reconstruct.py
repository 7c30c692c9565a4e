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
from gvla2.errors import ConfigurationError
from gvla2.reconstruction.options import BranchOptions

if TYPE_CHECKING:
    from gvla2.geometry.views import Views
    from gvla2.plugins.registry import Registry
    from gvla2.reconstruction.branch import BranchResult
    from gvla2.reconstruction.contracts import Reconstruction, StageReport
    from gvla2.record.progress import Progress
    from gvla2.record.reconstruction import ReconstructionRecord

KINDS = ("reconstructor", "prior", "axis", "fusion", "renderer")
NO_TARGETS = "none"

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
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, str | int | Sequence):
        raise ConfigurationError(f"{option} is {value!r}; write views such as 0-4 or [0-4,7].")
    if isinstance(value, str | int):
        return str(value)
    return ",".join(str(item) for item in value)


def job(config: ReconstructConfig, registry: Registry, folder: Path) -> float:
    """As :func:`reconstruct`; the mean symmetric IoU with the input masks, for sweepers."""
    record = reconstruct(config, registry, folder)
    assert record.measures is not None
    return record.measures.after.numbers()["symmetric_iou"]


def reconstruct(config: ReconstructConfig, registry: Registry, folder: Path) -> ReconstructionRecord:
    """Reconstruct into ``folder``; returns what was done and measured.

    Raises :class:`gvla2.errors.Gvla2Error` for views, components or files that cannot be used.
    """
    from gvla2.record.progress import Progress

    with Progress(quiet=config.quiet) as progress:
        return _reconstruct(config, registry, folder, _Steps(progress))


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

    def tell(self, name: str, found: str, well: bool = True) -> None:
        log.info("%s: %s (%.2f s)", name, found, self.timings[name])
        self.progress.line("done" if well else "warn", name, self.timings[name], found)


def _reconstruct(
    config: ReconstructConfig, registry: Registry, folder: Path, steps: _Steps
) -> ReconstructionRecord:
    from gvla2.commands.reconstruct_inputs import read_inputs
    from gvla2.reconstruction.branch import BranchParts, refine_geometry
    from gvla2.record.reconstruction import ReconstructionRecord, ReconstructionRecorder, summary_line
    from gvla2.record.reconstruction_measures import measure
    from gvla2.record.text import count

    with steps.step("read"):
        given = read_inputs(config)
    views, size = given.views, given.views[0].camera
    steps.tell("read", f"{count(len(views), 'view')} of {given.name}, {size.width} x {size.height}")
    recorder = ReconstructionRecorder(folder, OmegaConf.to_yaml(OmegaConf.structured(config)))
    parts = registry.build_all(config, KINDS)

    with steps.step("reconstruct"):
        g0 = _first(parts["reconstructor"].reconstruct(views), config, registry)
    steps.tell("reconstruct", _made(g0), g0.status == "ok")
    with steps.step("refine"):
        chosen = BranchParts(*(parts[kind] for kind in ("prior", "axis", "fusion", "renderer")))
        result = refine_geometry(g0, views, chosen, config.branch)
        stages = (_heeded(stage, config, views) for stage in result.stages)
        result = replace(result, stages=tuple(stages))
    _tell_stages(result, steps)
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


def _first(made: Reconstruction | None, config: ReconstructConfig, registry: Registry) -> Reconstruction:
    from gvla2.errors import GeometryError

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


def _made(thing: Reconstruction) -> str:
    parts = []
    if thing.gaussians is not None:
        parts.append(f"{len(thing.gaussians)} Gaussians")
    if thing.mesh is not None:
        parts.append(f"{len(thing.mesh.faces)} triangles")
    return ", ".join(parts) + ("" if thing.status == "ok" else f" ({thing.status})")


def _heeded(stage: StageReport, config: ReconstructConfig, views: Views) -> StageReport:
    """The stage's report; a warning where the chosen prior had nothing to say of any view."""
    from gvla2.reconstruction.branch import NO_PRIOR
    from gvla2.record.text import listing

    if config.prior.name == "none" or stage.reason != NO_PRIOR:
        return stage
    bare = [view.name for view in views if view.depth is None]
    empty = [view.name for view in views if view.depth is not None and not (view.depth > 0).any()]
    lacks = [
        f"no {what} in {listing(names, 6)}"
        for what, names in (("depth", bare), ("depth above 0", empty))
        if names
    ]
    reason = (
        f"prior={config.prior.name} can use no view: {'; '.join(lacks) or 'it gave no depth'}. Give depth/NAME.npy, "
        "(H, W) in metres along z; pictures of depth are not read. G0 stays."
    )
    return replace(stage, status="rejected", reason=reason)


def _tell_stages(result: BranchResult, steps: _Steps) -> None:
    from gvla2.record.reconstruction import STATES

    for stage in result.stages:
        log.info("%s: %s. %s (%.2f s)", stage.stage, stage.status, stage.reason, stage.seconds)
        found = f"{stage.status}: {stage.reason}" if stage.reason else stage.status
        steps.progress.line(STATES[stage.status], stage.stage, stage.seconds, found)


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 reconstruct [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch

    return launch("reconstruct", job, argv)
