"""The robot suite's tables: success with intervals and costs, what memory adds, and the failures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from statistics import fmean, median
from types import MappingProxyType
from typing import Any

from gvla2.evaluation.comparison import (
    EFFECT,
    SATURATED,
    different,
    effect,
    least,
    pairs_by_task,
    rate,
    saturated,
)
from gvla2.evaluation.results import Cell, grouped, latest, measured
from gvla2.evaluation.statistics import Pair, mean_and_deviation
from gvla2.evaluation.suites.robot_design import NAMED, PROFILES, SETTING, ordered
from gvla2.evaluation.tables import NONE, Sheet, SheetCell, SheetRow, film, runs_of, text_cell
from gvla2.record.text import count

PLANNER = ("planner", "model")
"""Factors that the arms of a comparison share, besides the setting."""
EPISODE = (*PLANNER, "task", "arm", "variant", "geometry", "learning", "profile", "seed", "episode")
"""Factors that distinguish the episodes of a setting."""
SUCCESS = (
    "Success in per cent over episodes with its 95 % Wilson interval; the mean over tasks ± standard deviation over "
    "seeds. Asterisk, coloured: the task differs from memory off (exact McNemar on paired episodes, Holm over tasks, "
    "p < .05). Planning seconds include checks and answers to rejected plans; tokens are those of prompts + answers as "
    "the server counted them. Answers from a cache cost neither tokens nor time. In a learnable world each seed is "
    "another world, and a row pools the families of that number. What columns could show against the first is the "
    f"least difference that McNemar's test finds in their common episodes (p < .05, power 80 %). {SATURATED}"
)
SUITES = (
    "Success in per cent by suite with its 95 % Wilson interval. Published results have other evidence, which the last "
    f"row names: no test between them and ours means anything. {SATURATED}"
)
FAILURES = (
    "Failures by cause, where the relaxed goal was not reached (unnoticed: the robot's own verifier saw nothing wrong; "
    "abstained: the planner found no plan), and how often the verifier agreed with the simulator where it was sure. "
    "An episode is not measured if it could not be set up, its simulated world blew up, the planner did not answer in "
    "time, or its language model was unavailable; it is not counted, and measured again next time."
)

NOT_REPORTED = SheetCell(("",), none=True)
Columns = Mapping[str, Sequence[Cell]]
"""A table's columns by heading, each with its cells."""


NOTHING: Mapping[str, Any] = MappingProxyType({})


def robot_sheets(
    cells: Iterable[Cell],
    groups: Mapping[str, Sequence[str]] = NOTHING,
    published: Mapping[str, Any] = NOTHING,
) -> list[Sheet]:
    """For each group of comparable cells: success by suite and by ``groups`` of suites beside ``published`` results,
    success by profile, the differences between arms, the failures.
    """
    given = list(cells)
    order = list(grouped(given, *PLANNER))
    once = latest(given, lambda cell: cell.texts(*SETTING, *EPISODE))
    kept = sorted(once, key=lambda cell: (cell.texts(*SETTING), order.index(cell.texts(*PLANNER))))
    stressed = [cell for cell in kept if cell.factors.get("stress")]
    shared = [name for name in (*SETTING, *PLANNER) if name != "stress"]
    return [
        *(_by_stress(found, shared) for found in grouped(stressed, *shared).values()),
        *(s for found in grouped(kept, *SETTING).values() for s in _of_setting(found, groups, published)),
    ]


def _named(cells: Sequence[Cell]) -> list[Cell]:
    """The cells with their arms' names in tables: with a variant's options, and how it learns where arms differ."""
    learned = [cell.texts("learning")[0] for cell in cells if "learning" in cell.factors]
    shown = ["variant", "learning"] if len({*learned}) > 1 else ["variant"]
    found = []
    for cell in cells:
        arm, *special = cell.texts("arm", *shown)
        options = ", ".join(filter(None, special))
        found.append(replace(cell, factors={**cell.factors, "arm": f"{arm} ({options})" if options else arm}))
    return found


def _by_stress(cells: Sequence[Cell], shared: Sequence[str]) -> Sheet:
    """Stresses down; what memory on adds to each other arm across."""
    found = _of_profile(cells, PROFILES[0])
    others = [arm for arm in _arms(found) if arm != "on"]
    rows = []
    for (stress,), some in grouped(found, "stress").items():
        by_arm = {arm: own for (arm,), own in grouped(some, "arm").items()}
        on = by_arm.get("on", [])
        effects = (effect(_pairs(by_arm.get(arm, []), on)) for arm in others)
        rows.append(SheetRow(f"{stress}{_saturated(by_arm)}", (_rate(on, 0), *effects)))
    headings = ("memory on", *(f"on against {arm}" for arm in others))
    title = f"{_title(found, shared)}: what governance adds under stress"
    counted = f"{count(len(rows), 'stress', 'stresses')}, {count(len(found), 'episode')}"
    return Sheet(title, headings, tuple(rows), counted, runs_of(cells), EFFECT)


