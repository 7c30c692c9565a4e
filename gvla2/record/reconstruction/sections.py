"""The contents of a reconstruction's page: numbers with their names and tones, steps and sentences, no markup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from gvla2.reconstruction.options import BranchOptions
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.text import count
from gvla2.record.wording import State, Step, fixed

STATES: Mapping[str, State] = {
    "applied": "done",
    "partial": "done",
    "rejected": "warn",
    "fallback": "warn",
    "skipped": "skipped",
}
"""The mark of each stage status."""

_STILL = 1e-4  # mean displacement, as a share of the size, below which an object counts as unmoved
_STEADY = 5e-4  # relative change below which a number counts as unchanged


@dataclass(frozen=True)
class BeforeAfter:
    """A number before and after the branch, and how it is shown: its name, decimals, unit, whether more is better."""

    label: str
    digits: int
    unit: str
    more_is_better: bool
    note: str = ""
    before: float = math.nan
    after: float = math.nan

    def shown(self, value: float) -> str:
        """Such a number with its unit."""
        return f"{fixed(value, self.digits)} {self.unit}".strip()

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
        return "good" if (change > 0) == self.more_is_better else "bad"

    @property
    def told(self) -> str:
        """The number before and after ("0.9012 → 0.9311"), or after alone where no change is defined."""
        after = self.shown(self.after)
        return after if self.change is None else f"{fixed(self.before, self.digits)} → {after}"


MEASURES: Mapping[str, BeforeAfter] = {
    "symmetric_iou": BeforeAfter("symmetric IoU", 4, "", True, "overlap of silhouettes and masks, both ways"),
    "mask_support": BeforeAfter("mask support", 4, "", True, "mean mask value where points project"),
    "psnr": BeforeAfter("PSNR", 2, "dB", True, "colours, on white"),
    "ssim": BeforeAfter("SSIM", 4, "", True, "structure, uniform 7 × 7 window"),
    "lpips": BeforeAfter("LPIPS", 4, "", False, "perceived distance, AlexNet v0.1"),
    "cd_surface": BeforeAfter(
        "CD surface × 10³", 2, "", False, "in the views’ frame: place, scale and shape count"
    ),
    "cd_official": BeforeAfter("CD official × 10³", 2, "", False, "each shape in its own unit box"),
}
"""How each measure is shown."""


def compared(record: ReconstructionRecord, group: str, name: str) -> BeforeAfter | None:
    """A number of the record; None when it was not measured."""
    before, after = record.measures.groups.get(group, ({}, {})) if record.measures else ({}, {})
    if name not in after:
        return None
    shown = MEASURES.get(name, BeforeAfter(name.replace("_", " "), 4, "", True))
    return replace(shown, before=before.get(name, math.nan), after=after[name])


def headline(record: ReconstructionRecord) -> tuple[str, str]:
    """The outcome in two words, and its tone."""
    if not record.changed:
        return "Kept as first made", "idle"
    if record.displacement < _STILL * record.size:
        return ("Colours calibrated" if record.recoloured else "Hardly changed"), "idle"
    fit = compared(record, "inputs", "symmetric_iou")
    worse = fit is not None and fit.tone == "bad"
    return ("Refined, masks fit worse", "unsure") if worse else ("Refined", "good")


def unusual_options(record: ReconstructionRecord) -> dict[str, str]:
    """The branch's options that differ from the defaults."""
    return BranchOptions(**record.options).changed()


def steps(record: ReconstructionRecord) -> list[Step]:
    """Reading, the first reconstruction, each stage of the branch, measuring and drawing, in order."""
    first = record.result.g0.status

    def own(name: str, found: str = "", how: State = "done") -> Step:
        done = name in record.timings
        return Step(name, how if done else "skipped", record.timings.get(name), found)

    branch = (
        Step(s.stage.replace("_", " "), STATES[s.status], s.seconds, f"{s.status}: {s.reason}")
        for s in record.result.stages
    )
    read, made = (
        count(len(record.views), "view"),
        own("reconstruct", first, "done" if first == "ok" else "warn"),
    )
    return [own("read", read), made, *branch, own("measure"), own("draw")]


def summary_line(record: ReconstructionRecord) -> str:
    """The outcome on one line, for the terminal."""
    parts = [headline(record)[0].lower()]
    for group, name, where in (
        ("inputs", "symmetric_iou", ""),
        ("held_out", "psnr", " held out"),
        ("truth", "cd_surface", ""),
    ):
        number = compared(record, group, name)
        if number is not None:
            parts.append(f"{number.label} {number.told}{where}")
    return f"{record.name}: {', '.join(parts)}"
