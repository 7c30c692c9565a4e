"""``gvla2 bench suite=robot``: success task by task, and what memory adds to it: explore, freeze, test."""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.commands.bench_arms import arm_named, has_bank
from gvla2.commands.bench_config import BenchConfig
from gvla2.commands.bench_design import Planned, PlannerDesign, designs
from gvla2.commands.bench_episodes import EXPLORED, EpisodeOutcome, EpisodeUnit, chosen_memory, run_unit
from gvla2.commands.bench_frame import BenchRun
from gvla2.commands.bench_progress import BenchProgress
from gvla2.commands.bench_subjects import kind_of
from gvla2.errors import Gvla2Error
from gvla2.evaluation.robot.design import EXPLORATION, NOT_MEASURED, SUITE, others_of

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell
    from gvla2.evaluation.robot.experience import Experience

DATA = "simulated"
TOGETHER = 5
"""Episodes that a process runs before their rows are stored."""
COMPARED = "off"
"""The arm that the others are compared to."""

log = logging.getLogger(__name__)


def run(bench: BenchRun) -> list[Cell]:
    """Run what the database lacks; all rows of the design in order, planner by planner.

    Exploration is stored too: every arm of a planner learns from the same episodes, from which the banks in
    ``folder/banks`` are made.
    """
    parted = designs(bench.config, bench.registry)
    episodes = [one for design in parted for one in (*design.plan, *design.exploring)]
    known = bench.known([key for one in episodes for key in one.keys.values()])
    with bench.progress(len(_lacking(episodes, known))) as progress:
        return [c for design in parted for c in _PlannerBench(design, bench, progress).measure(known)]


def _lacking(wanted: Iterable[Planned], known: Mapping[str, Cell]) -> list[Planned]:
    """The episodes with an unmeasured profile, each once."""
    once = {tuple(one.keys.values()): one for one in wanted}
    return [one for keys, one in once.items() if not known.keys() >= set(keys)]


@dataclass(frozen=True)
class _PlannerBench:
    """One planner's stages: explore, freeze, test, film."""

    design: PlannerDesign
    bench: BenchRun
    progress: BenchProgress

    def measure(self, known: dict[str, Cell]) -> list[Cell]:
        """The planner's rows; what is measured is stored and added to ``known``."""
        design = self.design
        lacking = _lacking(design.exploring, known)
        self._carry_out(lacking, _units(design.teaching, lacking), EXPLORATION, known)
        experiences = _experiences(design.exploring, known)
        lacking = _lacking(design.plan, known)
        banks = self._banks(lacking, experiences)
        units = _units(design.config, lacking, experiences, banks, design.tasks)
        self._carry_out(lacking, units, SUITE, known)
        cells = {key: known[key] for one in design.plan for key in one.keys.values()}
        filmed = self._filmed(cells, experiences, banks)
        self.bench.store(list(filmed.values()))
        return list((cells | filmed).values())

    def _carry_out(
        self, planned: Sequence[Planned], units: Sequence[EpisodeUnit], suite: str, known: dict[str, Cell]
    ) -> None:
        by_place = {(one.task, one.arm, one.layout): one for one in planned}
        for unit, outcomes in self.bench.measured(run_unit, units, tries=3):
            cells = [c for each in outcomes for c in _cells(by_place[unit.task, unit.arm, each.layout], each)]
            known |= self.bench.store(cells, suite)
            self.progress.done(len(outcomes), f"{unit.config.planner.name}, {unit.task}, {unit.arm}")

    def _banks(
        self, planned: Iterable[Planned], experiences: Mapping[str, Sequence[Experience]]
    ) -> dict[tuple[str, str], str]:
        """Teach each memory that keeps a file, once; the files by row and arm.

        An arm that asks about another row must not know the row's own lessons: it has a bank for each row.
        """
        from gvla2.evaluation.robot.experience import teach
        from gvla2.record.files import make_folder

        banks: dict[tuple[str, str], str] = {}
        taught: dict[str, str] = {}
        for task, arm in dict.fromkeys((one.task, one.arm) for one in planned):
            made = arm_named(self.design.config, arm)
            if not has_bank(self.bench.registry, made):
                continue
            own = made.source == "shuffled"
            name = f"{arm}-{list(self.design.tasks).index(task)}" if own else arm
            if name not in taught:
                path = make_folder(self.bench.folder / "banks" / self.design.place).absolute() / f"{name}.db"
                root = chosen_memory(self.design.config, self.bench.registry, made, str(path))
                lessons = first(experiences, made.explored)
                with closing(self.bench.registry.build(root, "memory")) as memory:
                    for other, learnt in lessons.items():
                        if not own or other != task:
                            teach(memory, learnt)
                taught[name] = str(path)
            banks[task, arm] = taught[name]
        return banks

    def _filmed(
        self,
        cells: Mapping[str, Cell],
        experiences: Mapping[str, Sequence[Experience]],
        banks: Mapping[tuple[str, str], str],
    ) -> dict[str, Cell]:
        """The cells that get a film folder: their episode is run again, with the same result."""
        design = self.design
        found: dict[str, Cell] = {}
        chosen = [
            one
            for one in worth_filming(design.plan, cells, design.config.videos)
            if not Path(str(cells[one.keys["eased"]].notes.get("film", "")) or "/nowhere").is_dir()
        ]
        banks = {**banks, **self._banks((o for o in chosen if (o.task, o.arm) not in banks), experiences)}
        for one in chosen:
            place = (self.bench.folder / "failures" / design.place / f"{one.task}-{one.arm}").absolute()
            (unit,) = _units(design.config, [one], experiences, banks, design.tasks, str(place))
            log.info("Filming %s, %s, %s, layout %d.", design.planner, one.task, one.arm, one.layout)
            (outcome,) = run_unit(unit, self.bench.registry)
            cell = cells[one.keys["eased"]]
            same = outcome.succeeded["eased"] == cell.measures["success"]
            notes = {"film": str(place / str(one.layout)), "film_agrees": same}
            found[cell.key] = replace(cell, notes={**cell.notes, **notes})
        return found


