"""``gvla2 run``: one episode, or several, from an instruction to a page that explains what happened."""

from __future__ import annotations

import logging
import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.errors import HydraException
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from gvla2.commands import sweeps
from gvla2.errors import ConfigurationError, Gvla2Error, kept_alive
from gvla2.evaluation.config import ResultsConfig
from gvla2.evaluation.statistics import wilson_interval
from gvla2.plugins.assembly import build_components
from gvla2.plugins.discovery import describe
from gvla2.plugins.hydra_config import EveryKind
from gvla2.plugins.registry import load_plugins
from gvla2.reconstruction.options import BranchOptions
from gvla2.record.text import count, printable
from gvla2.robot.options import DepthNoise

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from gvla2.episode.loop import Components, EpisodeRequest
    from gvla2.episode.record import EpisodeRecord, Stage
    from gvla2.memory.contracts import Memory
    from gvla2.plugins.registry import Registry
    from gvla2.record.progress import Progress
    from gvla2.record.recorder import RunRecorder
    from gvla2.record.tracker import TrackedRun, Tracker, Viewer
    from gvla2.robot.backend import Moment

log = logging.getLogger(__name__)

_OF_EPISODE = ("instruction", "depth_noise", "second_tries", "replan", "planner_timeout")
"""Options of a run that each of its episodes has."""
RECORDS = ("none", "light", "full")
_SOURCE_FOLDERS = 4
"""Last folders of a run's path that identify its episode: the day, the time, the job of a sweep, the seed."""


@dataclass
class RunConfig(EveryKind):
    """One episode, or many. Besides these options there is one group for each kind of component.

    ``instruction`` replaces the task's own sentence; ``seed`` lays out the first episode, the next ones count up;
    ``quiet`` prints only the result. ``record`` is what stays of an episode: ``full``; ``light`` without film, views
    and 3D scene; ``none`` but ``config.yaml`` and ``result.json``. An object that the hand surely missed or lost is
    tried again with another grasp or place, up to ``second_tries`` times an episode. After an attempt that the verifier
    is sure has failed, the robot observes and plans again, up to ``replan`` times an episode, with the reason of the
    failure. A planner without an answer after ``planner_timeout`` seconds ends its episode; 0 waits for ever. Where the
    planner fails or lacks the means, ``fallback`` plans, another planner or none.
    ``branch`` holds the options of the reconstruction branch, which runs where a ``reconstructor`` is chosen. A sweep
    puts its jobs into the database ``results``; finished jobs in its folder are kept, unless ``results.fresh``.
    """

    instruction: str | None = None
    seed: int = 0
    episodes: int = 1
    quiet: bool = False
    record: str = "full"
    second_tries: int = 2
    replan: int = 0
    planner_timeout: float = 60.0
    depth_noise: DepthNoise = field(default_factory=DepthNoise)
    branch: BranchOptions = field(default_factory=BranchOptions)
    results: ResultsConfig = field(default_factory=ResultsConfig)

    def __post_init__(self) -> None:
        for name, least in (("episodes", 1), ("seed", 0), ("second_tries", 0), ("replan", 0)):
            if getattr(self, name) < least:
                raise ConfigurationError(f"{name} is {getattr(self, name)}; it must be at least {least}.")
        if self.record not in RECORDS:
            raise ConfigurationError(f"record is '{self.record}'; it is one of {', '.join(RECORDS)}.")
        if not 0 <= self.planner_timeout < math.inf:
            raise ConfigurationError(
                f"planner_timeout is {self.planner_timeout}; it is in seconds, finite and not negative (0: for ever)."
            )


class EpisodeReporter:
    """Passes an episode's events to its recorder and the terminal; keeps the latest record."""

    def __init__(self, recorder: RunRecorder, progress: Progress) -> None:
        self._recorder, self._progress = recorder, progress
        self.latest: EpisodeRecord | None = None

    def begin(self, stage: Stage) -> None:
        """A stage begins."""
        self._progress.begin(stage)

    def stage(self, record: EpisodeRecord, stage: Stage) -> None:
        """A stage ended, successfully or not."""
        self.latest = record
        self._recorder.stage(record, stage)
        log.info("%s: %s", stage, record.failure or f"{record.timings.get(stage, 0.0):.2f} s")
        self._progress.stage(record, stage)

    @property
    def wants_frames(self) -> bool:
        """Whether the motion is filmed."""
        return self._recorder.films

    def moment(self, moment: Moment) -> None:
        """The robot's state at the next frame."""
        self._recorder.moment(moment)

    def frame(self, image: NDArray[np.uint8]) -> None:
        """A frame of the moving robot."""
        self._recorder.frame(image)

    def finish(self) -> None:
        """Write the page, even if Ctrl-C comes meanwhile; a second one cancels it."""
        self._progress.close()
        if self.latest is None:
            return
        try:
            self._recorder.finish(self.latest)
        except KeyboardInterrupt:
            self._recorder.finish(self.latest)
            raise


