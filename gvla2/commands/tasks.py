"""``gvla2 tasks``: a page of tasks from every camera, as they start and as they end, or a robot's own tasks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gvla2.errors import Gvla2Error

if TYPE_CHECKING:
    from gvla2.plugins.registry import Registry
    from gvla2.record.page import TaskShown
    from gvla2.robot.backend import RobotBackend
    from gvla2.robot.task import Task

DESCRIPTION = """\
Writes one HTML page that shows each task from every camera: as it starts, and as it ends when its scripted
demonstration carries it out. The demonstrations know the true state; no planner uses them.
With a robot that has a world of its own, `gvla2 tasks robot=NAME` lists the tasks that it offers.
"""


def main(argv: Sequence[str]) -> int:
    """List a robot's own tasks, or write the page; the exit status is 1 when a task could not be laid out."""
    options = _parser().parse_args(argv)
    from gvla2.commands.hydra_job import composed
    from gvla2.io.files import write_text
    from gvla2.record.page import gallery_page

    overrides = [word for word in options.words if "=" in word]
    names = [word for word in options.words if "=" not in word]
    try:
        if any(word.startswith("robot=") for word in overrides) and not names:
            config, registry = composed("run", [*overrides, "task=none"])
            if own := _own_tasks(config, registry):
                _list(own)
                return 0
        shown = list(show(names, overrides, options.seed, demonstrate=not options.start_only))
        write_text(options.output, gallery_page(shown, options.seed))
    except Gvla2Error as error:
        print(f"gvla2: {error}", file=sys.stderr)
        return 1
    print(options.output)
    return int(any(task.problem for task in shown))


def _own_tasks(config: Any, registry: Registry) -> dict[str, str]:
    """The tasks that the chosen robot offers itself: sentences by name."""
    from gvla2.robot.backend import OffersTasks

    with closing(registry.build(config, "robot")) as robot:
        return dict(robot.tasks()) if isinstance(robot, OffersTasks) else {}


def _list(tasks: dict[str, str]) -> None:
    from gvla2.commands.tables import console, row, table

    listing = table("task", "instruction")
    for name, sentence in tasks.items():
        row(listing, name, sentence)
    console().print(listing)


def show(
    names: Sequence[str], overrides: Sequence[str], seed: int, *, demonstrate: bool
) -> Iterator[TaskShown]:
    """The named tasks, or all that need no option, one by one as they are rendered; progress goes to stderr.

    ``overrides`` choose the robot and its options, as for ``gvla2 run``.
    """
    from gvla2.commands.hydra_job import composed
    from gvla2.plugins.kinds import OWN_TASK
    from gvla2.plugins.registry import load_plugins
    from gvla2.record.page import TaskShown

    offers = (registry := load_plugins()).offers("task")
    for name in names or [name for name, offer in offers.items() if not offer.component.config.required]:
        summary = "" if OWN_TASK in name else registry.get("task", name).summary
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            config, _ = composed("run", [*overrides, f"task={name}"])
            built = registry.build_all(config, ("robot", "task"))
            with closing(built["robot"]) as arm:
                yield _photograph(arm, built["task"], name, summary, seed, demonstrate)
        except Gvla2Error as error:
            yield TaskShown(name, summary, problem=str(error))


def _photograph(
    robot: RobotBackend, task: Task | str, name: str, summary: str, seed: int, demonstrate: bool
) -> TaskShown:
    from gvla2.record.page import TaskShown
    from gvla2.robot import backend

    instance = robot.reset(task, seed)
    if instance is None:
        return TaskShown(name, summary, problem="The robot lays out no task; choose a simulated one.")
    before = robot.observe().views
    phrases = () if isinstance(task, str) else tuple(task.instructions)
    shown = TaskShown(name, summary, instance.instruction, instance.goal, phrases, tuple(before))
    if not demonstrate or instance.solution is None:
        return shown
    reports = backend.demonstrate(robot, instance)
    after = robot.observe().views
    judged = robot.success_check()
    done, strict = (False, False) if judged is None else (judged.relaxed, judged.strict)
    stopped = reports[-1].abort if reports else None
    ending = f"Demonstrated: relaxed {_word(done)}, strict {_word(strict)}."
    if stopped is not None:
        ending += f" It stopped at '{stopped.stage}': {stopped.message}"
    return replace(shown, after=tuple(after), ending=ending, done=done)


def _word(reached: bool) -> str:
    return "reached" if reached else "not reached"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="gvla2 tasks", description=DESCRIPTION)
    parser.add_argument(
        "words",
        nargs="*",
        metavar="task | robot=NAME | robot.option=VALUE",
        help="names of tasks, by default all that need no option; a simulated robot and its options",
    )
    parser.add_argument("--seed", type=int, default=0, help="of the layouts (default: %(default)s)")
    parser.add_argument(
        "--output", type=Path, default=Path("tasks.html"), help="the page (default: %(default)s)"
    )
    parser.add_argument("--start-only", action="store_true", help="omit the demonstrations")
    return parser
