"""Planners side by side: success by task, and cost in seconds and tokens."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean, median

from gvla2.evaluation.results import Cell, grouped, measured
from gvla2.evaluation.robot.design import NAMED
from gvla2.evaluation.sheets import NONE, Sheet, SheetCell, SheetRow
from gvla2.evaluation.statistics import mean_and_deviation, wilson_interval
from gvla2.record.text import count

FIRST = ("off", "on")
TAUGHT = " (taught by "
"""Precedes the planner whose exploration an arm learnt from, if it is a different one."""

PLANNERS = (
    "Success in per cent over episodes with its 95 % Wilson interval; below it an episode's median seconds of planning "
    "(checks and answers to rejected plans included), its mean number of calls to a language model, and the mean "
    "tokens of their prompts + answers as the server counted them. The mean is over tasks. Answers from a cache cost "
    "neither tokens nor time and are listed separately; so are episodes in which the fallback planned."
)

Columns = Mapping[str, Sequence[Cell]]
"""A table's columns by heading, each with its cells."""


def unmeasured(cell: Cell) -> bool:
    """Whether the episode does not count for its arm: the planner timed out, or its model was unavailable."""
    return cell.measures.get("success") is None


def learnings(cells: Sequence[Cell]) -> set[str]:
    """How memory learns in these cells, "" for as usual; arms without lessons are left out."""
    return {str(cell.factors["learning"]) for cell in cells if "learning" in cell.factors}


def with_arms(cells: Sequence[Cell]) -> list[Cell]:
    """The cells with their arms' names in tables: with a variant's options, how it learns where cells differ in that,
    and the exploring planner if another.
    """
    several = len(learnings(cells)) > 1
    named = []
    for cell in cells:
        arm, variant, learning, teacher = cell.told("arm", "variant", "learning", "teacher")
        told = ", ".join(one for one in (variant, learning if several else "") if one)
        name = f"{arm} ({told})" if told else arm
        named.append(
            replace(cell, factors={**cell.factors, "arm": f"{name}{TAUGHT}{teacher})" if teacher else name})
        )
    return named


def arms_of(cells: Sequence[Cell]) -> list[str]:
    """The arms of these cells, ``off`` and ``on`` first."""
    present = {arm for (arm,) in grouped(cells, "arm")}
    return [arm for arm in FIRST if arm in present] + sorted(present - set(FIRST))


def success_lines(cells: Sequence[Cell]) -> tuple[str, str]:
    """The rate in per cent, and its interval with the counts."""
    won = sum(bool(cell.measures["success"]) for cell in cells)
    low, high = wilson_interval(won, len(cells))
    return f"{100 * won / len(cells):.1f}", f"[{100 * low:.0f}, {100 * high:.0f}] {won}/{len(cells)}"


