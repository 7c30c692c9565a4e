"""The suite ``robot``: success task by task, and what memory adds to it: explore, freeze, test.

All arms learn from the same explored episodes, which are stored too; the banks made from them are in ``folder/banks``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import yaml

from gvla2.errors import Gvla2Error
from gvla2.evaluation.arms import STORIES, Story, has_bank, open_memory, teach
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
from gvla2.evaluation.suites.robot_episodes import (
    EXPLORED,
    EpisodeGroup,
    EpisodeUnit,
    Lessons,
    release,
    run_group,
)
from gvla2.evaluation.suites.robot_stress import crowd, hear, hearsay, lived, stresses_of, with_budget
from gvla2.evaluation.suites.robot_tables import robot_sheets
from gvla2.evaluation.tables import Sheet
from gvla2.plugins.registry import Registry
from gvla2.record.origin import origin_of

OTHERS = ("groups", "published")
"""Options of a run that its report takes up."""


class RobotSuite(Suite[RobotBench, EpisodeGroup]):
    """Two stages: exploration, then the test of every arm, taught and frozen."""

    name = SUITE
    title = "Robot"
    tries = 3

    def stages(self) -> Sequence[Sequence[EpisodeGroup]]:
        """Explored episodes, then the test's."""
        self.designs = {world_of(design.config): design for design in designs(self.config, self.registry)}
        self._schools: dict[str, School] = {}
        made = self.designs.values()
        alone = [EpisodeGroup(u.keys, u.label, (u,)) for one in made for u in one.exploring]
        groups: dict[str, list[EpisodeUnit]] = {}
        for unit in (u for one in made for u in one.plan):
            groups.setdefault(repr((unit.task, unit.layout, unit.config.seeds)), []).append(unit)
        return [alone, [_group(some) for some in groups.values()]]

    def stored_as(self, stage: int) -> str:
        """Exploration has a name of its own."""
        return EXPLORATION if stage == 0 else self.name

    def prepare(self, unit: EpisodeGroup, rows: Rows) -> EpisodeGroup:
        """The episodes of the test that lack rows, with what their arms have learned."""
        if unit.episodes[0].arm.name == EXPLORED:
            return unit
        return _group([self._taught(one, rows) for one in unit.episodes if not rows.keys() >= {*one.keys}])

    def _taught(self, unit: EpisodeUnit, rows: Rows) -> EpisodeUnit:
        world = unit.world
        if world not in self._schools:
            self._schools[world] = School(self.designs[world], self.registry, self.folder, rows)
        unit = replace(unit, lessons=self._schools[world].lessons(unit))
        if self.config.films == "none":
            return unit
        place = self.folder / "episodes" / re.sub(r"\W+", "_", unit.subject)
        origin = origin_of(self.config, "bench")
        return replace(unit, folder=place / f"{unit.arm.name}_{unit.layout}", origin=origin)

    @staticmethod
    def measure(unit: EpisodeGroup, registry: Registry) -> Iterator[Cell]:
        """Both profiles' rows of each episode."""
        return run_group(unit, registry)

    def close(self) -> None:
        """Release the robot of this process."""
        release()

    @staticmethod
    def sheets(cells: Sequence[Cell], runs: Sequence[Run] = ()) -> list[Sheet]:
        """Success, the differences between arms, costs and failures of each group that can be compared."""
        configs = [yaml.safe_load(run.config) or {} for run in runs]
        groups, published = ({k: v for one in configs for k, v in one.get(of, {}).items()} for of in OTHERS)
        return robot_sheets(cells, groups, published)


def _group(units: Sequence[EpisodeUnit]) -> EpisodeGroup:
    return EpisodeGroup(tuple(key for unit in units for key in unit.keys), units[0].label, tuple(units))


NEVER = "not measured: setup"
"""The status of an episode that cannot be set up, however often it is tried."""


class School:
    """Teaches the arms of one world from its exploration. A bank is written, once, when an episode needs it.

    Raises :class:`Gvla2Error` if the explored rows have gaps: arms that learned less would be mistaken for full ones.
    Of a layout that cannot be set up nobody learns, now or later.
    """

    def __init__(self, design: Design, registry: Registry, folder: Path, rows: Rows) -> None:
        self._design, self._registry = design, registry
        self._folder = (folder / "banks" / world_of(design.config)).absolute()
        self._lessons: dict[tuple[str, str], Lessons] = {}
        self._stories: dict[str, list[Story]] = {}
        explored = [(unit, rows[unit.keys[0]]) for unit in design.exploring]
        gaps = [unit.subject for unit, cell in explored if cell.status not in ("ok", NEVER)]
        if gaps:
            raise Gvla2Error(
                f"{len(gaps)} of {len(explored)} explored episodes could not be measured "
                f"({', '.join(dict.fromkeys(gaps))}): not set up, no answer in time, or no language "
                "model. Finished measurements are kept; run again, or with a longer planner_timeout=SECONDS."
            )
        for unit, cell in explored:
            found = STORIES.validate_python(cell.notes.get("stories") or ())
            self._stories.setdefault(unit.subject, []).extend(found)
        stresses, seed = stresses_of(design.config), design.config.seeds[0]
        everything = [story for some in self._stories.values() for story in some]
        self._others = crowd(everything) if "crowd" in stresses else []
        self._heard: list[Story] = []
        if "import" in stresses:
            self._heard = hearsay(design.subjects, self._stories, registry, seed)

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
        elif not arm.learns:
            self._lessons[key] = Lessons()
        else:
            own = (story for some in known.values() for story in some)
            self._lessons[key] = Lessons(stories=(*self._others, *self._heard, *own))
        return self._lessons[key]

    def _bank(self, unit: EpisodeUnit, name: str, known: Mapping[str, Sequence[Story]]) -> str:
        """The file of a bank that knows these lessons, taught unless another row of the arm has done so."""
        path = self._folder / f"{name}.db"
        if str(path) not in {lessons.bank for lessons in self._lessons.values()}:
            path.parent.mkdir(parents=True, exist_ok=True)
            arm, config = unit.arm, lived(self._design.config, self._registry)
            if self._others:
                arm = with_budget(arm, self._registry)
            with closing(open_memory(config, self._registry, arm, str(path))) as memory:
                teach(memory, self._others)
                hear(memory, self._heard if arm.source != "shuffled" else ())
                for some in known.values():
                    teach(memory, some)
        return str(path)
