"""The robot suite's tables: success with intervals, what memory adds, and how the rest failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from statistics import median
from textwrap import shorten

from gvla2.evaluation.paired import Pair, exact_mcnemar, holm, pooled_difference, won_and_lost
from gvla2.evaluation.results import Cell
from gvla2.evaluation.robot.design import PAPER, PROFILES, SUITE, ordered
from gvla2.evaluation.robot.planners import (
    NONE,
    TAUGHT,
    arm_of,
    arms_of,
    columns_of,
    planner_sheet,
    success_lines,
    unmeasured,
)
from gvla2.evaluation.sheets import Sheet, SheetCell, SheetRow, Tone
from gvla2.evaluation.statistics import mean_and_deviation

HOUSE = ("robot", "perceiver", "verifier", "depth_noise", "scale", "world", "replan")
"""Factors that planners must share to be compared."""
PLANNER = ("planner", "model")
"""Further factors that the arms of a table share."""
SURE = 0.05
"""An adjusted p below it is coloured."""
LONGEST_REASON = 200
"""Characters of a failure's message below its film; the run page has all of it."""

SUCCESS = (
    "Success in per cent over episodes with its 95 % Wilson interval; the mean over tasks ± standard deviation over "
    "seeds. Coloured: the task differs from memory off (exact McNemar on paired episodes, Holm over tasks, p < .05). "
    "The paper's rows are from another simulator: a level to exceed, not a like-for-like comparison."
)
EFFECT = (
    "Difference of success rates in points, mean over tasks [95 % bootstrap over tasks, then episodes]; episodes won : "
    "lost; exact McNemar p over all pairs; tasks that differ after Holm."
)
FAILURES = (
    "Episodes that missed the eased goal, by cause; agreement of the robot's own verifier with the "
    "referee where it said success or failure; median seconds of an episode. Not measured: the planner timed out or "
    "its language model was unavailable; such episodes are not counted and are measured again next time."
)


@dataclass(frozen=True)
class RobotLayout:
    """The suite's name and title."""

    suite: str
    title: str


@dataclass(frozen=True)
class Film:
    """A filmed episode: its caption, and the folder of its run page."""

    caption: str
    folder: str


@dataclass(frozen=True)
class RobotTable:
    """One finished sheet, the runs behind it, and films of pairs that differ and of failures."""

    layout: RobotLayout
    sheet: Sheet
    runs: tuple[int, ...]
    films: tuple[Film, ...] = ()

    @property
    def title(self) -> str:
        """The sheet's."""
        return self.sheet.title


ROBOT = RobotLayout(SUITE, "Robot")

_Episodes = Mapping[tuple[str, str], Mapping[tuple[str, str], Cell]]
"""Cells of one profile by (task, arm), then by (seed, episode)."""


def make_robot_tables(cells: Iterable[Cell], layout: RobotLayout) -> list[RobotTable]:
    """For each group its planners side by side, its success by profile, the differences between arms, the failures."""
    given = list(cells)
    order = {_of(cell, PLANNER): place for place, cell in reversed(list(enumerate(given)))}
    latest: dict[tuple[str, ...], Cell] = {}
    for cell in sorted(given, key=lambda cell: cell.run):
        which = (*PLANNER, "task", "arm", "variant", "teacher", "profile", "seed", "episode")
        latest[_of(cell, HOUSE) + _of(cell, which)] = cell
    tables = []
    kept = sorted(latest.values(), key=lambda cell: (_of(cell, HOUSE), order[_of(cell, PLANNER)]))
    for _, found in groupby(kept, key=lambda cell: _of(cell, HOUSE)):
        tables += _of_house(list(found), layout)
    return tables


def _of(cell: Cell, names: Sequence[str]) -> tuple[str, ...]:
    return tuple(str(cell.factors.get(name, "")) for name in names)


def _of_house(cells: Sequence[Cell], layout: RobotLayout) -> list[RobotTable]:
    by_planner = {which: list(some) for which, some in groupby(cells, key=lambda cell: _of(cell, PLANNER))}
    runs = tuple(sorted({cell.run for cell in cells}))
    tasks = ordered([str(cell.factors["task"]) for cell in cells])
    sheets: list[Sheet] = []
    if len(by_planner) > 1 or any(
        cell.measures.get("calls") or cell.measures.get("cached") for cell in cells
    ):
        title = f"{layout.title} ({_said(cells[0], HOUSE)})"
        columns = columns_of(cells)
        sheets += [
            planner_sheet(columns, tasks, profile, f"{title}: planners, {profile}", runs, profile == "eased")
            for profile in PROFILES
        ]
        sheets.append(_failures(columns, tasks, f"{title}: failures", runs))
    for found in by_planner.values():
        own = ordered([str(cell.factors["task"]) for cell in found])
        sheets += _of_planner(found, own, layout, runs, bool(sheets))
    films = tuple(film for cell in cells if (film := _film(cell)) is not None)
    return [
        RobotTable(layout, sheet, runs, films if place == len(sheets) - 1 else ())
        for place, sheet in enumerate(sheets)
    ]