def columns_of(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """The cells by planner, its language model if there are several, and arm if any is not ``off``."""
    models = {planner: grouped(some, "model") for (planner,), some in grouped(cells, "planner").items()}
    arms, order = arms_of(cells), list(models)
    found = grouped(cells, "planner", "arm", "model")
    columns = {}
    for planner, arm, model in sorted(found, key=lambda place: (order.index(place[0]), arms.index(place[1]))):
        asked = f" by {model}" if model and len(models[planner]) > 1 else ""
        memory = f", memory {arm}" if arms != ["off"] else ""
        columns[f"{planner}{asked}{memory}"] = found[planner, arm, model]
    return columns


def of_profile(columns: Columns, profile: str) -> tuple[Columns, Columns]:
    """The columns' cells of a profile, and the measured ones of these."""
    found = {name: [c for c in some if c.factors.get("profile") == profile] for name, some in columns.items()}
    return found, {name: [cell for cell in some if not unmeasured(cell)] for name, some in found.items()}


def planner_sheet(
    columns: Columns, tasks: Sequence[str], profile: str, title: str, costs: bool = True
) -> Sheet:
    """Tasks down, planners across, a row of means, then, with ``costs``, the cost per episode."""
    found, sound = of_profile(columns, profile)
    by_task = [grouped(some, "task") for some in found.values()]
    rows = [SheetRow(task, tuple(_cell(some.get((task,), []), costs) for some in by_task)) for task in tasks]
    rows.append(SheetRow("mean over tasks", tuple(_mean(some, tasks) for some in sound.values())))
    everything = [cell for some in sound.values() for cell in some]
    told: dict[str, Callable[[Sequence[Cell]], str]] = {}
    if costs:
        told["planning seconds, median"] = lambda some: _seconds(some).removesuffix(" s")
        told["calls an episode"] = lambda some: f"{_average(some, 'calls') or 0:.1f}"
        told["prompt + answer tokens an episode"] = lambda some: _tokens(some).removesuffix(" tokens")
    if costs and _cached(everything):
        told["answers from the cache"] = lambda some: f"{_cached(some):.0f}"
    if _fallbacks(everything):
        told["episodes with the fallback"] = lambda some: f"{_fallbacks(some)} of {len(some)}"
    told["episodes"] = lambda some: str(len(some))
    for label, tell in told.items():
        cells = (SheetCell((tell(some) if some else "",)) for some in sound.values())
        rows.append(SheetRow(label, tuple(cells)))
    models = sorted({model for (model,) in grouped(everything, "model")} - {""})
    asked = f"; language model {', '.join(models)}" if models else ""
    return Sheet(title, tuple(columns), tuple(rows), f"{count(len(tasks), 'task')}{asked}", (), PLANNERS)


def _cell(cells: Sequence[Cell], costs: bool) -> SheetCell:
    sound = [cell for cell in cells if not unmeasured(cell)]
    gaps = f"{len(cells) - len(sound)} not measured" if len(sound) < len(cells) else ""
    if not sound:
        return SheetCell((gaps,), none=True) if gaps else NONE
    lines = [*success_lines(sound), *(_costs(sound) if costs else ()), gaps]
    return SheetCell(tuple(line for line in lines if line))


def _costs(cells: Sequence[Cell]) -> list[str]:
    lines = [_seconds(cells)]
    if calls := _average(cells, "calls"):
        lines += [f"{calls:.1f} {'call' if calls == 1 else 'calls'}", _tokens(cells)]
    lines += [f"{_cached(cells):.0f} from the cache"] if _cached(cells) else []
    return lines + ([f"fallback in {_fallbacks(cells)}"] if _fallbacks(cells) else [])


def _mean(cells: Sequence[Cell], tasks: Sequence[str]) -> SheetCell:
    """The mean over tasks, its deviation over seeds if there are several, and how many tasks ever succeed."""
    if not cells:
        return NONE
    by_task = [some for (task,), some in grouped(cells, "task").items() if task in tasks]
    reached = sum(any(cell.measures["success"] for cell in some) for some in by_task)
    return SheetCell((*mean_lines(cells, tasks), f"{reached} of {len(by_task)} tasks above 0"))


def mean_lines(cells: Sequence[Cell], tasks: Sequence[str]) -> tuple[str, str]:
    """The mean over tasks of their rates in per cent, and over what it is.

    With the standard deviation over seeds if there are several, each with the same episodes of every task.
    """
    rates = {task: fmean(measured(some, "success")) for (task,), some in grouped(cells, "task").items()}
    mean, by_seed = 100 * fmean(rates.values()), grouped(cells, "seed")
    lacking = f"{len(rates)} of {len(tasks)} tasks, " if len(rates) < len(tasks) else ""
    designs = {tuple(sorted(cell.told("task", "episode") for cell in some)) for some in by_seed.values()}
    if (NAMED,) in by_seed:
        return f"{mean:.1f}", f"{lacking}named layouts"
    if len(by_seed) == 1:
        return f"{mean:.1f}", f"{lacking}1 seed"
    if len(designs) > 1:
        return f"{mean:.1f}", f"{lacking}{len(by_seed)} seeds, not all complete"
    of_seeds = [
        100 * fmean(fmean(measured(of_task, "success")) for of_task in grouped(some, "task").values())
        for some in by_seed.values()
    ]
    return f"{mean:.1f} ± {mean_and_deviation(of_seeds)[1]:.1f}", f"{lacking}{len(by_seed)} seeds"


def _seconds(cells: Sequence[Cell]) -> str:
    spent = measured(cells, "planning_seconds")
    return f"{median(spent):.1f} s" if spent else ""


def _average(cells: Sequence[Cell], measure: str) -> float | None:
    told = measured(cells, measure)
    return fmean(told) if told else None


def _tokens(cells: Sequence[Cell]) -> str:
    prompt, answer = _average(cells, "prompt_tokens"), _average(cells, "completion_tokens")
    return "not counted" if prompt is None or answer is None else f"{prompt:.0f} + {answer:.0f} tokens"


def _cached(cells: Sequence[Cell]) -> float:
    return sum(measured(cells, "cached"))


def _fallbacks(cells: Sequence[Cell]) -> int:
    return sum(bool(cell.notes.get("fallback")) for cell in cells)