def job(config: RunConfig, registry: Registry, folder: Path) -> float:
    """Run the configured episodes into ``folder``; returns the share that succeeded, for sweepers.

    A job of a sweep has its own bank unless one is named, and is not run again in a folder where it is done. Raises
    :class:`Gvla2Error` when an episode could not be carried out (the robot would not start, say); an episode that was
    carried out and failed is a result.
    """
    from gvla2.record.page import episode_folder

    sweeping = sweeps.in_sweep()
    config = sweeps.with_fresh_bank(config, folder) if sweeping else config

    def run(label: str) -> tuple[float, list[sweeps.Measured]]:
        records = run_episodes(config, registry, folder, label, count_crashes=sweeping)
        several = config.episodes > 1
        places = [episode_folder(folder, number) if several else folder for number in range(len(records))]
        return success_rate(records), list(map(sweeps.measured, records, places))

    return sweeps.kept_job(config, folder, run)


def success_rate(records: Sequence[EpisodeRecord]) -> float:
    """The share of episodes that the task's success check calls a success."""
    return sum(bool(r.success_check and r.success_check.relaxed) for r in records) / len(records)


def run_episodes(
    config: RunConfig, registry: Registry, folder: Path, label: str = "", *, count_crashes: bool = False
) -> list[EpisodeRecord]:
    """Run the configured episodes: one into ``folder``, several into ``episode_NNN`` with an overview above them.

    ``label`` begins each line on the terminal. With ``count_crashes`` an episode whose planner crashed is a failed one
    and the next one follows; otherwise the crash is raised.
    """
    from gvla2.episode.loop import EpisodeRequest
    from gvla2.episode.record import ABANDONED, planner_crashed
    from gvla2.io.files import write_text
    from gvla2.record.origin import origin_of
    from gvla2.record.page import episode_folder, write_index, write_summary
    from gvla2.record.progress import Progress
    from gvla2.record.recorder import RunRecorder

    composed, origin = OmegaConf.to_yaml(OmegaConf.structured(config)), origin_of(config, "run")
    if config.episodes > 1:
        write_text(folder / "config.yaml", composed)
    records: list[EpisodeRecord] = []
    with ExitStack() as stack:
        components = build_components(config, registry, branch=config.branch)
        stack.enter_context(closing(components.robot))
        stack.enter_context(closing(components.memory))
        progress = stack.enter_context(Progress(quiet=config.quiet, label=label))
        progress.say(bank_line(config, components.memory))
        tracker, viewer = (registry.build(config, kind) for kind in ("tracker", "view"))
        tracking = stack.enter_context(Tracking(tracker, config, folder, viewer, components.named))
        options: dict[str, Any] = {name: getattr(config, name) for name in _OF_EPISODE}
        for number in range(config.episodes):
            target = folder if config.episodes == 1 else episode_folder(folder, number)
            source = "/".join(target.parts[-_SOURCE_FOLDERS:])
            request = EpisodeRequest(seed=config.seed + number, source=source, **options)
            recorder = RunRecorder(target, composed, "run", origin, config.record)
            listener = EpisodeReporter(recorder, progress)
            record = _run_one(components, request, listener, count_crashes=count_crashes)
            progress.finish(record, target)
            records.append(record)
            tracking.episode(number, record, target)
            if config.episodes > 1:
                write_summary(folder, records)
                if config.record != "none":
                    write_index(folder, records)
            failure = record.failure
            if failure is not None and failure.kind in ABANDONED and not planner_crashed(record):
                raise Gvla2Error(f"{failure.message} (stage: {failure.stage}; see {target})")
        if config.episodes > 1:
            progress.say(total_line(records), always=True)
        reasons = [why for record in records if (why := record.memory_unavailable)]
        if reasons:  # also when quiet: such episodes are no evidence about memory
            line = f"memory unavailable in {len(reasons)} of {count(len(records), 'episode')}: {reasons[0]}"
            progress.say(line, "yellow", always=True)
    return records


def total_line(records: Sequence[EpisodeRecord]) -> str:
    """The episodes of a run on one line: successes with their 95 % interval, the failures, the time."""
    won = sum(bool(r.success_check and r.success_check.relaxed) for r in records)
    low, high = wilson_interval(won, len(records))
    failures = Counter(code for record in records if (code := sweeps.failure_code(record)))
    parts = [
        f"{won} of {count(len(records), 'episode')} succeeded, {100 * won / len(records):.0f} %",
        f"95 % interval {100 * low:.0f} to {100 * high:.0f}",
        *(f"{amount} {code}" for code, amount in failures.most_common()),
        sweeps.duration(sum(record.seconds for record in records)),
    ]
    return " | ".join(parts)


