"""``gvla2 run``: one episode, or several, from an instruction to a page that explains what happened."""

from __future__ import annotations

import logging
import os
import sys
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from inspect import unwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

from omegaconf import OmegaConf

from gvla2.errors import Gvla2Error
from gvla2.plugins.assembly import build_components
from gvla2.record.text import count

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gvla2.commands.run_config import RunConfig
    from gvla2.episode.loop import Components
    from gvla2.episode.record import EpisodeRecord, Stage
    from gvla2.memory.contracts import Memory
    from gvla2.plugins.registry import Registry
    from gvla2.record.progress import Progress
    from gvla2.record.recorder import RunRecorder
    from gvla2.robot.backend import Moment

log = logging.getLogger(__name__)

_TELLING = 4
"""Parts of a run's folder that identify its episode: the day, the time, the job of a sweep, the seed."""


@dataclass
class EpisodeReporter:
    """Passes an episode's events to its recorder and the terminal, if any; keeps the latest record."""

    recorder: RunRecorder | None = None
    progress: Progress | None = None
    latest: EpisodeRecord | None = None

    @property
    def wants_frames(self) -> bool:
        """Whether a recorder keeps them."""
        return self.recorder is not None

    def begin(self, stage: Stage) -> None:
        """A stage begins."""
        if self.progress is not None:
            self.progress.begin(stage)

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """A stage ended, successfully or not."""
        self.latest = record
        if self.recorder is not None:
            self.recorder.stage(record, stage)
        if self.progress is not None:
            failure, seconds = record.failure, record.timings.get(stage, 0.0)
            log.info(
                "%s: %s", stage, f"{failure.message} ({failure.kind})" if failure else f"{seconds:.2f} s"
            )
            self.progress.stage(record, stage)

    def name_culprit(self, who: str) -> None:
        """Note in the latest record which component crashed."""
        if self.latest is not None and self.latest.failure is not None:
            failure = self.latest.failure
            self.latest = replace(self.latest, failure=replace(failure, message=f"{who}: {failure.message}"))

    def moment(self, moment: Moment) -> None:
        """The robot's state at the next frame."""
        if self.recorder is not None:
            self.recorder.moment(moment)

    def frame(self, image: NDArray[np.uint8]) -> None:
        """A frame of the moving robot."""
        if self.recorder is not None:
            self.recorder.frame(image)

    def finish(self) -> None:
        """Write the page, even if Ctrl-C comes meanwhile; a second one cancels it."""
        if self.recorder is None or self.latest is None:
            return
        try:
            self.recorder.finish(self.latest)
        except KeyboardInterrupt:
            self.recorder.finish(self.latest)
            raise


def job(config: RunConfig, registry: Registry, folder: Path) -> float:
    """Run the configured episodes into ``folder``; returns the share that succeeded, for sweepers.

    A job of a sweep has its own bank unless one is named, and is not run again in a folder where it is done. Raises
    :class:`Gvla2Error` when an episode could not be carried out (the robot would not start, say); an episode that was
    carried out and failed is a result.
    """
    from gvla2.commands import sweeps

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
        sweeps.write_job(folder, config, digest, records, error)
        raise
    sweeps.write_job(folder, config, digest, records)
    return share


