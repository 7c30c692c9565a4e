"""The robot suite's tables: success with intervals, what memory adds, and how the rest failed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from statistics import fmean, median
from textwrap import shorten

from gvla2.evaluation.paired import Pair, exact_mcnemar, holm, pooled_difference, won_and_lost
from gvla2.evaluation.results import Cell, grouped, latest
from gvla2.evaluation.robot.design import EPISODE, HOUSE, PAPER, PLANNER, PROFILES, ordered
from gvla2.evaluation.robot.planners import (
    TAUGHT,
    Columns,
    arms_of,
    columns_of,
    learnings,
    mean_lines,
    of_profile,
    planner_sheet,
    success_lines,
    unmeasured,
    with_arms,
)
from gvla2.evaluation.sheets import NONE, Exhibit, Exhibits, Sheet, SheetCell, SheetRow, Tone, film, runs_of
from gvla2.record.text import count

SURE = 0.05
"""An adjusted p below it is coloured."""
LONGEST_REASON = 200
"""Characters of a failure's message below its film; the run page has all of it."""

SUCCESS = (
    "Success in per cent over episodes with its 95 % Wilson interval; the mean over tasks ± standard deviation over "
    "seeds. Asterisk, coloured: the task differs from memory off (exact McNemar on paired episodes, Holm over tasks, "
    "p < .05). "
)
OF_WORLDS = (
    "Each seed is another world: a row pools the families of that number; intervals are over episodes. "
)
OF_PAPER = "The paper's rows are from another simulator: a level to exceed, not a like-for-like comparison."
EFFECT = (
    "Difference of success rates in points, mean over tasks [95 % bootstrap over tasks, then episodes]; episodes won : "
    "lost; exact McNemar p over all pairs; tasks that differ after Holm."
)
FAILURES = (
    "Episodes that missed the relaxed goal, by cause; agreement of the robot's own verifier with the success "
    "check where it said success or failure; median seconds of an episode. Not measured: the planner timed out or its "
    "language model was unavailable; such episodes are not counted and are measured again next time."
)


_Episodes = Mapping[tuple[str, ...], Sequence[Cell]]
"""The measured cells of one profile by (task, arm)."""


def robot_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """For each group its planners side by side, its success by profile, the differences between arms, the failures."""
    given = list(cells)
    order = list(grouped(given, *PLANNER))
    once = latest(given, lambda cell: cell.told(*HOUSE, *EPISODE))
    kept = sorted(once, key=lambda cell: (cell.told(*HOUSE), order.index(cell.told(*PLANNER))))
    return [sheet for found in grouped(kept, *HOUSE).values() for sheet in _of_house(with_arms(found))]


def _of_house(cells: Sequence[Cell]) -> list[Sheet]:
    by_planner = grouped(cells, *PLANNER)
    tasks = ordered([task for (task,) in grouped(cells, "task")])
    sheets: list[Sheet] = []
    asked = any(cell.measures.get("calls") or cell.measures.get("cached") for cell in cells)
    if len(by_planner) > 1 or asked:
        title = _title(cells, HOUSE)
        columns = columns_of(cells)
        sheets += [
            planner_sheet(columns, tasks, profile, f"{title}: planners, {profile}", profile == "relaxed")
            for profile in PROFILES
        ]
        sheets.append(_failures(columns, tasks, f"{title}: failures"))
    for found in by_planner.values():
        sheets += _of_planner(found, bool(sheets))
    films = tuple(shown for cell in cells if (shown := _film(cell)) is not None)
    last = replace(sheets[-1], gallery=Exhibits("Failures to look at", "films", films) if films else None)
    runs = runs_of(cells)
    return [replace(sheet, runs=runs) for sheet in (*sheets[:-1], last)]


def _title(cells: Sequence[Cell], names: Sequence[str]) -> str:
    """What all these cells share; how memory learns is among it unless the arms' names say so."""
    told = [f"{name} {value}" for name, value in zip(names, cells[0].told(*names), strict=True) if value]
    learning = learnings(cells)
    told += [f"memory with {learning.pop()}"] if len(learning) == 1 and learning != {""} else []
    return f"Robot ({', '.join(told)})"


