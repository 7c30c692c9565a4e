"""``gvla2 run``: one episode, or several, from an instruction to a page that explains what happened."""

from __future__ import annotations

import logging
import sys
import traceback
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from gvla2.errors import Gvla2Error

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gvla2.commands.run_config import RunConfig
    from gvla2.episode import Parts
    from gvla2.memory.contracts import Memory
    from gvla2.plugins import Registry
    from gvla2.record.contents import EpisodeRecord, Stage
    from gvla2.record.progress import Progress
    from gvla2.record.recorder import RunRecorder
    from gvla2.robot.backend import Moment

log = logging.getLogger(__name__)

_TELLING = 4
"""Parts of a run's folder that tell its episode from all others: the day, the time, the job of a sweep, the seed."""


@dataclass
class _Listener:
    """Passes an episode's news to its recorder and to the terminal; keeps the latest record."""

    recorder: RunRecorder
    progress: Progress
    latest: EpisodeRecord | None = None

    def begin(self, stage: Stage) -> None:
        self.progress.begin(stage)

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        self.latest = record
        if record.failure is not None:
            log.info("%s: %s (%s)", stage, record.failure.message, record.failure.kind)
        else:
            log.info("%s: %.2f s", stage, record.timings.get(stage, 0.0))
        self.recorder.stage(record, stage)
        self.progress.stage(record, stage)

    def name_culprit(self, who: str) -> None:
        """Say in the latest record whose code crashed."""
        if self.latest is not None and self.latest.failure is not None:
            failure = self.latest.failure
            self.latest = replace(self.latest, failure=replace(failure, message=f"{who}: {failure.message}"))

    def moment(self, moment: Moment) -> None:
        self.recorder.moment(moment)

    def frame(self, image: NDArray[np.uint8]) -> None:
        self.recorder.frame(image)


def job(config: RunConfig, registry: Registry) -> float:
    """Run the configured episodes into Hydra's output folder; the share that succeeded, for sweepers.

    A job of a sweep has a bank of its own unless one is named, and is not run again in a folder where it is done.
    Raises :class:`Gvla2Error` when an episode could not be carried out (the robot would not start, say); an
    episode that was carried out and failed is a result.
    """
    from gvla2.commands import sweeps
    from gvla2.commands.hydra_job import output_folder

    folder = output_folder()
    records: list[EpisodeRecord] = []
    if not sweeps.in_sweep():
        return run_episodes(config, registry, folder)
    config, label = sweeps.with_fresh_bank(config, folder), sweeps.job_label()
    digest = sweeps.digest_of(config)
    share = None if config.results.fresh else sweeps.done_before(folder, digest)
    if share is not None:
        print(f"{label} is done: {folder / 'index.html'}", file=sys.stderr)
        return share
    sweeps.clear(folder)
    try:
        share = run_episodes(config, registry, folder, label, records)
    except Exception as error:
        sweeps.write_job(folder, config, digest, records, f"failed: {error}")
        raise
    sweeps.write_job(folder, config, digest, records, "ok")
    return share


def run_episodes(
    config: RunConfig,
    registry: Registry,
    folder: Path,
    label: str = "",
    records: list[EpisodeRecord] | None = None,
) -> float:
    """As :func:`job`, into ``folder``: the episode itself for one; for several ``episode_NNN``, an overview, the
    aggregate ``result.json`` (brought up to date after each) and the composed configuration.

    ``label`` begins each line on the terminal; ``records`` gets what was run, also before an error.
    """
    from gvla2.commands.tracking import Tracking
    from gvla2.episode import ABANDONED
    from gvla2.record.files import write_text
    from gvla2.record.overview import write_summary
    from gvla2.record.progress import Progress
    from gvla2.record.recorder import RunRecorder, write_index

    composed = OmegaConf.to_yaml(OmegaConf.structured(config))
    if config.episodes > 1:
        write_text(folder / "config.yaml", composed)
    records = [] if records is None else records
    with ExitStack() as stack:
        parts = _build(config, registry, stack)
        progress = stack.enter_context(Progress(quiet=config.quiet, label=label))
        progress.say(bank_line(config, parts.memory))
        tracking = stack.enter_context(Tracking(registry.build(config, "tracker"), config, folder))
        blame = partial(crashed_component, parts, registry)
        for number in range(config.episodes):
            target = folder if config.episodes == 1 else folder / f"episode_{number:03d}"
            recorder = RunRecorder(target, composed, command="run")
            record = _run_one(parts, config, config.seed + number, _Listener(recorder, progress), blame)
            records.append(record)
            tracking.episode(number, record, target)
            if config.episodes > 1:
                write_summary(folder, records)
                write_index(folder, records)
            if record.failure is not None and record.failure.kind in ABANDONED:
                raise Gvla2Error(f"{record.failure.message} (stage: {record.failure.stage}; see {target})")
    return sum(bool(r.judgement and r.judgement.eased) for r in records) / len(records)


