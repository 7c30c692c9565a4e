"""Multi-line entries (workflows, trajectories) as one bounded block of text for a planner."""

from __future__ import annotations

from collections.abc import Sequence

from gvla2.memory.contracts import MemoryItem
from gvla2.memory.rendering import CLOSING, OPENING, effect_words, neutralised

_LONGEST_LINE = 400


def with_values(items: Sequence[MemoryItem], groups: Sequence[int]) -> list[tuple[str, list[str]]]:
    """The entries formed by items, ``groups`` giving how many belong to each: text of the first, values of all."""
    entries, start = [], 0
    for size in groups:
        leading, *others = items[start : start + size]
        notes = [f"{item.content}{effect_words(item.effect)}" for item in others]
        if own := effect_words(leading.effect):
            notes.insert(0, own.strip())
        entries.append((leading.content, notes))
        start += size
    return entries


def show_exemplars(title: str, entries: Sequence[tuple[str, Sequence[str]]], max_chars: int) -> str:
    """The block: under ``title`` each entry's text with its lines kept, then its notes; "" for no entries.

    Never longer than ``max_chars``: long entries are cut evenly at their ends, and if even that is not enough the last
    entries are left out. Every line is neutralised, as in :func:`gvla2.memory.rendering.render`.
    """
    shown = list(entries)
    while shown:
        frame = len(OPENING) + len(CLOSING) + len(title) + 3
        room = (max_chars - frame) // len(shown) - 1
        if room >= 80:
            blocks = [_block(number, text, notes, room) for number, (text, notes) in enumerate(shown, 1)]
            return "\n".join([OPENING, title, *blocks, CLOSING])
        shown.pop()
    return ""


def _block(number: int, text: str, notes: Sequence[str], room: int) -> str:
    """One entry in at most ``room`` characters: its notes are short and stay, its text is cut."""
    tail = [f"- {neutralised(note, 160)}" for note in notes]
    while tail and sum(map(len, tail)) + len(tail) > room // 2:
        tail.pop()
    left = room - sum(len(line) + 1 for line in tail)
    lines = [f"({number})"]
    left -= len(lines[0]) + 1
    # Text beyond the limit is never shown, so the cost is bounded.
    for line in text[: 4 * room].splitlines():
        plain = neutralised(line, _LONGEST_LINE)
        if not plain:
            continue
        if len(plain) + 2 > left:
            lines.append("…")
            break
        lines.append(plain)
        left -= len(plain) + 1
    return "\n".join([*lines, *tail])
