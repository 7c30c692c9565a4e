"""The contents of a reconstruction's page: rows, tones and sentences, no markup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import cast

from gvla2.reconstruction.branch import BranchOptions
from gvla2.reconstruction.contracts import StageReport
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.measures import Group
from gvla2.record.reconstruction.numbers import GROUPS, MEASURES, told, tone_of
from gvla2.record.sections import Step, share
from gvla2.record.text import count
from gvla2.record.wording import State

STATES: Mapping[str, State] = {
    "applied": "done",
    "partial": "done",
    "rejected": "warn",
    "fallback": "warn",
    "skipped": "skipped",
}
"""The mark of each stage status."""

MEANINGS: Mapping[str, tuple[str, str]] = {
    "drift": ("", "Drift of the whole object is corrected first: a prior moves only the sides it sees."),
    "prior": (
        "A",
        "A prior’s depth, corrected view by view, makes a new surface with masks and G0 in one volume.",
    ),
    "appearance": ("A", "One affine of all base colours, so that renders can be compared with the pictures."),
    "soft_hull": ("A", "Points that the masks support little move a little towards the object’s centre."),
    "axis": ("B", "Each axis is scaled and shifted a little, until the silhouettes meet the masks’ edges."),
    "fusion": ("A+B", "Positions of the two sources become one; colours, sizes and opacity stay those of A."),
    "inset": ("", "Gaussians move inside their surface until their footprint ends at the masks' edges."),
    "output": ("", "Final check against the input views: a stage that fits them worse is undone."),
}
"""The source of each stage, and what it does."""


_STAGE_LABELS = {"iou": "symmetric IoU", "support": "mask support", "colour_error": "colour error"}
_STILL = 1e-4  # mean displacement, as a share of the size, below which an object counts as unmoved


def headline(record: ReconstructionRecord) -> tuple[str, str]:
    """The outcome in two words, and its tone."""
    if not record.changed:
        return "Kept as first made", "idle"
    if record.displacement < _STILL * record.size:
        return ("Colours calibrated" if record.recoloured else "Hardly changed"), "idle"
    tone = tone_of("inputs", "symmetric_iou", record)
    return ("Refined", "good") if tone != "bad" else ("Refined, masks fit worse", "unsure")


def unusual_options(record: ReconstructionRecord) -> dict[str, str]:
    """The branch's options that differ from the defaults."""
    usual = asdict(BranchOptions())
    told = {name: value for name, value in record.options.items() if usual.get(name) != value}
    return {name: str(value).lower() for name, value in told.items()}


def tiles(record: ReconstructionRecord) -> list[tuple[str, str, str, str]]:
    """Masks, colours and ground truth: each with title, value, tone and note."""
    masks = ("Silhouettes against the masks", *told("inputs", "symmetric_iou", record))
    colours = ("Colours of the input views", *told("inputs", "psnr", record))
    judges: tuple[tuple[Group, str], ...] = (("truth", "cd_surface"), ("held_out", "psnr"))
    for group, name in judges:
        if record.measures is not None and group in record.measures.groups:
            return [masks, colours, (GROUPS[group][0], *told(group, name, record))]
    note = "No independent data was given: truth=MESH, or targets=VIEWS."
    return [masks, colours, ("Ground truth", "None given", "idle", note)]


def steps(record: ReconstructionRecord) -> list[Step]:
    """Reading, the first reconstruction, each stage of the branch, measuring and drawing, in order."""
    anchors = {"read": "views", "reconstruct": "turn", "measure": "metrics", "draw": "renders"}
    timings = {name: value for name, value in record.timings.items() if name != "refine"}
    total = sum(timings.values()) + sum(s.seconds for s in record.result.stages) or 1.0
    found = {"read": count(len(record.views), "view"), "reconstruct": record.result.g0.status}

    def own(name: str) -> Step:
        made = "warn" if name == "reconstruct" and record.result.g0.status != "ok" else "done"
        state = cast(State, made if name in timings else "skipped")
        part = share(timings.get(name), total)
        return Step(name, anchors[name], state, timings.get(name), part, found.get(name, ""))

    stages = [
        Step(
            _spoken(s),
            "stages",
            STATES[s.status],
            s.seconds,
            share(s.seconds, total),
            f"{s.status}: {s.reason}",
        )
        for s in record.result.stages
    ]
    return [own("read"), own("reconstruct"), *stages, own("measure"), own("draw")]


def stage_numbers(stage: StageReport) -> list[tuple[str, str, str]]:
    """(name, before, after) of each number of a stage, as text."""
    names = dict.fromkeys((*stage.before, *stage.after))
    return [(_label(name), _short(stage.before.get(name)), _short(stage.after.get(name))) for name in names]


def summary_line(record: ReconstructionRecord) -> str:
    """The outcome on one line, for the terminal."""
    parts = [headline(record)[0].lower()]
    if record.measures is not None:
        judged: tuple[tuple[Group, str], ...] = (
            ("inputs", "symmetric_iou"),
            ("held_out", "psnr"),
            ("truth", "cd_surface"),
        )
        for group, name in judged:
            value = told(group, name, record)[0]
            if value:
                parts.append(f"{MEASURES[name].label} {value}{' held out' if group == 'held_out' else ''}")
    return f"{record.name}: {', '.join(parts)}"


def _spoken(stage: StageReport) -> str:
    return stage.stage.replace("_", " ")


def _label(name: str) -> str:
    return _STAGE_LABELS.get(name, name.replace("_", " ").replace("iou", "IoU"))


def _short(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.4f}" if abs(value) < 10 else f"{value:.1f}"


def sentence(text: str) -> str:
    """A reason as a sentence: with a capital and a full stop."""
    told = text.strip()
    return told[:1].upper() + told[1:] + ("" if not told or told[-1] in ".!?" else ".")
