"""The robot suite's tables: success with intervals and costs, what memory adds, and how the rest failed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from statistics import fmean, median

from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.statistics import (
    Pair,
    exact_mcnemar,
    holm,
    mean_and_deviation,
    pooled_difference,
    wilson_interval,
    won_and_lost,
)
from gvla2.evaluation.suites.robot_design import NAMED, PAPER, PROFILES, ordered
from gvla2.evaluation.tables import (
    NONE,
    Sheet,
    SheetCell,
    SheetRow,
    Tone,
    runs_of,
    text_cell,
)
from gvla2.record.text import count

HOUSE = (
    "robot",
    "perceiver",
    "parts",
    "branch",
    "verifier",
    "depth_noise",
    "scale",
    "world",
    "replan",
    "max_parts",
)
"""Factors that planners must share to be compared."""
PLANNER = ("planner", "model")
"""Further factors that the arms of a table share."""
EPISODE = (*PLANNER, "task", "arm", "variant", "teacher", "learning", "profile", "seed", "episode")
"""Factors that distinguish the episodes of a house."""
SURE = 0.05
"""An adjusted p below it is coloured."""

SUCCESS = (
    "Success in per cent over episodes with its 95 % Wilson interval; the mean over tasks ± standard deviation over "
    "seeds. Asterisk, coloured: the task differs from memory off (exact McNemar on paired episodes, Holm over tasks, "
    "p < .05). "
)
COSTS = (
    "Below a rate: an episode's median seconds of planning (checks and answers to rejected plans included), its mean "
    "number of calls to a language model, and the mean tokens of their prompts + answers as the server counted them. "
    "Answers from a cache cost neither tokens nor time and are listed separately; so are episodes in which the "
    "fallback planned. "
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

Columns = Mapping[str, Sequence[Cell]]
"""A table's columns by heading, each with its cells."""


def robot_sheets(cells: Iterable[Cell]) -> list[Sheet]:
    """For each group of comparable cells: success by profile, the differences between arms, the failures."""
    given = list(cells)
    order = list(grouped(given, *PLANNER))
    once = latest(given, lambda cell: cell.texts(*HOUSE, *EPISODE))
    kept = sorted(once, key=lambda cell: (cell.texts(*HOUSE), order.index(cell.texts(*PLANNER))))
    return [sheet for found in grouped(kept, *HOUSE).values() for sheet in _of_house(_with_arms(found))]


def _of_house(cells: Sequence[Cell]) -> list[Sheet]:
    tasks = ordered([task for (task,) in grouped(cells, "task")])
    columns = _columns(cells)
    title = _title(cells, HOUSE if len(grouped(cells, "planner")) > 1 else (*HOUSE, *PLANNER))
    sheets = [_success(columns, tasks, profile, f"{title}: success, {profile}") for profile in PROFILES]
    for found in grouped(cells, *PLANNER).values():
        if len(_arms(found)) > 1:
            sheets.append(_effects(found, tasks, f"{_title(found, (*HOUSE, *PLANNER))}: what memory adds"))
    sheets.append(_failures(columns, tasks, f"{title}: failures"))
    return [replace(sheet, runs=runs_of(cells)) for sheet in sheets]


def _with_arms(cells: Sequence[Cell]) -> list[Cell]:
    """The cells with their arms' names in tables: with a variant's options, the exploring planner if
    another, and how it learns where cells differ.
    """
    several = len(_learnings(cells)) > 1
    named = []
    for cell in cells:
        arm, variant, teacher, learning = cell.texts("arm", "variant", "teacher", "learning")
        taught = f"taught by {teacher}" if teacher else ""
        options = ", ".join(one for one in (variant, taught, learning if several else "") if one)
        name = f"{arm} ({options})" if options else arm
        named.append(replace(cell, factors={**cell.factors, "arm": name}))
    return named


def _learnings(cells: Sequence[Cell]) -> set[str]:
    """How memory learns in these cells, "" for as usual; arms without lessons are left out."""
    return {str(cell.factors["learning"]) for cell in cells if "learning" in cell.factors}


def _title(cells: Sequence[Cell], names: Sequence[str]) -> str:
    """What all these cells share; how memory learns is among it unless the arms' names say so."""
    shared = [f"{name} {value}" for name, value in zip(names, cells[0].texts(*names), strict=True) if value]
    learning = _learnings(cells)
    shared += [f"memory with {learning.pop()}"] if len(learning) == 1 and learning != {""} else []
    return f"Robot ({', '.join(shared)})"


