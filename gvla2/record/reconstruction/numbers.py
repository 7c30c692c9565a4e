"""A reconstruction's numbers in words: names, changes, and whether they are improvements."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.measures import Group
from gvla2.record.text import count
from gvla2.record.wording import fixed


@dataclass(frozen=True)
class NumberStyle:
    """How a number is shown: its name, decimals, unit, and whether more is better."""

    label: str
    digits: int
    unit: str
    more_is_better: bool
    note: str = ""


MEASURES: Mapping[str, NumberStyle] = {
    "symmetric_iou": NumberStyle("symmetric IoU", 4, "", True, "overlap of silhouettes and masks, both ways"),
    "mask_support": NumberStyle("mask support", 4, "", True, "mean mask value where points project"),
    "psnr": NumberStyle("PSNR", 2, "dB", True, "colours, on white"),
    "ssim": NumberStyle("SSIM", 4, "", True, "structure, uniform 7 × 7 window"),
    "lpips": NumberStyle("LPIPS", 4, "", False, "perceived distance, AlexNet v0.1"),
    "cd_surface": NumberStyle(
        "CD surface × 10³", 2, "", False, "in the views’ frame: place, scale and shape count"
    ),
    "cd_official": NumberStyle("CD official × 10³", 2, "", False, "each shape in its own unit box"),
}
GROUPS: Mapping[Group, tuple[str, str]] = {
    "truth": ("Against the true mesh", "Chamfer distance, 100 000 points a surface"),
    "held_out": ("In held-out views", "views not used as input"),
    "inputs": ("In the input views", "the fit to the inputs; not a measure of quality by itself"),
}
_STEADY = 5e-4  # relative change below which a number counts as unchanged


def metric_groups(record: ReconstructionRecord) -> list[dict[str, Any]]:
    """All numbers before and after, the strictest first: by group its ``title``, ``note`` and ``rows``.

    A row has ``label``, ``note``, ``before``, ``after``, the ``change`` in percent, all text, and its ``tone``.
    """
    if record.measures is None:
        return []
    made = []
    for group, (title, note) in GROUPS.items():
        pair = record.measures.groups.get(group)
        if pair is None:
            continue
        rows = []
        for name, after in pair[1].items():
            how = MEASURES.get(name, NumberStyle(name.replace("_", " "), 4, "", True))
            before = pair[0].get(name, float("nan"))
            change = _change(before, after)
            said = "" if change is None else f"{100 * change:+.2f} %".replace("-", "−")
            was, now = (f"{fixed(value, how.digits)} {how.unit}".strip() for value in (before, after))
            row = {"label": how.label, "note": how.note, "before": was, "after": now, "change": said}
            rows.append({**row, "tone": tone_of(group, name, record)})
        shown = f"{note}; {count(len(record.measures.held_out), 'view')}" if group == "held_out" else note
        made.append({"title": title, "note": shown, "rows": rows})
    return made


def told(group: Group, name: str, record: ReconstructionRecord) -> tuple[str, str, str]:
    """A number before and after as text, its tone and a note."""
    pair = None if record.measures is None else record.measures.groups.get(group)
    if pair is None or name not in pair[1]:
        return "", "idle", "Not measured."
    how = MEASURES[name]
    texts = [fixed(numbers.get(name), how.digits) for numbers in pair]
    value = f"{texts[0]} → {texts[1]} {how.unit}".strip()
    if _change(pair[0].get(name), pair[1].get(name)) is None:
        value = f"{texts[1]} {how.unit}".strip()
    note = f"{how.label}: {how.note}. {'More' if how.more_is_better else 'Less'} is better."
    return value, tone_of(group, name, record), note


def tone_of(group: Group, name: str, record: ReconstructionRecord) -> str:
    """Whether a number improved ("good"), got worse ("bad") or hardly changed ("idle")."""
    pair = None if record.measures is None else record.measures.groups.get(group)
    change = None if pair is None else _change(pair[0].get(name), pair[1].get(name))
    if change is None or abs(change) < _STEADY:
        return "idle"
    better = MEASURES[name].more_is_better if name in MEASURES else True
    return "good" if (change > 0) == better else "bad"


def _change(before: float | None, after: float | None) -> float | None:
    """Relative change; None when undefined."""
    if not before or after is None or not math.isfinite(before) or not math.isfinite(after):
        return None
    return (after - before) / abs(before)
