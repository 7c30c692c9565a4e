"""A reconstruction's numbers in words: names, changes, and whether they are improvements."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.wording import fixed


@dataclass(frozen=True)
class NumberStyle:
    """How a number is shown: its name, decimals, unit, and whether more is better."""

    label: str
    digits: int
    unit: str
    more_is_better: bool
    note: str = ""

    def shown(self, value: float) -> str:
        """The number with its unit."""
        return f"{fixed(value, self.digits)} {self.unit}".strip()


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
_STEADY = 5e-4  # relative change below which a number counts as unchanged


@dataclass(frozen=True)
class BeforeAfter:
    """A number before and after the branch."""

    style: NumberStyle
    before: float
    after: float

    @property
    def change(self) -> float | None:
        """Relative change; None when undefined."""
        if not self.before or not math.isfinite(self.before) or not math.isfinite(self.after):
            return None
        return (self.after - self.before) / abs(self.before)

    @property
    def tone(self) -> str:
        """Whether the number improved ("good"), got worse ("bad") or hardly changed ("idle")."""
        change = self.change
        if change is None or abs(change) < _STEADY:
            return "idle"
        return "good" if (change > 0) == self.style.more_is_better else "bad"

    @property
    def told(self) -> str:
        """The number before and after ("0.9012 → 0.9311"), or after alone where no change is defined."""
        after = self.style.shown(self.after)
        return after if self.change is None else f"{fixed(self.before, self.style.digits)} → {after}"


def compared(record: ReconstructionRecord, group: str, name: str) -> BeforeAfter | None:
    """A number of the record; None when it was not measured."""
    before, after = record.measures.groups.get(group, ({}, {})) if record.measures else ({}, {})
    if name not in after:
        return None
    style = MEASURES.get(name, NumberStyle(name.replace("_", " "), 4, "", True))
    return BeforeAfter(style, before.get(name, float("nan")), after[name])