def _arms(cells: Sequence[Cell]) -> list[str]:
    """The arms of these cells, ``off`` and ``on`` first."""
    present = {arm for (arm,) in grouped(cells, "arm")}
    return sorted(present, key=lambda arm: (arm != "off", arm != "on", arm))


def _columns(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """The cells by planner if there are several, its language model likewise, and arm if any is not ``off``."""
    models = {planner: grouped(some, "model") for (planner,), some in grouped(cells, "planner").items()}
    arms, order = _arms(cells), list(models)
    found = grouped(cells, "planner", "arm", "model")
    columns = {}
    for planner, arm, model in sorted(found, key=lambda place: (order.index(place[0]), arms.index(place[1]))):
        asked = f" by {model}" if model and len(models[planner]) > 1 else ""
        memory = f"memory {arm}" if arms != ["off"] or len(models) == 1 else ""
        named = f"{planner}{asked}" if len(models) > 1 or asked else ""
        columns[", ".join(filter(None, (named, memory)))] = found[planner, arm, model]
    return columns


def _counts(cell: Cell) -> bool:
    """Whether the episode was measured: its planner did not time out, and its model was available."""
    return cell.measures.get("success") is not None


def _of_profile(columns: Columns, profile: str) -> tuple[Columns, Columns]:
    """The columns' cells of a profile, and the measured ones of these."""
    found = {name: [c for c in some if c.factors.get("profile") == profile] for name, some in columns.items()}
    return found, {name: list(filter(_counts, some)) for name, some in found.items()}


def _success(columns: Columns, tasks: Sequence[str], profile: str, title: str) -> Sheet:
    """Tasks down, planners and arms across, a row of means, then the cost of an episode where a model was asked."""
    found, sound = _of_profile(columns, profile)
    cells = [cell for some in sound.values() for cell in some]
    asked = any(cell.measures.get("calls") or cell.measures.get("cached") for cell in cells)
    costs = profile == PROFILES[0] and (asked or len(grouped(cells, "planner")) > 1)
    known = len(grouped(cells, *PLANNER)) == 1 and bool(PAPER.keys() & set(tasks))
    paper = _paper if known else lambda tasks: []
    sure = {name: _different(_pairs(_off_of(some, sound), some)) for name, some in sound.items()}
    rows = []
    for task in tasks:
        of_task = {
            name: [cell for cell in some if cell.texts("task") == (task,)] for name, some in found.items()
        }
        rates = [_rate(some, sure[name].get(task, 0), costs) for name, some in of_task.items()]
        rows.append(SheetRow(task, (*rates, *paper([task]))))
    means = (SheetCell(_mean_lines(some, tasks)) if some else NONE for some in sound.values())
    rows.append(SheetRow("mean over tasks", (*means, *paper(tasks))))
    lines: dict[str, Callable[[Sequence[Cell]], str]] = {}
    if costs:
        lines["planning seconds, median"] = lambda some: _seconds(some).removesuffix(" s")
        lines["calls an episode"] = lambda some: f"{_average(some, 'calls') or 0:.1f}"
        lines["prompt + answer tokens an episode"] = lambda some: _tokens(some).removesuffix(" tokens")
        if _cached(cells):
            lines["answers from the cache"] = lambda some: f"{_cached(some):.0f}"
    if _fallbacks(cells):
        lines["episodes with the fallback"] = lambda some: f"{_fallbacks(some)} of {len(some)}"
    lines["episodes"] = lambda some: str(len(some))
    blank = paper([]) and [text_cell(""), text_cell("")]
    rows += [
        replace(row, cells=(*row.cells, *blank)) for row in (_line(*line, sound) for line in lines.items())
    ]
    models = sorted({model for (model,) in grouped(cells, "model")} - {""})
    counts = f"{count(len(cells), 'episode')}, {count(len(tasks), 'task')}"
    counts += f"; language model {', '.join(models)}" if models else ""
    worlds = any(cell.factors.get("world") for cell in cells)
    explained = (
        SUCCESS + (COSTS if costs else "") + (OF_WORLDS if worlds else "") + (OF_PAPER if known else "")
    )
    headings = (*columns, *(("paper, with memory", "paper, without") if known else ()))
    return Sheet(title, headings, tuple(rows), counts, (), explained.strip())


def _off_of(cells: Sequence[Cell], columns: Columns) -> list[Cell]:
    """The cells with memory off of the same planner and model as these."""
    same = cells[0].texts(*PLANNER) if cells else ()
    everything = (cell for some in columns.values() for cell in some)
    return [cell for cell in everything if cell.texts("arm") == ("off",) and cell.texts(*PLANNER) == same]


def _rate(cells: Sequence[Cell], sure: int, costs: bool) -> SheetCell:
    """The rate in per cent, its interval with the counts, and what an episode cost."""
    sound = list(filter(_counts, cells))
    gaps = f"{len(cells) - len(sound)} not measured" if len(sound) < len(cells) else ""
    if not sound:
        return SheetCell((gaps,), none=True) if gaps else NONE
    won = sum(bool(cell.measures["success"]) for cell in sound)
    low, high = wilson_interval(won, len(sound))
    lines = [
        f"{100 * won / len(sound):.1f}{' *' if sure else ''}",
        f"[{100 * low:.0f}, {100 * high:.0f}] {won}/{len(sound)}",
    ]
    if costs:
        lines.append(_seconds(sound))
        if calls := _average(sound, "calls"):
            lines += [f"{calls:.1f} {'call' if calls == 1 else 'calls'}", _tokens(sound)]
        lines += [f"{_cached(sound):.0f} from the cache"] if _cached(sound) else []
        lines += [f"fallback in {_fallbacks(sound)}"] if _fallbacks(sound) else []
    tone: Tone = "" if not sure else "better" if sure > 0 else "worse"
    return SheetCell(tuple(line for line in (*lines, gaps) if line), tone=tone)


def _mean_lines(cells: Sequence[Cell], tasks: Sequence[str]) -> tuple[str, str]:
    """The mean over tasks of their rates in per cent, and over what it is.

    With the standard deviation over seeds if there are several, each with the same episodes of every task.
    """
    by_task = grouped(cells, "task")
    rates = [fmean(measured(some, "success")) for some in by_task.values()]
    mean, by_seed = 100 * fmean(rates), grouped(cells, "seed")
    reached = f"{sum(rate > 0 for rate in rates)} of {len(rates)} tasks above 0"
    lacking = f"{len(rates)} of {len(tasks)} tasks, " if len(rates) < len(tasks) else ""
    over, episodes = f"{lacking}{count(len(by_seed), 'seed')}", {
        tuple(sorted(cell.texts("task", "episode") for cell in some)) for some in by_seed.values()
    }  # fmt: skip
    if (NAMED,) in by_seed:
        over = f"{lacking}named layouts"
    elif len(episodes) > 1:
        over += ", not all complete"
    elif len(by_seed) > 1:
        of_seeds = [
            100 * fmean(fmean(measured(of_task, "success")) for of_task in grouped(some, "task").values())
            for some in by_seed.values()
        ]
        return f"{mean:.1f} ± {mean_and_deviation(of_seeds)[1]:.1f}", f"{over}; {reached}"
    return f"{mean:.1f}", f"{over}; {reached}"


def _paper(tasks: Sequence[str]) -> list[SheetCell]:
    """The paper's means over these tasks, with memory and without; empty where it has none of them."""
    columns = zip(*(PAPER[task] for task in tasks if task in PAPER), strict=True)
    return [text_cell(f"{fmean(column):.1f}") for column in columns] or [text_cell("")] * 2


def _pairs(first: Sequence[Cell], second: Sequence[Cell]) -> dict[str, list[Pair]]:
    """By task the episodes that two arms share, if there are any."""
    one, two = (
        {cell.texts("task", "seed", "episode"): bool(cell.measures["success"]) for cell in arm}
        for arm in (first, second)
    )
    by_task: dict[str, list[Pair]] = {}
    for place in sorted(one.keys() & two.keys()):
        by_task.setdefault(place[0], []).append((one[place], two[place]))
    return by_task


def _different(pairs: Mapping[str, Sequence[Pair]]) -> dict[str, int]:
    """Tasks in which the second arm differs significantly, and whether it gained (1) or lost (-1)."""
    adjusted = holm({task: exact_mcnemar(made) for task, made in pairs.items()})
    sure = [task for task, p in adjusted.items() if p < SURE]
    return {task: 1 if (wl := won_and_lost(pairs[task]))[0] > wl[1] else -1 for task in sure}


def _effects(cells: Sequence[Cell], tasks: Sequence[str], title: str) -> Sheet:
    """Every arm against memory off, and memory on against every other."""
    arms = _arms(cells)
    against = [(arm, "off") for arm in arms if arm != "off" and "off" in arms]
    on = next((arm for arm in arms if arm == "on" or arm.startswith("on (taught by ")), "")
    against += [(on, arm) for arm in arms if on and arm not in (on, "off")]
    by_arm = grouped(filter(_counts, cells), "arm", "profile")
    rows = []
    for second, first in against:
        pairs = (_pairs(by_arm.get((first, p), []), by_arm.get((second, p), [])) for p in PROFILES)
        rows.append(SheetRow(f"{second} against {first}", tuple(map(_effect, pairs))))
    return Sheet(title, PROFILES, tuple(rows), count(len(tasks), "task"), (), EFFECT)


def _effect(by_task: Mapping[str, Sequence[Pair]]) -> SheetCell:
    if not by_task:
        return NONE
    change = pooled_difference(by_task)
    everything = [pair for pairs in by_task.values() for pair in pairs]
    (won, lost), p, sure = won_and_lost(everything), exact_mcnemar(everything), _different(by_task)
    named = (
        ", ".join(f"{task} {'+' if way > 0 else '-'}" for task, way in sure.items()) or "no task by itself"
    )
    unsure = change.low <= 0 <= change.high or p >= SURE
    tone: Tone = "" if unsure else "better" if change.value > 0 else "worse"
    lines = (
        f"{change.value:+.1f} points",
        f"[{change.low:+.1f}, {change.high:+.1f}]",
        f"{won} : {lost} of {len(everything)}, p {p:.3g}",
        named,
    )
    return SheetCell(lines, tone=tone)


def _failures(columns: Columns, tasks: Sequence[str], title: str) -> Sheet:
    found, sound = _of_profile(columns, PROFILES[0])
    kinds = sorted({_failure(cell) for some in sound.values() for cell in some} - {""})
    rows = [_line(kind.replace("_", " "), partial(_failed, kind), sound) for kind in kinds]
    rows.append(_line("episodes", lambda some: str(len(some)), sound))
    if not all(map(_counts, (cell for some in found.values() for cell in some))):
        rows.append(_line("not measured", lambda some: str(sum(not _counts(cell) for cell in some)), found))
    rows += [_line("verifier agrees", _agreement, sound), _line("seconds, median", _median, sound)]
    return Sheet(title, tuple(columns), tuple(rows), count(len(tasks), "task"), (), FAILURES)


def _line(label: str, text: Callable[[Sequence[Cell]], str], columns: Columns) -> SheetRow:
    return SheetRow(label, tuple(text_cell(text(some) if some else "") for some in columns.values()))


def _failed(kind: str, cells: Sequence[Cell]) -> str:
    return str(sum(_failure(cell) == kind for cell in cells))


def _failure(cell: Cell) -> str:
    return str(cell.notes.get("failure", ""))


def _agreement(cells: Sequence[Cell]) -> str:
    sure = [c for c in cells if c.notes.get("verdict") in ("verified_success", "verified_fail")]
    same = sum((c.notes["verdict"] == "verified_success") == bool(c.measures["success"]) for c in sure)
    return f"{same} of {len(sure)}"


def _median(cells: Sequence[Cell]) -> str:
    return f"{median(float(cell.measures['seconds'] or 0) for cell in cells):.1f}"


def _seconds(cells: Sequence[Cell]) -> str:
    spent = measured(cells, "planning_seconds")
    return f"{median(spent):.1f} s" if spent else ""


def _average(cells: Sequence[Cell], measure: str) -> float | None:
    found = measured(cells, measure)
    return fmean(found) if found else None


def _tokens(cells: Sequence[Cell]) -> str:
    prompt, answer = _average(cells, "prompt_tokens"), _average(cells, "completion_tokens")
    return "not counted" if prompt is None or answer is None else f"{prompt:.0f} + {answer:.0f} tokens"


def _cached(cells: Sequence[Cell]) -> float:
    return sum(measured(cells, "cached"))


def _fallbacks(cells: Sequence[Cell]) -> int:
    return sum(bool(cell.notes.get("fallback")) for cell in cells)