def _of_planner(cells: Sequence[Cell], compared: bool) -> list[Sheet]:
    """Memory's effect for one planner; nothing if it is off and the planner was ``compared`` above."""
    arms, tasks = arms_of(cells), ordered([task for (task,) in grouped(cells, "task")])
    if compared and len(arms) == 1:
        return []
    title = _title(cells, (*HOUSE, *PLANNER))
    columns = {f"memory {arm}": grouped(cells, "arm")[arm,] for arm in arms}
    sound = grouped([cell for cell in cells if not unmeasured(cell)], "profile")
    by_profile = {profile: grouped(sound.get((profile,), []), "task", "arm") for profile in PROFILES}
    sheets = [
        _success(found, tasks, arms, f"{title}: success, {profile}") for profile, found in by_profile.items()
    ]
    if len(arms) > 1:
        sheets.append(_effects(by_profile, tasks, arms, f"{title}: what memory adds"))
    if not compared:
        sheets.append(_failures(columns, tasks, f"{title}: failures"))
    return sheets


def _success(found: _Episodes, tasks: Sequence[str], arms: Sequence[str], title: str) -> Sheet:
    sure = {arm: _different(_pairs(found, tasks, "off", arm)) for arm in arms}
    known = bool(PAPER.keys() & set(tasks))
    rows = []
    for task in tasks:
        rates = [_rate(found.get((task, arm), []), sure[arm].get(task, 0)) for arm in arms]
        rows.append(SheetRow(task, (*rates, *(_paper([task]) if known else ()))))
    means = (*(_mean(found, arm, tasks) for arm in arms), *(_paper(tasks) if known else ()))
    rows.append(SheetRow("mean over tasks", means))
    headings = (
        *(f"memory {arm}" for arm in arms),
        *(("paper, with memory", "paper, without") if known else ()),
    )
    counts = f"{count(sum(map(len, found.values())), 'episode')}, {count(len(tasks), 'task')}"
    told = SUCCESS + (
        OF_WORLDS if any(c.factors.get("world") for some in found.values() for c in some) else ""
    )
    return Sheet(title, headings, tuple(rows), counts, (), (told + (OF_PAPER if known else "")).strip())


def _rate(cells: Sequence[Cell], gain: int) -> SheetCell:
    if not cells:
        return NONE
    rate, interval = success_lines(cells)
    if not gain:
        return SheetCell((rate, interval))
    return SheetCell((f"{rate} *", interval), tone="better" if gain > 0 else "worse")


def _mean(found: _Episodes, arm: str, tasks: Sequence[str]) -> SheetCell:
    cells = [cell for (_, of), some in found.items() if of == arm for cell in some]
    return SheetCell(mean_lines(cells, tasks)) if cells else NONE


def _paper(tasks: Sequence[str]) -> list[SheetCell]:
    """The paper's means over these tasks, with memory and without; empty where it has none of them."""
    columns = zip(*(PAPER[task] for task in tasks if task in PAPER), strict=True)
    return [SheetCell((f"{fmean(column):.1f}",)) for column in columns] or [SheetCell(("",))] * 2


def _pairs(found: _Episodes, tasks: Sequence[str], first: str, second: str) -> dict[str, list[Pair]]:
    """By task the episodes that two arms share, if there are any."""
    by_task = {}
    for task in tasks:
        one, two = (
            {
                cell.told("seed", "episode"): bool(cell.measures["success"])
                for cell in found.get((task, arm), [])
            }
            for arm in (first, second)
        )
        by_task[task] = [(one[place], two[place]) for place in sorted(one.keys() & two.keys())]
    return {task: pairs for task, pairs in by_task.items() if pairs}


def _different(pairs: Mapping[str, Sequence[Pair]]) -> dict[str, int]:
    """Tasks in which the second arm differs significantly, and whether it gained (1) or lost (-1)."""
    adjusted = holm({task: exact_mcnemar(made) for task, made in pairs.items()})
    sure = [task for task, p in adjusted.items() if p < SURE]
    return {task: 1 if (wl := won_and_lost(pairs[task]))[0] > wl[1] else -1 for task in sure}


