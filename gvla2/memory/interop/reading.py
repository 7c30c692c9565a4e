"""What lies at a path: which layout, and the lessons in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gvla2.errors import ConfigurationError, MemoryStoreError
from gvla2.memory.interop import items_layout, robot_layout, states_layout
from gvla2.memory.interop.entry import Entry
from gvla2.memory.interop.lines import Line, LineError, Remark, read_lines


@dataclass(frozen=True)
class Layout:
    """A layout: whether a line ``fits`` it, how a line is read, and how records of one line are written."""

    name: str
    fits: Callable[[Mapping[str, Any]], bool]
    read: Callable[[Line], list[Entry]]
    write: Callable[[Sequence[Entry]], dict[str, Any]]


LAYOUTS: Mapping[str, Layout] = MappingProxyType(
    {
        module.NAME: Layout(module.NAME, module.fits, module.read, module.write)
        for module in (states_layout, items_layout, robot_layout)
    }
)


def layout_named(name: str) -> Layout:
    """The layout; raises :class:`ConfigurationError` with those that exist."""
    if name not in LAYOUTS:
        raise ConfigurationError(f"No memory layout '{name}'. Available: {', '.join(LAYOUTS)}.")
    return LAYOUTS[name]


def read_path(path: Path, layout: str = "") -> tuple[Layout, list[Entry], list[Remark]]:
    """All lessons of a file or folder, and remarks on its lines, broken ones included.

    ``layout`` "" looks at the lines themselves. Raises :class:`MemoryStoreError` when there is nothing to read,
    or it is of no known layout.
    """
    wanted = layout_named(layout) if layout else None
    lines: list[Line] = []
    remarks: list[Remark] = []
    try:
        files = _files(path)
    except OSError as error:  # a folder that may not be looked into
        raise MemoryStoreError(f"Cannot read {path}: {error.strerror or error}.") from error
    for file in files:
        found, broken = read_lines(file)
        lines += found
        remarks += broken
    chosen = wanted or _layout_of(path, lines, bool(remarks))
    entries = []
    for line in lines:
        try:
            made = chosen.read(line)
        except LineError as error:
            remarks.append(Remark(line.file, line.number, str(error)))
            continue
        except (ValueError, OverflowError, RecursionError) as error:  # one odd value must not stop the others
            remarks.append(Remark(line.file, line.number, f"it cannot be kept: {error}"))
            continue
        entries += made
        remarks += [Remark(line.file, line.number, note, broken=False) for e in made for note in e.notes]
    return chosen, entries, remarks


def _files(path: Path) -> list[Path]:
    if not os.path.exists(path):  # noqa: PTH110  # Path.exists raises for names that no file system takes
        raise MemoryStoreError(
            f"There is nothing at {path}. Give a .jsonl file, or a folder with active.jsonl."
        )
    if not path.is_dir():  # a pipe is read like a file: `... | gvla2 memory import /dev/stdin`
        return [path]
    found = list(states_layout.files_of(path).values())
    if found:
        return found
    models = sorted(p.name for p in path.iterdir() if p.is_dir() and states_layout.files_of(p))
    if len(models) == 1:
        return list(states_layout.files_of(path / models[0]).values())
    if models:
        raise MemoryStoreError(
            f"{path} has memories of several models. Give one of them: {', '.join(models)}."
        )
    single = sorted(path.glob("*.jsonl"))
    if len(single) == 1:
        return single
    which = f" It has: {', '.join(p.name for p in single)}; give one of them." if single else ""
    raise MemoryStoreError(
        f"{path} has no active.jsonl, provisional.jsonl, summary.jsonl or archive.jsonl.{which}"
    )


def _layout_of(path: Path, lines: Sequence[Line], broken: bool) -> Layout:
    """The layout of the first line that fits one; an empty memory fits the first."""
    for line in lines:
        for layout in LAYOUTS.values():
            if layout.fits(line.fields):
                return layout
    if not lines and (path.is_dir() or not broken):
        return LAYOUTS[states_layout.NAME]
    raise MemoryStoreError(
        f"{path} is of no known layout: no line has memory_id and content, memory_items, or memory_text and "
        f"task_text. Layouts: {', '.join(LAYOUTS)}."
    )
