"""``gvla2 bench suite=robot``: success task by task, and what memory adds to it: explore, freeze, test."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.commands.bench_arms import chosen_memory, has_bank
from gvla2.commands.bench_design import PlannerDesign, designs
from gvla2.commands.bench_episodes import Lessons, Planned, run_unit
from gvla2.commands.bench_frame import BenchRows, BenchRun
from gvla2.commands.bench_subjects import kind_of
from gvla2.errors import Gvla2Error
from gvla2.evaluation.robot.design import EXPLORATION, SUITE, others_of

if TYPE_CHECKING:
    from gvla2.evaluation.results import Cell
    from gvla2.evaluation.robot.experience import Experience

DATA = "simulated"
TRIES = 3
"""How often an episode is run whose process died."""
COMPARED = "off"
"""The arm that the others are compared to."""

log = logging.getLogger(__name__)


def run(bench: BenchRun) -> list[Cell]:
    """Run what the database lacks; all rows of the design in order, planner by planner.

    Exploration is stored too: every arm of a planner learns from the same episodes, from which the banks in
    ``folder/banks`` are made.
    """
    parted = designs(bench.config, bench.registry)
    with bench.rows([one for design in parted for one in (*design.plan, *design.exploring)]) as rows:
        for design in parted:
            rows.fill(design.exploring, run_unit, EXPLORATION, tries=TRIES)
            school = School(bench, design, rows.known)
            rows.fill(map(school.taught, rows.lacking(design.plan)), run_unit, SUITE, tries=TRIES)
            _film(rows, design, school)
        return [cell for design in parted for cell in rows.of(design.plan)]


class School:
    """Teaches the arms of one planner from its exploration. A bank is written, once, when an episode needs it.

    Raises :class:`Gvla2Error` if the explored rows have gaps: arms that learnt less would be mistaken for full ones.
    """

    def __init__(self, bench: BenchRun, design: PlannerDesign, known: Mapping[str, Cell]) -> None:
        self._bench, self._design = bench, design
        self._experiences = _experiences(design.exploring, known)
        self._lessons: dict[tuple[str, str], Lessons] = {}

    def taught(self, one: Planned) -> Planned:
        """The episode with what its arm has learnt."""
        place = one.task, one.arm.name
        if place not in self._lessons:
            self._lessons[place] = self._learnt(one)
        return replace(one, lessons=self._lessons[place])

    def _learnt(self, one: Planned) -> Lessons:
        learnt = first(self._experiences, one.arm.explored)
        if one.arm.source == "shuffled":
            others = sorted(
                others_of(one.task, self._design.tasks), key=lambda other: kind_of(other) != kind_of(one.task)
            )
            asked = next((e.episode.task for other in others for e in learnt.get(other, ())), None)
            # An arm that asks about another row must not know the row's own lessons: it has a bank for each row.
            learnt = {task: some for task, some in learnt.items() if task != one.task}
            number = list(self._design.tasks).index(one.task)
            return Lessons(self._bank(one, f"{one.arm.name}-{number}", learnt), asked=asked)
        if has_bank(self._bench.registry, one.arm):
            return Lessons(self._bank(one, one.arm.name, learnt))
        if one.arm.source == "best_theta":
            return Lessons(experiences=tuple(learnt.get(one.task, ())))
        return Lessons(experiences=tuple(e for some in learnt.values() for e in some))

    def _bank(self, one: Planned, name: str, learnt: Mapping[str, Sequence[Experience]]) -> str:
        """The file of a bank that knows these lessons, taught unless another row of the arm has done so."""
        from gvla2.evaluation.robot.experience import teach
        from gvla2.io.files import make_folder

        path = make_folder(self._bench.folder / "banks" / self._design.place).absolute() / f"{name}.db"
        known = {lessons.bank for lessons in self._lessons.values()}
        if str(path) not in known:
            root = chosen_memory(self._design.config, self._bench.registry, one.arm, str(path))
            with closing(self._bench.registry.build(root, "memory")) as memory:
                for some in learnt.values():
                    teach(memory, some)
        return str(path)


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


def _experiences(plan: Sequence[Planned], known: Mapping[str, Cell]) -> dict[str, list[Experience]]:
    """Each task's experience from exploration, in the order of its seeds."""
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


def _film(rows: BenchRows, design: PlannerDesign, school: School) -> None:
    """Run the episodes worth it once more with the camera on, with the same result; their cells name the films."""
    for one in worth_filming(design.plan, rows.known, design.config.videos):
        cell = rows.known[one.keys["relaxed"]]
        if Path(str(cell.notes.get("film", "")) or "/nowhere").is_dir():
            continue
        place = rows.bench.folder / "failures" / design.place / f"{one.task}-{one.arm.name}"
        log.info("Filming %s, layout %d.", one.label, one.layout)
        filmed = replace(school.taught(one), film=str(place.absolute()))
        same = run_unit(filmed, rows.bench.registry)[0].measures["success"] == cell.measures["success"]
        notes = {"film": str(place.absolute() / str(one.layout)), "film_agrees": same}
        rows.known.update(rows.bench.store([replace(cell, notes={**cell.notes, **notes})]))


def worth_filming(plan: Sequence[Planned], cells: Mapping[str, Cell], videos: int) -> list[Planned]:
    """Episodes of a plan to film, at most ``videos`` per row and arm.

    Where an arm and memory off ended differently on one layout both are shown; the rest are failures.
    """
    at = {(one.task, one.arm.name, one.layout): one for one in plan}
    ended = {id(one): cells[one.keys["relaxed"]].measures["success"] for one in plan}
    chosen: list[Planned] = []
    taken: Counter[tuple[str, str]] = Counter()

    def take(one: Planned) -> None:
        if one not in chosen and taken[one.task, one.arm.name] < videos:
            chosen.append(one)
            taken[one.task, one.arm.name] += 1

    for one in plan:
        other = at.get((one.task, COMPARED, one.layout), one)
        if {ended[id(one)], ended[id(other)]} == {True, False} and taken[one.task, one.arm.name] < videos:
            take(one)
            take(other)
    for one in plan:
        if ended[id(one)] == 0:
            take(one)
    return chosen