def _run_one(
    components: Components, request: EpisodeRequest, listener: EpisodeReporter, *, count_crashes: bool
) -> EpisodeRecord:
    """One episode; its folder is complete up to that point also after an interrupt or a crash."""
    from gvla2.episode.loop import run_episode
    from gvla2.episode.record import planner_crashed

    try:
        return run_episode(components, request, listener)
    except Exception:
        latest = listener.latest
        if not count_crashes or latest is None or not planner_crashed(latest):
            raise
        log.info("The planner crashed: this episode counts as a failure.", exc_info=True)
        return latest
    finally:
        listener.finish()


def bank_line(config: RunConfig, memory: Memory) -> str:
    """Which bank the run uses, in a sentence."""
    options: Any = getattr(config, "memory")  # noqa: B009  # a field that the bridge to Hydra adds
    bank = getattr(options, "bank", "")
    if not bank:
        return f"memory {options.name} keeps no bank"
    return f"memory {options.name}, bank '{bank}' of {getattr(memory, 'url', options.url)}"


class Tracking:
    """Reports a run to tracker and viewer as a context manager around its episodes.

    A failure of either is logged once, by the name that ``named`` gives, and the run goes on without it.
    """

    def __init__(
        self,
        tracker: Tracker | None,
        config: Any,
        folder: Path,
        viewer: Viewer | None = None,
        named: Callable[[str], str] = "The {}".format,
    ) -> None:
        self._reports_to: dict[str, Any] = {"tracker": tracker, "view": viewer}
        self._config, self._folder, self._named = config, folder, named

    def __enter__(self) -> Tracking:
        self._call("tracker", lambda tracker: tracker.begin(self._run()))
        return self

    def _run(self) -> TrackedRun:
        from gvla2.record.tracker import TrackedRun

        config: Any = OmegaConf.to_container(OmegaConf.structured(self._config), enum_to_str=True)
        return TrackedRun("/".join(self._folder.parts[-2:]), self._folder, config)

    def episode(self, number: int, record: EpisodeRecord, folder: Path) -> None:
        """Report a finished episode."""
        self._call("tracker", lambda tracker: tracker.episode(number, sweeps.measures_of(record), folder))
        self._call("view", lambda viewer: viewer.show(record, folder))

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._call("tracker", lambda tracker: tracker.end(well=kind is None))

    def _call(self, who: str, call: Callable[[Any], None]) -> None:
        try:
            if self._reports_to[who] is not None:
                with kept_alive():
                    call(self._reports_to[who])
        except Exception as error:
            self._reports_to[who] = None
            message = printable(describe(error))
            log.warning("%s failed and is no longer used: %s", self._named(who), message)
            log.info("The error:", exc_info=error)


def run_here(options: Mapping[str, Any], folder: Path | str | None) -> EpisodeRecord:
    """:func:`gvla2.run`."""
    from gvla2.commands.hydra_job import as_overrides, composed, explain

    registry = load_plugins()
    word = folder if isinstance(folder, str) else ""
    if word in registry.components("task") or word.partition("=")[0] in registry.groups:
        raise ConfigurationError(
            f"The first argument of gvla2.run is a folder for its files, not '{word}': options are keywords, such as "
            "gvla2.run(task='push_block')."
        )
    try:
        config, _ = composed("run", as_overrides({"quiet": True, **options}), registry)
    except (HydraException, OmegaConfBaseException) as error:
        raise ConfigurationError(explain(error, registry)) from error
    if config.episodes != 1:
        raise ConfigurationError("gvla2.run runs one episode: loop over seed, or use `gvla2 run episodes=N`.")
    if folder is not None:
        return run_episodes(config, registry, Path(folder))[0]
    from gvla2.episode.loop import EpisodeRequest, run_episode
    from gvla2.episode.record import ABANDONED

    components = build_components(config, registry, branch=config.branch)
    with closing(components.robot), closing(components.memory):
        request = EpisodeRequest(seed=config.seed, **{name: getattr(config, name) for name in _OF_EPISODE})
        record = run_episode(components, request)
    if record.failure is not None and record.failure.kind in ABANDONED:
        raise Gvla2Error(f"{record.failure.message} (stage: {record.failure.stage})")
    return record


def main(argv: Sequence[str]) -> int:
    """Entry of ``gvla2 run [overrides]``; the process's exit status."""
    # An episode's matrices are small: on several threads they mostly wait, for one another and for pictures and film.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from gvla2.commands.hydra_job import launch

    return sweeps.conclude("run", launch("run", {"run": RunConfig}, job, argv), argv)
