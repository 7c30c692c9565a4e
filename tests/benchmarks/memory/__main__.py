"""The slow measurements of memory: what is lost under load, kills and damage.

    python tests/benchmarks/memory                              # all of them
    python tests/benchmarks/memory kills writers --scale 0.1    # some, smaller

One line a figure: what it is, its value, its goal, its peer's value, a note.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import concurrency
import damage
from figure import NotMeasuredError, Test, passed
from setting import Setting

PARTS = (concurrency, damage)


def show(test: Test, setting: Setting) -> None:
    """Measure and print."""
    size = test.scaled(setting.scale)
    try:
        figures = test.measure(setting, size, test.on)
    except NotMeasuredError as error:
        print(f"{test.label} ({size:,}): not measured, {error}")
        return
    for row in test.rows:
        figure = figures[row.name]
        goal = row.goal if figure.goal is None else figure.goal
        word = {True: "reached", False: "MISSED", None: ""}[passed(figure.value, goal, row.better)]
        line = f"{row.title} ({test.on or size}): {figure.value:.{row.digits}f} {row.unit}"
        line += f", goal {goal:g} {word}" if goal is not None else ""
        line += f"; {figure.peer} {figure.peer_value:.{row.digits}f}" if figure.peer_value is not None else ""
        print(line + (f"; {figure.note}" if figure.note else ""), flush=True)


def main() -> None:
    """Measure what the arguments name."""
    tests = [test for part in PARTS for test in part.tests()]
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("names", nargs="*", choices=[[], *dict.fromkeys(test.name for test in tests)])
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--folder", type=Path, default=None)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        setting = Setting(Path(folder), scale=arguments.scale)
        for test in tests:
            if test.name in arguments.names or not arguments.names:
                show(test, setting)


if __name__ == "__main__":
    main()