def _suite(task: str) -> str:
    """The suite of a robot's own task, "" for others, whose options may be paths."""
    suite, slash, _ = task.partition("/")
    return suite if slash and suite.replace("-", "_").isidentifier() else ""


def _of_setting(
    cells: Sequence[Cell], groups: Mapping[str, Sequence[str]], published: Mapping[str, Any]
) -> list[Sheet]:
    cells = _named(cells)
    tasks = ordered([task for (task,) in grouped(cells, "task")])
    columns = _columns(cells)
    title = _title(cells, SETTING if len(grouped(cells, "planner")) > 1 else (*SETTING, *PLANNER))
    sheets = []
    if suites := list(dict.fromkeys(filter(None, map(_suite, tasks)))):
        whole = {name: some for name, some in groups.items() if set(some) <= set(suites)}
        whole = whole or {"all suites": suites}
        sheets.append(_by_suite(columns, suites, whole, published, f"{title}: success by suite"))
    # A robot's own task has one success check: both profiles are the same.
    if all(map(_suite, tasks)):
        sheets.append(_success(columns, tasks, PROFILES[0], f"{title}: success"))
    else:
        sheets += [_success(columns, tasks, one, f"{title}: success, {one}") for one in PROFILES]
    for found in grouped(cells, *PLANNER).values():
        if len(grouped(found, "arm")) > 1:
            added = "geometry" if any(cell.factors.get("geometry") for cell in found) else "memory"
            sheets.append(_effects(found, f"{_title(found, (*SETTING, *PLANNER))}: what {added} adds"))
    sheets.append(_failures(columns, f"{title}: failures"))
    counted = f"{count(len(tasks), 'task')}, {count(len(_of_profile(cells, PROFILES[0])), 'episode')}"
    return [replace(sheet, counts=counted, runs=runs_of(cells)) for sheet in sheets]


def _title(cells: Sequence[Cell], names: Sequence[str]) -> str:
    """What all these cells share."""
    shared = [f"{name} {value}" for name, value in zip(names, cells[0].texts(*names), strict=True) if value]
    learned = {cell.texts("learning")[0] for cell in cells if "learning" in cell.factors}
    return f"Robot ({', '.join(shared + sorted(learned - {''} if len(learned) == 1 else ()))})"


def _arms(cells: Sequence[Cell]) -> list[str]:
    """The arms of these cells, ``off`` and ``on`` first."""
    return sorted((arm for (arm,) in grouped(cells, "arm")), key=lambda arm: (arm != "off", arm != "on", arm))


def _columns(cells: Sequence[Cell]) -> dict[str, list[Cell]]:
    """The cells by planner if there are several, its language model likewise, and arm if any is not ``off``."""
    models = {planner: grouped(some, "model") for (planner,), some in grouped(cells, "planner").items()}
    arms, order = _arms(cells), list(models)
    found = grouped(cells, "planner", "arm", "model")
    columns = {}
    for planner, arm, model in sorted(found, key=lambda place: (order.index(place[0]), arms.index(place[1]))):
        asked = f" by {model}" if model and len(models[planner]) > 1 else ""
        geometry = found[planner, arm, model][0].texts("geometry")[0]
        memory = f"memory {arm}" if arms != ["off"] or len(models) == 1 else ""
        memory = f"geometry {geometry}" if geometry else memory
        named = f"{planner}{asked}" if len(models) > 1 or asked else ""
        columns[", ".join(filter(None, (named, memory)))] = found[planner, arm, model]
    return columns


def _counts(cell: Cell) -> bool:
    """Whether the episode was measured: its planner did not time out, and its model was available."""
    return cell.measures.get("success") is not None


def _of_profile(cells: Iterable[Cell], profile: str) -> list[Cell]:
    return [cell for cell in cells if cell.factors.get("profile") == profile]