def _said(cell: Cell, names: Sequence[str]) -> str:
    return ", ".join(f"{name} {value}" for name in names if (value := str(cell.factors.get(name, ""))))


def _of_planner(
    cells: Sequence[Cell], tasks: Sequence[str], layout: RobotLayout, runs: tuple[int, ...], compared: bool
) -> list[Sheet]:
    """Memory's effect for one planner; nothing if it is off and the planner was ``compared`` above."""
    arms = arms_of(cells)
    if compared and len(arms) == 1:
        return []
    title = f"{layout.title} ({_said(cells[0], (*HOUSE, *PLANNER))})"
    by_profile = {profile: _episodes(cells, profile) for profile in PROFILES}
    sheets = [
        _success(found, tasks, arms, f"{title}: success, {profile}", runs)
        for profile, found in by_profile.items()
    ]
    if len(arms) > 1:
        sheets.append(_effects(by_profile, tasks, arms, f"{title}: what memory adds", runs))
    if not compared:
        columns = {f"memory {arm}": [c for c in cells if arm_of(c) == arm] for arm in arms}
        sheets.append(_failures(columns, tasks, f"{title}: failures", runs))
    return sheets


def _episodes(cells: Sequence[Cell], profile: str) -> _Episodes:
    found: dict[tuple[str, str], dict[tuple[str, str], Cell]] = {}
    for cell in cells:
        f = cell.factors
        if f.get("profile") == profile and not unmeasured(cell):
            place = str(f["task"]), arm_of(cell)
            found.setdefault(place, {})[str(f["seed"]), str(f["episode"])] = cell
    return found


def _success(
    found: _Episodes, tasks: Sequence[str], arms: Sequence[str], title: str, runs: tuple[int, ...]
) -> Sheet:
    sure = {arm: _different(found, tasks, "off", arm) for arm in arms}
    rows = []
    for task in tasks:
        line = [_rate(found.get((task, arm), {}), sure[arm].get(task)) for arm in arms]
        paper = PAPER.get(task)
        rows.append(
            SheetRow(task, (*line, *(SheetCell((f"{v:.1f}",) if paper else ("",)) for v in paper or (0, 0))))
        )
    mean = [_mean(found, tasks, arm) for arm in arms]
    shown = [PAPER[task] for task in tasks if task in PAPER]
    papers = [sum(column) / len(shown) for column in zip(*shown, strict=True)] if shown else []
    means = [SheetCell((f"{value:.1f}",)) for value in papers] or [SheetCell(("",))] * 2
    rows.append(SheetRow("mean over tasks", (*mean, *means)))
    headings = (*(f"memory {arm}" for arm in arms), "paper, with memory", "paper, without")
    episodes = sum(len(cells) for cells in found.values())
    footnote = (
        f"{episodes} episodes, {len(tasks)} tasks; runs {', '.join(map(str, runs))} of the results database."
    )
    return Sheet(title, headings, tuple(rows), footnote, SUCCESS)


def _rate(cells: Mapping[tuple[str, str], Cell], gain: int | None) -> SheetCell:
    if not cells:
        return NONE
    tone: Tone = "" if not gain else "better" if gain > 0 else "worse"
    return SheetCell(success_lines(list(cells.values())), tone=tone)


def _mean(found: _Episodes, tasks: Sequence[str], arm: str) -> SheetCell:
    by_seed: dict[str, dict[str, list[bool]]] = {}
    for task in tasks:
        for (seed, _), cell in found.get((task, arm), {}).items():
            by_seed.setdefault(seed, {}).setdefault(task, []).append(bool(cell.measures["success"]))
    if not by_seed:
        return NONE
    rates = [
        sum(100 * sum(won) / len(won) for won in tasks_.values()) / len(tasks_) for tasks_ in by_seed.values()
    ]
    mean, deviation = mean_and_deviation(rates)
    return SheetCell((f"{mean:.1f} ± {deviation:.1f}", f"{len(rates)} seeds"))


def _pairs(found: _Episodes, task: str, first: str, second: str) -> list[Pair]:
    one, two = found.get((task, first), {}), found.get((task, second), {})
    return [
        (bool(one[place].measures["success"]), bool(two[place].measures["success"]))
        for place in sorted(one.keys() & two.keys())
    ]