def worth_filming(plan: Sequence[Planned], cells: Mapping[str, Cell], videos: int) -> list[Planned]:
    """Episodes of a plan to film, at most ``videos`` per row and arm.

    Where an arm and memory off ended differently on one layout both are shown; the rest are failures.
    """
    at = {(one.task, one.arm, one.layout): one for one in plan}
    ended = {id(one): cells[one.keys["eased"]].measures["success"] for one in plan}
    chosen: list[Planned] = []
    taken: Counter[tuple[str, str]] = Counter()

    def take(one: Planned) -> None:
        if one not in chosen and taken[one.task, one.arm] < videos:
            chosen.append(one)
            taken[one.task, one.arm] += 1

    for one in plan:
        other = at.get((one.task, COMPARED, one.layout), one)
        if {ended[id(one)], ended[id(other)]} == {True, False} and taken[one.task, one.arm] < videos:
            take(one)
            take(other)
    for one in plan:
        if ended[id(one)] == 0:
            take(one)
    return chosen


def _units(
    config: BenchConfig,
    planned: Sequence[Planned],
    experiences: Mapping[str, Sequence[Experience]] | None = None,
    banks: Mapping[tuple[str, str], str] | None = None,
    tasks: Sequence[str] = (),
    film: str = "",
) -> list[EpisodeUnit]:
    """Some episodes of one task and arm each; a task's arms come one after the other, so that its parts are reused."""
    grouped: dict[tuple[str, str], list[int]] = defaultdict(list)
    for one in planned:
        grouped[one.task, one.arm].append(one.layout)
    units = []
    for (task, arm), layouts in grouped.items():
        asked = None
        learnt = first(experiences or {}, None if arm == EXPLORED else arm_named(config, arm).explored)
        source = "off" if arm == EXPLORED else arm_named(config, arm).source
        if source == "shuffled":
            others = sorted(others_of(task, tasks), key=lambda other: kind_of(other) != kind_of(task))
            asked = next((e.episode.task for other in others for e in learnt.get(other, ())), None)
        own = learnt.get(task, ()) if source == "best_theta" else [e for one in learnt.values() for e in one]
        for start in range(0, len(layouts), TOGETHER):
            some = tuple(layouts[start : start + TOGETHER])
            bank = (banks or {}).get((task, arm), "")
            units.append(EpisodeUnit(config, task, arm, some, bank, tuple(own), asked, film))
    return units


def first(
    experiences: Mapping[str, Sequence[Experience]], layouts: int | None
) -> Mapping[str, Sequence[Experience]]:
    """Experience from the first so many explored layouts of each row; all of it for None."""
    if layouts is None:
        return experiences
    found = {}
    for task, learnt in experiences.items():
        seeds = list(dict.fromkeys(one.seed for one in learnt))[:layouts]
        found[task] = [one for one in learnt if one.seed in seeds]
    return found


def _cells(planned: Planned, outcome: EpisodeOutcome) -> list[Cell]:
    from gvla2.evaluation.results import Cell

    measured = outcome.failure not in NOT_MEASURED
    status = "ok" if measured else f"not measured: {outcome.failure}"
    notes: dict[str, Any] = {"status": status, "layout": outcome.layout, **outcome.notes}
    if outcome.experience:
        notes["experience"] = [one.to_json() for one in outcome.experience]
    cells = []
    for profile, key in planned.keys.items():
        done = outcome.succeeded.get(profile, outcome.succeeded["eased"])
        failure = "" if done else outcome.failure or "not_strictly"
        told = {"failure": failure, "message": "" if done else outcome.message}
        factors = dict(planned.factors) | ({} if profile == "both" else {"profile": profile})
        measures = {"success": done if measured else None, "seconds": outcome.seconds, **outcome.spent}
        cells.append(Cell(key, factors, measures, {**notes, **told}))
    return cells


def _experiences(plan: Sequence[Planned], known: Mapping[str, Cell]) -> dict[str, list[Experience]]:
    """Each task's experience from exploration, in the order of its seeds.

    Raises :class:`Gvla2Error` if exploration has gaps: arms that learnt less would be mistaken for full ones.
    """
    from gvla2.evaluation.robot.experience import Experience

    gaps = [one for one in plan if known[one.keys["both"]].notes.get("status") != "ok"]
    if gaps:
        tasks = ", ".join(dict.fromkeys(one.task for one in gaps))
        raise Gvla2Error(
            f"{len(gaps)} of {len(plan)} explored episodes could not be measured ({tasks}): no answer in time, or "
            "no language model. Finished measurements are kept; run again, or with a longer planner_timeout=SECONDS."
        )
    found: dict[str, list[Experience]] = {}
    for one in plan:
        told = known[one.keys["both"]].notes.get("experience") or ()
        found.setdefault(one.task, []).extend(map(Experience.from_json, told))
    return found
