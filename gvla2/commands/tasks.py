"""``gvla2 tasks``: a page of all tasks, from every camera, as they start and as they end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gvla2.errors import Gvla2Error

if TYPE_CHECKING:
    from gvla2.record.page import TaskShown
    from gvla2.robot.backend import RobotBackend
    from gvla2.robot.task import Task

DESCRIPTION = """\
Writes one HTML page that shows each task from every camera: as it starts, and as it ends when its scripted
demonstration carries it out. The demonstrations know the true state; no planner uses them.
"""


def main(argv: Sequence[str]) -> int:
    """Write the page; the exit status is 1 when a task could not be laid out."""
    options = _parser().parse_args(argv)
    from gvla2.io.files import write_text
    from gvla2.record.page import gallery_page

    try:
        shown = list(show(options.task, options.robot, options.seed, demonstrate=not options.start_only))
        write_text(options.output, gallery_page(shown, options.seed))
    except Gvla2Error as error:
        print(f"gvla2: {error}", file=sys.stderr)
        return 1
    print(options.output)
    return int(any(task.problem for task in shown))


def show(names: Sequence[str], robot: str, seed: int, *, demonstrate: bool) -> Iterator[TaskShown]:
    """The named tasks, or all that need no option, one by one as they are rendered; progress goes to stderr."""
    from gvla2.commands.hydra_job import composed
    from gvla2.plugins.registry import load_plugins
    from gvla2.record.page import TaskShown

    registry = load_plugins()
    offers = registry.offers("task")
    plain = [name for name, offer in offers.items() if name != "none" and not offer.component.config.required]
    for name in names or plain:
        offer = registry.get("task", name)
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            config, _ = composed("run", [f"task={name}", f"robot={robot}"])
            built = registry.build_all(config, ("robot", "task"))
            with closing(built["robot"]) as arm:
                yield _photograph(arm, built["task"], name, offer.summary, seed, demonstrate)
        except Gvla2Error as error:
            yield TaskShown(name, offer.summary, problem=str(error))


def _photograph(
    robot: RobotBackend, task: Task, name: str, summary: str, seed: int, demonstrate: bool
) -> TaskShown:
    from gvla2.record.page import TaskShown
    from gvla2.robot import backend

    instance = robot.reset(task, seed)
    if instance is None:
        return TaskShown(name, summary, problem="The robot lays out no task; choose a simulated one.")
    before = robot.observe().views
    shown = TaskShown(
        name, summary, instance.instruction, instance.goal, tuple(task.instructions), tuple(before)
    )
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
    parser.add_argument("task", nargs="*", help="names of tasks; by default all that need no option")
    parser.add_argument("--robot", default="sapien_panda", help="a simulated robot (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the layouts (default: %(default)s)")
    parser.add_argument(
        "--output", type=Path, default=Path("tasks.html"), help="the page (default: %(default)s)"
    )
    parser.add_argument("--start-only", action="store_true", help="omit the demonstrations")
    return parser