def bank_line(config: RunConfig, memory: Memory) -> str:
    """Which bank the run uses and how many lessons that holds, in a sentence."""
    options: Any = getattr(config, "memory")  # noqa: B009  # a field that the bridge to Hydra adds
    stats = getattr(memory, "stats", None)
    if not callable(stats):
        return f"memory {options.name} keeps no bank"
    try:
        held = sum(stats()["types"].values())
    except Gvla2Error as error:
        return f"memory {options.name}, bank '{options.bank}': {error}"
    url = getattr(memory, "url", options.url)
    return f"memory {options.name}, bank '{options.bank}' of {url}: {held} {'lesson' if held == 1 else 'lessons'}"


def _build(config: RunConfig, registry: Registry, stack: ExitStack) -> Parts:
    """All components of the run; robot and memory are closed when ``stack`` unwinds."""
    parts = build_parts(config, registry)
    stack.enter_context(closing(parts.robot))
    stack.enter_context(closing(parts.memory))
    return parts


def build_parts(config: RunConfig, registry: Registry) -> Parts:
    """All components that the configuration chose; the caller closes the robot and the memory."""
    from gvla2.episode import Parts
    from gvla2.loop.refine import GeometryParts

    loop = ("robot", "task", "perceiver", "memory", "planner", "fallback", "verifier")
    geometry = ("reconstructor", "prior", "axis", "fusion", "renderer")
    built: dict[str, Any] = {}
    registry.build_all(config, (*loop, *geometry), built)
    chosen = [group for group in registry.groups if group != "language" or group in built]
    return Parts(
        **{kind: built[kind] for kind in loop},
        geometry=GeometryParts(**{kind: built[kind] for kind in geometry}),
        choices={kind: getattr(config, kind).name for kind in chosen},
        skills=registry.skills,
        language=built.get("language"),
    )


def crashed_component(parts: Parts, registry: Registry, error: BaseException) -> str:
    """Whose code raised an unforeseen error: "The planner 'mine' of plugin 'mine' crashed"; "" where no component did.

    The innermost frame of the traceback that lies in the module or package of a component decides.
    """
    built = {**vars(parts.geometry), **vars(parts)}
    homes = {kind: type(built[kind]).__module__ for kind in parts.choices if built.get(kind) is not None}
    for frame, _ in reversed(list(traceback.walk_tb(error.__traceback__))):
        module = str(frame.f_globals.get("__name__", ""))
        for kind, home in homes.items():
            package = home.rpartition(".")[0]
            inside = package not in ("", "gvla2") and f"{module}.".startswith(f"{package}.")
            if module == home or inside:
                name = parts.choices[kind]
                plugin = registry.offers(kind)[name].plugin.name
                return f"The {kind} '{name}' of plugin '{plugin}' crashed"
    return ""


def _run_one(
    parts: Parts,
    config: RunConfig,
    seed: int,
    listener: _Listener,
    blame: Callable[[BaseException], str],
) -> EpisodeRecord:
    from gvla2.episode import EpisodeRequest, run_episode

    request = EpisodeRequest(
        seed=seed,
        instruction=config.instruction,
        depth_noise=config.depth_noise,
        source="/".join(listener.recorder.folder.parts[-_TELLING:]),
        replan=config.replan,
        planner_timeout=config.planner_timeout,
        max_parts=config.max_parts,
        agreement=config.agreement,
    )
    try:
        record = run_episode(parts, request, listener)
    except Exception as error:
        if not isinstance(error, Gvla2Error) and (who := blame(error)):
            error.add_note(f"{who}.")
            listener.name_culprit(who)
        raise
    finally:
        listener.progress.close()
        # Also after an interrupt or a crash: the folder is complete up to there.
        if listener.latest is not None:
            _finish(listener.recorder, listener.latest)
    listener.progress.finish(record, listener.recorder.folder)
    return record


def _finish(recorder: RunRecorder, record: EpisodeRecord) -> None:
    """Write the page, also when Ctrl-C comes while it is being made; a second one gives it up."""
    try:
        recorder.finish(record)
    except KeyboardInterrupt:
        recorder.finish(record)
        raise


def main(argv: list[str]) -> int:
    """Entry of ``gvla2 run [overrides]``; the process's exit status."""
    from gvla2.commands.hydra_job import launch
    from gvla2.commands.sweeps import conclude

    return conclude(launch("run", job, argv), argv)