def _by_suite(
    columns: Columns,
    suites: Sequence[str],
    groups: Mapping[str, Sequence[str]],
    published: Mapping[str, Any],
    title: str,
) -> Sheet:
    """Suites and their groups down; planners, arms and the published systems that report any of them across."""
    found = {name: _of_profile(some, PROFILES[0]) for name, some in columns.items()}
    wholes = {**{name: [name] for name in suites}, **groups}
    others = [(name, one) for name, one in published.items() if not wholes.keys().isdisjoint(one["success"])]
    rows = []
    for name, members in wholes.items():
        own = {
            column: [c for c in some if _suite(c.texts("task")[0]) in members]
            for column, some in found.items()
        }
        theirs = (one["success"].get(name) for _, one in others)
        reported = (NOT_REPORTED if each is None else text_cell(each) for each in theirs)
        rows.append(
            SheetRow(f"{name}{_saturated(own)}", (*(_rate(some, 0) for some in own.values()), *reported))
        )
    given = [", ".join(given for (given,) in grouped(some, "given")) for some in found.values()]
    rows.append(SheetRow("given", tuple(map(text_cell, [*given, *(one["given"] for _, one in others)]))))
    headings = (*columns, *(f"{name} (published)" for name, _ in others))
    return Sheet(title, headings, tuple(rows), "", (), SUITES)


def _success(columns: Columns, tasks: Sequence[str], profile: str, title: str) -> Sheet:
    """Tasks down, planners and arms across, a row of means, then the cost of an episode where a model was asked."""
    found = {name: _of_profile(some, profile) for name, some in columns.items()}
    everything = [cell for some in found.values() for cell in some]
    entries: dict[str, list[SheetCell]] = {task: [] for task in (*tasks, "mean over tasks")}
    for some in found.values():
        off = [c for c in everything if c.texts("arm", *PLANNER) == ("off", *some[0].texts(*PLANNER))]
        sure, by_task = different(_pairs(off, some)), grouped(some, "task")
        for task in tasks:
            entries[task].append(_rate(by_task.get((task,), []), sure.get(task, 0)))
        entries["mean over tasks"].append(_mean([cell for cell in some if _counts(cell)]))
    rows = [
        SheetRow(f"{label}{_saturated(_of_task(label, found))}", tuple(line))
        for label, line in entries.items()
    ]

    def could_show(some: Sequence[Cell]) -> str:
        first = next(iter(found.values()))
        pairs = [pair for pairs in _pairs(first, some).values() for pair in pairs]
        return "" if some is first else least(pairs)

    asked = any(cell.measures.get("calls") or cell.measures.get("cached") for cell in everything)
    lines: dict[str, Callable[[Sequence[Cell]], str]] = {}
    if profile == PROFILES[0] and (asked or len(grouped(everything, "planner")) > 1):
        if len(grouped(everything, "planner")) > 1:
            lines["against the first column"] = could_show
        lines["planning seconds, median"] = lambda some: _middle(measured(some, "planning_seconds"))
        lines["calls an episode"] = lambda some: f"{_average(some, 'calls') or 0:.1f}"
        lines["prompt + answer tokens an episode"] = _tokens
        lines["answers from the cache"] = lambda some: f"{sum(measured(some, 'cached')):.0f}"
    lines["width error, mm, median"] = lambda some: _middle(measured(some, "width_error"))
    lines["second tries"] = _second_tries
    lines["episodes with the fallback"] = lambda some: str(sum(bool(c.notes.get("fallback")) for c in some))
    lines["not measured"] = lambda some: str(sum(not _counts(cell) for cell in some))
    lines["episodes"] = lambda some: str(sum(map(_counts, some)))
    rows += [_line(label, text, found) for label, text in lines.items()]
    filled = [row for row in rows if any(cell.lines not in (("0",), ("",)) for cell in row.cells)]
    return Sheet(title, tuple(columns), tuple(filled), "", (), SUCCESS)


def _saturated(columns: Columns) -> str:
    """A remark on cells of several columns that leave no room for a difference."""
    return saturated([fmean(_outcomes(some).values()) for some in columns.values() if _outcomes(some)])


def _of_task(task: str, columns: Columns) -> dict[str, list[Cell]]:
    return {name: [c for c in some if c.texts("task") == (task,)] for name, some in columns.items()}


def _second_tries(cells: Sequence[Cell]) -> str:
    """In how many episodes something was tried again, and how many of those reached the goal; "" for none."""
    again = [
        bool(cell.measures["success"]) for cell in cells if _counts(cell) and cell.notes.get("second_tries")
    ]
    return f"{sum(again)} of {len(again)} won" if again else ""


def _rate(cells: Sequence[Cell], sure: int) -> SheetCell:
    """The rate of the measured episodes."""
    return rate([bool(cell.measures["success"]) for cell in cells if _counts(cell)], sure)


