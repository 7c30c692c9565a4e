"""The robot suite's tables: success with intervals, what memory adds, and how the rest failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import median
from textwrap import shorten

from gvla2.evaluation.paired import Pair, exact_mcnemar, holm, pooled_difference, won_and_lost
from gvla2.evaluation.results import Cell, grouped, latest
from gvla2.evaluation.robot.design import PAPER, PROFILES, ordered
from gvla2.evaluation.robot.planners import (
    TAUGHT,
    arm_of,
    arms_of,
    columns_of,
    planner_sheet,
    seed_rates,
    success_lines,
    unmeasured,
)
from gvla2.evaluation.sheets import NONE, Exhibit, Exhibits, Sheet, SheetCell, SheetRow, Tone, film, runs_of
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


_Episodes = Mapping[tuple[str, str], Mapping[tuple[str, ...], Cell]]
"""Cells of one profile by (task, arm), then by (seed, episode)."""


def robot_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """For each group its planners side by side, its success by profile, the differences between arms, the failures."""
    given = list(cells)
    order = list(grouped(given, *PLANNER))
    which = (*PLANNER, "task", "arm", "variant", "teacher", "profile", "seed", "episode")
    once = latest(given, lambda cell: cell.told(*HOUSE, *which))
    kept = sorted(once, key=lambda cell: (cell.told(*HOUSE), order.index(cell.told(*PLANNER))))
    return [sheet for found in grouped(kept, *HOUSE).values() for sheet in _of_house(found)]


def _of_house(cells: Sequence[Cell]) -> list[Sheet]:
    by_planner = grouped(cells, *PLANNER)
    tasks = ordered([str(cell.factors["task"]) for cell in cells])
    sheets: list[Sheet] = []
    asked = any(cell.measures.get("calls") or cell.measures.get("cached") for cell in cells)
    if len(by_planner) > 1 or asked:
        title = f"Robot ({_said(cells[0], HOUSE)})"
        columns = columns_of(cells)
        sheets += [
            planner_sheet(columns, tasks, profile, f"{title}: planners, {profile}", profile == "eased")
            for profile in PROFILES
        ]
        sheets.append(_failures(columns, tasks, f"{title}: failures"))
    for found in by_planner.values():
        own = ordered([str(cell.factors["task"]) for cell in found])
        sheets += _of_planner(found, own, bool(sheets))
    films = tuple(shown for cell in cells if (shown := _film(cell)) is not None)
    last = replace(sheets[-1], gallery=Exhibits("Failures to look at", "films", films) if films else None)
    runs = runs_of(cells)
    return [replace(sheet, runs=runs) for sheet in (*sheets[:-1], last)]


def _said(cell: Cell, names: Sequence[str]) -> str:
    return ", ".join(f"{name} {value}" for name in names if (value := str(cell.factors.get(name, ""))))


def _of_planner(cells: Sequence[Cell], tasks: Sequence[str], compared: bool) -> list[Sheet]:
    """Memory's effect for one planner; nothing if it is off and the planner was ``compared`` above."""
    arms = arms_of(cells)
    if compared and len(arms) == 1:
        return []
    title = f"Robot ({_said(cells[0], (*HOUSE, *PLANNER))})"
    by_profile = {profile: _episodes(cells, profile) for profile in PROFILES}
    sheets = [
        _success(found, tasks, arms, f"{title}: success, {profile}") for profile, found in by_profile.items()
    ]
    if len(arms) > 1:
        sheets.append(_effects(by_profile, tasks, arms, f"{title}: what memory adds"))
    if not compared:
        columns = {f"memory {arm}": [c for c in cells if arm_of(c) == arm] for arm in arms}
        sheets.append(_failures(columns, tasks, f"{title}: failures"))
    return sheets


def _episodes(cells: Sequence[Cell], profile: str) -> _Episodes:
    found: dict[tuple[str, str], dict[tuple[str, ...], Cell]] = {}
    for cell in cells:
        if cell.factors.get("profile") == profile and not unmeasured(cell):
            here = found.setdefault((str(cell.factors["task"]), arm_of(cell)), {})
            here[cell.told("seed", "episode")] = cell
    return found


def _success(found: _Episodes, tasks: Sequence[str], arms: Sequence[str], title: str) -> Sheet:
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
    counts = f"{episodes} episodes, {len(tasks)} tasks"
    return Sheet(title, headings, tuple(rows), counts, (), SUCCESS)


def _rate(cells: Mapping[tuple[str, ...], Cell], gain: int | None) -> SheetCell:
    if not cells:
        return NONE
    tone: Tone = "" if not gain else "better" if gain > 0 else "worse"
    return SheetCell(success_lines(list(cells.values())), tone=tone)


def _mean(found: _Episodes, tasks: Sequence[str], arm: str) -> SheetCell:
    rates = seed_rates([cell for task in tasks for cell in found.get((task, arm), {}).values()])
    if not rates:
        return NONE
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
    return Sheet(title, PROFILES, tuple(rows), f"{len(tasks)} tasks", (), EFFECT)


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


def _failures(columns: Mapping[str, Sequence[Cell]], tasks: Sequence[str], title: str) -> Sheet:
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
    return Sheet(title, tuple(columns), tuple(rows), f"{len(tasks)} tasks", (), FAILURES)


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
    f, notes = cell.factors, cell.notes
    who = f"{f.get('planner', '')}, {f['task']}, memory {arm_of(cell)}, layout {notes.get('layout')}"
    said = f"{who}: {notes.get('failure') or 'succeeded'}"
    why = shorten(str(notes.get("message", "")), LONGEST_REASON, placeholder=" …")
    return film(f"{said}. “{notes.get('instruction', '')}” {why}", folder)