def _different(found: _Episodes, tasks: Sequence[str], first: str, second: str) -> dict[str, int]:
    """Tasks in which the second arm differs significantly, and whether it gained (1) or lost (-1)."""
    if first == second:
        return {}
    pairs = {task: made for task in tasks if (made := _pairs(found, task, first, second))}
    adjusted = holm({task: exact_mcnemar(made) for task, made in pairs.items()})
    sure = [task for task, p in adjusted.items() if p < SURE]
    return {task: 1 if (wl := won_and_lost(pairs[task]))[0] > wl[1] else -1 for task in sure}


def _effects(
    by_profile: Mapping[str, _Episodes],
    tasks: Sequence[str],
    arms: Sequence[str],
    title: str,
    runs: tuple[int, ...],
) -> Sheet:
    against = [(arm, "off") for arm in arms if arm != "off" and "off" in arms]
    for arm in arms:
        taught = arm[arm.find(TAUGHT) :] if TAUGHT in arm else ""
        on = f"on{taught}"  # taught alike
        against += [(on, arm)] if arm not in (on, "off") and on in arms else []
    rows = []
    for second, first in against:
        cells = [_effect(by_profile[profile], tasks, first, second) for profile in PROFILES]
        rows.append(SheetRow(f"{second} against {first}", tuple(cells)))
    footnote = f"{len(tasks)} tasks; runs {', '.join(map(str, runs))} of the results database."
    return Sheet(title, PROFILES, tuple(rows), footnote, EFFECT)


def _effect(found: _Episodes, tasks: Sequence[str], first: str, second: str) -> SheetCell:
    by_task = {task: made for task in tasks if (made := _pairs(found, task, first, second))}
    if not by_task:
        return NONE
    change = pooled_difference(by_task)
    everything = [pair for pairs in by_task.values() for pair in pairs]
    won, lost = won_and_lost(everything)
    sure = _different(found, tasks, first, second)
    named = ", ".join(f"{task} {'+' if way > 0 else '-'}" for task, way in sure.items()) or "no task for sure"
    tone: Tone = "" if change.low <= 0 <= change.high else "better" if change.points > 0 else "worse"
    return SheetCell(
        (
            f"{change.points:+.1f} points",
            f"[{change.low:+.1f}, {change.high:+.1f}]",
            f"{won} : {lost} of {len(everything)}, p {exact_mcnemar(everything):.3g}",
            named,
        ),
        tone=tone,
    )


def _failures(
    columns: Mapping[str, Sequence[Cell]], tasks: Sequence[str], title: str, runs: tuple[int, ...]
) -> Sheet:
    eased = {name: [c for c in some if c.factors.get("profile") == "eased"] for name, some in columns.items()}
    gaps = {name: sum(unmeasured(cell) for cell in some) for name, some in eased.items()}
    sound = {name: [cell for cell in some if not unmeasured(cell)] for name, some in eased.items()}
    counts = {name: Counter(str(c.notes.get("failure", "")) for c in some) for name, some in sound.items()}
    rows: list[SheetRow] = []

    def add(label: str, tell: Callable[[str], str]) -> None:
        rows.append(SheetRow(label, tuple(SheetCell((tell(name),)) for name in columns)))

    for kind in sorted({kind for counted in counts.values() for kind in counted if kind}):
        add(kind.replace("_", " "), lambda name, kind=kind: str(counts[name][kind]))  # type: ignore[misc]
    add("episodes", lambda name: str(len(sound[name])))
    if any(gaps.values()):
        add("not measured", lambda name: str(gaps[name]))
    add("verifier agrees", lambda name: _agreement(sound[name]))
    add("seconds, median", lambda name: _median(sound[name]))
    footnote = f"{len(tasks)} tasks; runs {', '.join(map(str, runs))} of the results database."
    return Sheet(title, tuple(columns), tuple(rows), footnote, FAILURES)


def _agreement(cells: Sequence[Cell]) -> str:
    sure = [c for c in cells if c.notes.get("verdict") in ("verified_success", "verified_fail")]
    same = sum((c.notes["verdict"] == "verified_success") == bool(c.measures["success"]) for c in sure)
    return f"{same} of {len(sure)}"


def _median(cells: Sequence[Cell]) -> str:
    spent = [float(c.measures["seconds"] or 0) for c in cells]
    return f"{median(spent):.1f}" if spent else ""


def _film(cell: Cell) -> Film | None:
    folder = str(cell.notes.get("film", ""))
    if not folder:
        return None
    f, notes = cell.factors, cell.notes
    who = f"{f.get('planner', '')}, {f['task']}, memory {arm_of(cell)}, layout {notes.get('layout')}"
    said = f"{who}: {notes.get('failure') or 'succeeded'}"
    why = shorten(str(notes.get("message", "")), LONGEST_REASON, placeholder=" …")
    return Film(f"{said}. “{notes.get('instruction', '')}” {why}", folder)