def _mean(cells: Sequence[Cell]) -> SheetCell:
    """The mean over tasks of their rates in per cent, its deviation over seeds, and what it covers."""
    if not cells:
        return NONE
    rates, by_seed = _rates(cells), grouped(cells, "seed")
    above = f"{sum(rate > 0 for rate in rates)} of {count(len(rates), 'task')} above 0"
    if (NAMED,) in by_seed:
        return SheetCell((f"{fmean(rates):.1f}", f"named layouts; {above}"))
    deviation = mean_and_deviation([fmean(_rates(some)) for some in by_seed.values()])[1]
    spread = f" ± {deviation:.1f}" if len(by_seed) > 1 else ""
    return SheetCell((f"{fmean(rates):.1f}{spread}", f"{count(len(by_seed), 'seed')}; {above}"))


def _rates(cells: Sequence[Cell]) -> list[float]:
    """Success in per cent, task by task."""
    return [100 * fmean(measured(some, "success")) for some in grouped(cells, "task").values()]


def _outcomes(cells: Sequence[Cell]) -> dict[tuple[str, ...], float]:
    """The successes of the measured episodes by task, seed and number."""
    return {
        c.texts("task", "seed", "episode"): float(c.measures["success"] or 0) for c in cells if _counts(c)
    }


def _pairs(first: Sequence[Cell], second: Sequence[Cell]) -> dict[str, list[Pair]]:
    """By task the measured episodes that two arms share, if there are any."""
    return pairs_by_task(_outcomes(first), _outcomes(second))


def _effects(cells: Sequence[Cell], title: str) -> Sheet:
    """Every arm against memory off, and memory on against every other."""
    arms = _arms(cells)
    against = [(arm, "off") for arm in arms if arm != "off" and "off" in arms]
    against += [("on", arm) for arm in arms if "on" in arms and arm not in ("on", "off")]
    by_arm = grouped(cells, "arm", "profile")
    rows = []
    for second, first in against:
        pairs = (_pairs(by_arm.get((first, p), []), by_arm.get((second, p), [])) for p in PROFILES)
        rows.append(SheetRow(f"{second} against {first}", tuple(map(effect, pairs))))
    return Sheet(title, PROFILES, tuple(rows), "", (), EFFECT)


def _failures(columns: Columns, title: str) -> Sheet:
    found = {
        name: [c for c in _of_profile(some, PROFILES[0]) if _counts(c)] for name, some in columns.items()
    }
    causes = {name: Counter(str(c.notes.get("failure", "")) for c in some) for name, some in found.items()}
    kinds = sorted({kind for counts in causes.values() for kind in counts} - {""})
    rows = [
        SheetRow(kind.replace("_", " "), tuple(text_cell(counts[kind]) for counts in causes.values()))
        for kind in kinds
    ]
    rows.append(_line("episodes", lambda some: str(len(some)), found))
    rows.append(_line("verifier agrees", _agreement, found))
    rows.append(_line("seconds, median", lambda some: _middle(measured(some, "seconds")), found))
    shown = [
        film(
            f"{c.texts('task')[0]}, layout {c.notes.get('layout')}: {c.notes.get('message')}",
            str(c.notes["folder"]),
            failed=True,
        )
        for some in found.values()
        for c in some
        if c.notes.get("failure") and c.notes.get("folder")
    ]
    return Sheet(title, tuple(columns), tuple(rows), "", (), FAILURES, tuple(shown))


def _line(label: str, text: Callable[[Sequence[Cell]], str], columns: Columns) -> SheetRow:
    return SheetRow(label, tuple(text_cell(text(some) if some else "") for some in columns.values()))


def _agreement(cells: Sequence[Cell]) -> str:
    sure = [c for c in cells if c.notes.get("verdict") in ("verified_success", "verified_fail")]
    same = sum((c.notes["verdict"] == "verified_success") == bool(c.measures["success"]) for c in sure)
    return f"{same} of {len(sure)}"


def _middle(values: Sequence[float]) -> str:
    return f"{median(values):.1f}" if values else ""


def _average(cells: Sequence[Cell], measure: str) -> float | None:
    found = measured(cells, measure)
    return fmean(found) if found else None


def _tokens(cells: Sequence[Cell]) -> str:
    prompt, answer = _average(cells, "prompt_tokens"), _average(cells, "completion_tokens")
    return "not counted" if prompt is None or answer is None else f"{prompt:.0f} + {answer:.0f}"
