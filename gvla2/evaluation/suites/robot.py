"""The suite ``robot``: success task by task, and what memory adds to it: explore, freeze, test.

All arms learn from the same explored episodes, which are stored too; the banks made from them are in ``folder/banks``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import yaml

from gvla2.errors import Gvla2Error
from gvla2.evaluation.arms import STORIES, Story, chosen_memory, has_bank, teach
from gvla2.evaluation.config import RobotBench
from gvla2.evaluation.engine import Rows, Suite
from gvla2.evaluation.results import Cell, Run
from gvla2.evaluation.suites.robot_design import (
    EXPLORATION,
    FAMILY,
    SUITE,
    Design,
    designs,
    world_of,
)
from gvla2.evaluation.suites.robot_episodes import EXPLORED, EpisodeUnit, Lessons, release, run_unit
from gvla2.evaluation.suites.robot_tables import robot_sheets
from gvla2.evaluation.tables import Sheet
from gvla2.plugins.registry import Registry
from gvla2.record.origin import origin_of

OTHERS = ("groups", "published")
"""Options of a run that its report takes up."""


class RobotSuite(Suite[RobotBench, EpisodeUnit]):
    """Two stages: exploration, then the test of every arm, taught and frozen."""

    name = SUITE
    title = "Robot"
    tries = 3

    def stages(self) -> Sequence[Sequence[EpisodeUnit]]:
        """Explored episodes, then the test's."""
        self.designs = {world_of(design.config): design for design in designs(self.config, self.registry)}
        self._schools: dict[str, School] = {}
        made = self.designs.values()
        return [[u for one in made for u in one.exploring], [u for one in made for u in one.plan]]

    def stored_as(self, stage: int) -> str:
        """Exploration has a name of its own."""
        return EXPLORATION if stage == 0 else self.name

    def prepare(self, unit: EpisodeUnit, rows: Rows) -> EpisodeUnit:
        """An episode of the test with what its arm has learned."""
        if unit.arm.name == EXPLORED:
            return unit
        world = world_of(unit.config)
        if world not in self._schools:
            self._schools[world] = School(self.designs[world], self.registry, self.folder, rows)
        unit = replace(unit, lessons=self._schools[world].lessons(unit))
        if self.config.films == "none":
            return unit
        place = self.folder / "episodes" / re.sub(r"\W+", "_", unit.subject)
        origin = origin_of(self.config, "bench")
        return replace(unit, folder=place / f"{unit.arm.name}_{unit.layout}", origin=origin)

    @staticmethod
    def measure(unit: EpisodeUnit, registry: Registry) -> list[Cell]:
        """Both profiles' rows of an episode."""
        return run_unit(unit, registry)

    def close(self) -> None:
        """Release the robot of this process."""
        release()

    @staticmethod
    def sheets(cells: Sequence[Cell], runs: Sequence[Run] = ()) -> list[Sheet]:
        """Success, the differences between arms, costs and failures of each group that can be compared."""
        configs = [yaml.safe_load(run.config) or {} for run in runs]
        groups, published = ({k: v for one in configs for k, v in one.get(of, {}).items()} for of in OTHERS)
        return robot_sheets(cells, groups, published)


class School:
    """Teaches the arms of one world from its exploration. A bank is written, once, when an episode needs it.

    Raises :class:`Gvla2Error` if the explored rows have gaps: arms that learned less would be mistaken for full ones.
    """

    def __init__(self, design: Design, registry: Registry, folder: Path, rows: Rows) -> None:
        self._design, self._registry = design, registry
        self._folder = (folder / "banks" / world_of(design.config)).absolute()
        self._lessons: dict[tuple[str, str], Lessons] = {}
        self._stories: dict[str, list[Story]] = {}
        explored = [(unit, rows[unit.keys[0]]) for unit in design.exploring]
        gaps = [unit.subject for unit, cell in explored if cell.status != "ok"]
        if gaps:
            raise Gvla2Error(
                f"{len(gaps)} of {len(explored)} explored episodes could not be measured "
                f"({', '.join(dict.fromkeys(gaps))}): not set up, no answer in time, or no language "
                "model. Finished measurements are kept; run again, or with a longer planner_timeout=SECONDS."
            )
        for unit, cell in explored:
            found = STORIES.validate_python(cell.notes.get("stories") or ())
            self._stories.setdefault(unit.subject, []).extend(found)

    def lessons(self, unit: EpisodeUnit) -> Lessons:
        """What the arm of a row has learned."""
        subject, arm = unit.subject, unit.arm
        key = subject, arm.name
        if key in self._lessons:
            return self._lessons[key]
        known = dict(self._stories)
        rows = list(self._design.subjects)
        bank, asked = arm.name, None
        if arm.source == "shuffled":
            place = rows.index(subject)
            others = [*rows[place + 1 :], *rows[:place]]
            # Another family of the same task comes first: only the family's own numbers differ.
            others.sort(key=lambda other: other.partition(FAMILY)[0] != subject.partition(FAMILY)[0])
            asked = next((episode.task for other in others for episode, _ in known.get(other, ())), None)
            # An arm that asks about another row must not know the row's own lessons: it has a bank for each row.
            known.pop(subject, None)
            bank = f"{arm.name}-{place}"
        if has_bank(self._registry, arm):
            self._lessons[key] = Lessons(self._bank(unit, bank, known), asked=asked)
        else:
            self._lessons[key] = Lessons(stories=tuple(story for some in known.values() for story in some))
        return self._lessons[key]

    def _bank(self, unit: EpisodeUnit, name: str, known: Mapping[str, Sequence[Story]]) -> str:
        """The file of a bank that knows these lessons, taught unless another row of the arm has done so."""
        path = self._folder / f"{name}.db"
        if str(path) not in {lessons.bank for lessons in self._lessons.values()}:
            path.parent.mkdir(parents=True, exist_ok=True)
            root = chosen_memory(self._design.config, self._registry, unit.arm, str(path))
            with closing(self._registry.build(root, "memory")) as memory:
                for some in known.values():
                    teach(memory, some)
        return str(path)