def _effects(
    by_profile: Mapping[str, _Episodes],
    tasks: Sequence[str],
    arms: Sequence[str],
    title: str,
) -> Sheet:
    against = [(arm, "off") for arm in arms if arm != "off" and "off" in arms]
    for arm in arms:
        taught = arm[arm.find(TAUGHT) :] if TAUGHT in arm else ""
        on = f"on{taught}"  # taught alike
        against += [(on, arm)] if arm not in (on, "off") and on in arms else []
    rows = []
    for second, first in against:
        cells = [_effect(_pairs(by_profile[profile], tasks, first, second)) for profile in PROFILES]
        rows.append(SheetRow(f"{second} against {first}", tuple(cells)))
    return Sheet(title, PROFILES, tuple(rows), count(len(tasks), "task"), (), EFFECT)


def _effect(by_task: Mapping[str, Sequence[Pair]]) -> SheetCell:
    if not by_task:
        return NONE
    change = pooled_difference(by_task)
    everything = [pair for pairs in by_task.values() for pair in pairs]
    won, lost = won_and_lost(everything)
    sure = _different(by_task)
    named = (
        ", ".join(f"{task} {'+' if way > 0 else '-'}" for task, way in sure.items()) or "no task by itself"
    )
    unsure = change.low <= 0 <= change.high or exact_mcnemar(everything) >= SURE
    tone: Tone = "" if unsure else "better" if change.points > 0 else "worse"
    return SheetCell(
        (
            f"{change.points:+.1f} points",
            f"[{change.low:+.1f}, {change.high:+.1f}]",
            f"{won} : {lost} of {len(everything)}, p {exact_mcnemar(everything):.3g}",
            named,
        ),
        tone=tone,
    )


def _failures(columns: Columns, tasks: Sequence[str], title: str) -> Sheet:
    found, sound = of_profile(columns, "relaxed")
    kinds = sorted({_failure(cell) for some in sound.values() for cell in some} - {""})
    rows = [_line(kind.replace("_", " "), partial(_failed, kind), sound) for kind in kinds]
    rows.append(_line("episodes", lambda some: str(len(some)), sound))
    if any(unmeasured(cell) for some in found.values() for cell in some):
        rows.append(_line("not measured", lambda some: str(sum(map(unmeasured, some))), found))
    rows += [_line("verifier agrees", _agreement, sound), _line("seconds, median", _median, sound)]
    return Sheet(title, tuple(columns), tuple(rows), count(len(tasks), "task"), (), FAILURES)


def _line(label: str, tell: Callable[[Sequence[Cell]], str], columns: Columns) -> SheetRow:
    return SheetRow(label, tuple(SheetCell((tell(some),)) for some in columns.values()))


def _failed(kind: str, cells: Sequence[Cell]) -> str:
    return str(sum(_failure(cell) == kind for cell in cells))


def _failure(cell: Cell) -> str:
    return str(cell.notes.get("failure", ""))


def _agreement(cells: Sequence[Cell]) -> str:
    sure = [c for c in cells if c.notes.get("verdict") in ("verified_success", "verified_fail")]
    same = sum((c.notes["verdict"] == "verified_success") == bool(c.measures["success"]) for c in sure)
    return f"{same} of {len(sure)}"


def _median(cells: Sequence[Cell]) -> str:
    spent = [float(c.measures["seconds"] or 0) for c in cells]
    return f"{median(spent):.1f}" if spent else ""


def _film(cell: Cell) -> Exhibit | None:
    folder = str(cell.notes.get("film", ""))
    if not folder:
        return None
    notes, (planner, task, arm) = cell.notes, cell.told("planner", "task", "arm")
    said = f"{planner}, {task}, memory {arm}, layout {notes.get('layout')}"
    why = shorten(str(notes.get("message", "")), LONGEST_REASON, placeholder=" …")
    other = " (when filmed it ended differently)" if notes.get("film_agrees") is False else ""
    caption = f"{said}: {_failure(cell) or 'succeeded'}{other}. “{notes.get('instruction', '')}” {why}"
    return film(caption, folder)