def run_episodes(
    config: RunConfig,
    registry: Registry,
    folder: Path,
    label: str = "",
    records: list[EpisodeRecord] | None = None,
) -> float:
    """As :func:`job` outside a sweep: the episode itself for one; for several ``episode_NNN``, an overview, the
    aggregate ``result.json`` (brought up to date after each) and the composed configuration.

    ``label`` begins each line on the terminal; ``records`` collects the episodes, also those before an error. Where
    they are collected, to be counted, an episode whose planner crashed is one of them, and the next one follows;
    otherwise the crash is raised.
    """
    from gvla2.commands.tracking import Tracking
    from gvla2.episode.record import ABANDONED, planner_crashed
    from gvla2.io.files import write_text
    from gvla2.record.page import write_summary
    from gvla2.record.progress import Progress
    from gvla2.record.recorder import RunRecorder, write_index

    composed = OmegaConf.to_yaml(OmegaConf.structured(config))
    if config.episodes > 1:
        write_text(folder / "config.yaml", composed)
    counting, records = records is not None, [] if records is None else records
    with ExitStack() as stack:
        parts = build_components(config, registry, branch=config.branch)
        stack.enter_context(closing(parts.robot))
        stack.enter_context(closing(parts.memory))
        progress = stack.enter_context(Progress(quiet=config.quiet, label=label))
        progress.say(bank_line(config, parts.memory))
        stack.callback(_say_unremembered, records, progress)
        tracker, viewer = (registry.build(config, kind) for kind in ("tracker", "view"))
        tracking = stack.enter_context(Tracking(tracker, config, folder, viewer, parts.named))
        blame = partial(crashed_component, parts)
        for number in range(config.episodes):
            target = folder if config.episodes == 1 else folder / f"episode_{number:03d}"
            recorder = RunRecorder(target, composed, command="run")
            listener = EpisodeReporter(recorder, progress)
            source = "/".join(target.parts[-_TELLING:])
            try:
                record = _run_one(parts, config, config.seed + number, listener, blame, source)
            except Exception:
                crashed = listener.latest
                if not counting or crashed is None or not planner_crashed(crashed):
                    raise
                log.info("The planner crashed: this episode counts as a failure.", exc_info=True)
                record = crashed
            progress.finish(record, target)
            records.append(record)
            tracking.episode(number, record, target)
            if config.episodes > 1:
                write_summary(folder, records)
                write_index(folder, records)
            if (
                record.failure is not None
                and record.failure.kind in ABANDONED
                and not planner_crashed(record)
            ):
                raise Gvla2Error(f"{record.failure.message} (stage: {record.failure.stage}; see {target})")
    return sum(bool(r.success_check and r.success_check.relaxed) for r in records) / len(records)


def _say_unremembered(records: Sequence[EpisodeRecord], progress: Progress) -> None:
    """Say, also when quiet, in how many episodes memory was not there: they are no evidence about it."""
    reasons = [why for record in records if (why := record.memory_unavailable)]
    if reasons:
        told = f"memory unavailable in {len(reasons)} of {count(len(records), 'episode')}: {reasons[0]}"
        progress.say(told, "yellow", always=True)


def bank_line(config: RunConfig, memory: Memory) -> str:
    """Which bank the run uses and how many lessons it holds, in a sentence."""
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


def crashed_component(parts: Components, error: BaseException) -> str:
    """Which component raised an unexpected error: "The planner 'mine' of plugin 'mine' crashed"; "" if none did.

    The innermost frame of the traceback that lies in the module or package of a component decides.
    """
    built = {**vars(parts.geometry), **vars(parts)}
    homes = {
        kind: type(unwrap(built[kind])).__module__ for kind in parts.choices if built.get(kind) is not None
    }
    for frame, _ in reversed(list(traceback.walk_tb(error.__traceback__))):
        module = str(frame.f_globals.get("__name__", ""))
        for kind, home in homes.items():
            package = home.rpartition(".")[0]
            inside = package not in ("", "gvla2") and f"{module}.".startswith(f"{package}.")
            if module == home or inside:
                return f"{parts.named(kind)} crashed"
    return ""


def _run_one(
    parts: Components,
    config: RunConfig,
    seed: int,
    listener: EpisodeReporter,
    blame: Callable[[BaseException], str],
    source: str,
) -> EpisodeRecord:
    from gvla2.episode.loop import EpisodeRequest, run_episode

    same = ("instruction", "depth_noise", "replan", "planner_timeout", "max_parts")
    options: dict[str, Any] = {name: getattr(config, name) for name in same}
    try:
        return run_episode(parts, EpisodeRequest(seed=seed, source=source, **options), listener)
    except Exception as error:
        if not isinstance(error, Gvla2Error) and (who := blame(error)):
            error.add_note(f"{who}.")
            listener.name_culprit(who)
        raise
    finally:
        if listener.progress is not None:
            listener.progress.close()
        listener.finish()  # also after an interrupt or a crash: the folder is complete up to that point


def main(argv: list[str]) -> int:
    """Entry of ``gvla2 run [overrides]``; the process's exit status."""
    # An episode's matrices are small: on several threads they mostly wait, for one another and for pictures and film.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from gvla2.commands.hydra_job import launch
    from gvla2.commands.sweeps import conclude

    return conclude(launch("run", job, argv), argv)
