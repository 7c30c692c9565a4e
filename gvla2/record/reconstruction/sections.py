"""What a reconstruction's page shows, worked out: rows, tones and sentences, no markup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from gvla2.reconstruction.branch import BranchOptions
from gvla2.reconstruction.contracts import StageReport
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.measures import Group
from gvla2.record.sections import Tile
from gvla2.record.wording import State, count, fixed, listing

STATES: Mapping[str, State] = {
    "applied": "done",
    "partial": "done",
    "rejected": "warn",
    "fallback": "warn",
    "skipped": "skipped",
}
"""How a stage's status looks among the marks of a run."""

MEANINGS: Mapping[str, tuple[str, str]] = {
    "prior": ("A", "A prior’s depth moves points along the cameras’ rays, where masks and views allow it."),
    "appearance": ("A", "One affine of all base colours, so that renders can be compared with the pictures."),
    "soft_hull": ("A", "Points that the masks support little move a little towards the object’s centre."),
    "axis": ("B", "Each axis is scaled and shifted a little, until the silhouettes meet the masks’ edges."),
    "fusion": ("A+B", "Positions of the two sources become one; colours, sizes and opacity stay those of A."),
    "output": ("", "The last word of the input views: what explains them worse is not kept."),
}
"""The source that each stage belongs to, and what it does."""


@dataclass(frozen=True)
class Measure:
    """How a number is told: its name, decimals, unit, and whether more is better."""

    label: str
    digits: int
    unit: str
    more_is_better: bool
    note: str = ""


MEASURES: Mapping[str, Measure] = {
    "symmetric_iou": Measure("symmetric IoU", 4, "", True, "overlap of silhouettes and masks, both ways"),
    "mask_support": Measure("mask support", 4, "", True, "mean mask value where points project"),
    "psnr": Measure("PSNR", 2, "dB", True, "colours, on white"),
    "ssim": Measure("SSIM", 4, "", True, "structure, uniform 7 × 7 window"),
    "lpips": Measure("LPIPS", 4, "", False, "perceived distance, AlexNet v0.1"),
    "cd_surface": Measure(
        "CD surface × 10³", 2, "", False, "in the views’ frame: place, scale and shape count"
    ),
    "cd_official": Measure("CD official × 10³", 2, "", False, "each shape in its own unit box"),
}
GROUPS: Mapping[Group, tuple[str, str]] = {
    "truth": ("Against the true mesh", "Chamfer distance, 100 000 points a surface"),
    "held_out": ("In held-out views", "views that nothing was made from"),
    "inputs": ("In the input views", "how well what went in is explained; no measure of quality by itself"),
}
_STAGE_LABELS = {"iou": "symmetric IoU", "support": "mask support", "colour_error": "colour error"}
_STILL = 1e-4  # mean displacement, as a share of the size, below which an object counts as not moved
_STEADY = 5e-4  # relative change below which a number counts as unchanged


@dataclass(frozen=True)
class Step:
    """One step of the strip; ``share`` of the whole time, percent."""

    name: str
    anchor: str
    state: State
    seconds: float | None
    share: float
    finding: str


@dataclass(frozen=True)
class StageRow:
    """One stage of the branch. ``numbers`` are (name, before, after), as text."""

    name: str
    source: str
    meaning: str
    status: str
    tone: str
    reason: str
    numbers: tuple[tuple[str, str, str], ...]
    seconds: float


@dataclass(frozen=True)
class MetricRow:
    """One number before and after, as text; ``change`` in percent, toned by whether it is for the better."""

    label: str
    note: str
    before: str
    after: str
    change: str
    tone: str


@dataclass(frozen=True)
class MetricGroup:
    """Numbers of one kind."""

    title: str
    note: str
    rows: tuple[MetricRow, ...]


def headline(record: ReconstructionRecord) -> tuple[str, str]:
    """The outcome in two words, and its tone."""
    if not record.changed:
        return "Kept as first made", "idle"
    if record.displacement < _STILL * record.size:
        return "Hardly moved, colours changed", "idle"
    tone = _tone("inputs", "symmetric_iou", record)
    return ("Refined", "good") if tone != "bad" else ("Refined, masks fit worse", "unsure")


def story(record: ReconstructionRecord) -> str:
    """The reconstruction in a few sentences."""
    result = record.result
    made = []
    if result.g0.gaussians is not None:
        made.append(f"{len(result.g0.gaussians):,} Gaussians")
    if result.g0.mesh is not None:
        made.append(f"a mesh of {len(result.g0.mesh.faces):,} triangles")
    by = record.choices.get("reconstructor", "the reconstructor")
    sentences = [f"From {count(len(record.views), 'view')} “{by}” made {' and '.join(made)}."]
    applied = [_spoken(s) for s in result.stages if s.status in ("applied", "partial")]
    kept_out = [_spoken(s) for s in result.stages if s.status in ("rejected", "fallback")]
    if applied:
        sentences.append(f"Applied: {listing(applied, 6)}.")
    if kept_out:
        sentences.append(f"Not taken over: {listing(kept_out, 6)}; the reasons are below.")
    if not applied and not kept_out:
        sentences.append("No stage had anything to do.")
    if record.changed and record.displacement > 0:
        share = 100 * record.displacement / record.size
        sentences.append(f"Points moved by {_percent(share)} of the object’s longest side on average.")
    return " ".join(sentences)


def unusual_options(record: ReconstructionRecord) -> dict[str, str]:
    """The branch's options that are not as they are by default."""
    usual = asdict(BranchOptions())
    told = {name: value for name, value in record.options.items() if usual.get(name) != value}
    return {name: str(value).lower() for name, value in told.items()}


def tiles(record: ReconstructionRecord) -> list[Tile]:
    """Masks, colours and ground truth."""
    masks = Tile("Silhouettes against the masks", *_told("inputs", "symmetric_iou", record))
    colours = Tile("Colours of the input views", *_told("inputs", "psnr", record))
    judges: tuple[tuple[Group, str], ...] = (("truth", "cd_surface"), ("held_out", "psnr"))
    for group, name in judges:
        if record.measures is not None and group in record.measures.groups:
            return [masks, colours, Tile(GROUPS[group][0], *_told(group, name, record))]
    note = "Nothing that was not used was given to measure by: truth=MESH, or targets=VIEWS."
    return [masks, colours, Tile("Ground truth", "None given", "idle", note)]


def steps(record: ReconstructionRecord) -> list[Step]:
    """Reading, the first reconstruction, each stage of the branch, measuring and drawing, in order."""
    anchors = {"read": "views", "reconstruct": "turn", "measure": "metrics", "draw": "renders"}
    timings = {name: value for name, value in record.timings.items() if name != "refine"}
    total = sum(timings.values()) + sum(s.seconds for s in record.result.stages) or 1.0
    found = {"read": count(len(record.views), "view"), "reconstruct": record.result.g0.status}

    def plain(name: str) -> Step:
        seconds = timings.get(name)
        state: State = "done" if seconds is not None else "skipped"
        if name == "reconstruct" and record.result.g0.status != "ok":
            state = "warn"
        share = 100 * (seconds or 0.0) / total
        return Step(name, anchors[name], state, seconds, share, found.get(name, ""))

    stages = [
        Step(
            _spoken(s),
            "stages",
            STATES[s.status],
            s.seconds,
            100 * s.seconds / total,
            f"{s.status}: {s.reason}",
        )
        for s in record.result.stages
    ]
    return [plain("read"), plain("reconstruct"), *stages, plain("measure"), plain("draw")]


def stage_rows(record: ReconstructionRecord) -> list[StageRow]:
    """Each stage of the branch with its reason and numbers."""
    tones = {
        "applied": "good",
        "partial": "good",
        "rejected": "unsure",
        "fallback": "unsure",
        "skipped": "idle",
    }
    rows = []
    for stage in record.result.stages:
        source, meaning = MEANINGS.get(stage.stage, ("", ""))
        names = dict.fromkeys((*stage.before, *stage.after))
        numbers = tuple(
            (_label(name), _short(stage.before.get(name)), _short(stage.after.get(name))) for name in names
        )
        row = StageRow(
            _spoken(stage),
            source,
            meaning,
            stage.status,
            tones[stage.status],
            _sentence(stage.reason),
            numbers,
            stage.seconds,
        )
        rows.append(row)
    return rows


def metric_groups(record: ReconstructionRecord) -> list[MetricGroup]:
    """All numbers before and after; the hardest judge first."""
    if record.measures is None:
        return []
    made = []
    for group, (title, note) in GROUPS.items():
        pair = record.measures.groups.get(group)
        if pair is None:
            continue
        rows = []
        for name, after in pair[1].items():
            how = MEASURES.get(name, Measure(name.replace("_", " "), 4, "", True))
            before = pair[0].get(name, float("nan"))
            change = _change(before, after)
            told = "" if change is None else f"{100 * change:+.2f} %".replace("-", "−")
            was, now = (f"{fixed(value, how.digits)} {how.unit}".strip() for value in (before, after))
            rows.append(MetricRow(how.label, how.note, was, now, told, _tone(group, name, record)))
        shown = f"{note}; {count(len(record.measures.held_out), 'view')}" if group == "held_out" else note
        made.append(MetricGroup(title, shown, tuple(rows)))
    return made


def summary_line(record: ReconstructionRecord) -> str:
    """The outcome on one line, for the terminal."""
    parts = [headline(record)[0].lower()]
    if record.measures is not None:
        for group, name in (("inputs", "symmetric_iou"), ("held_out", "psnr"), ("truth", "cd_surface")):
            value = _told(group, name, record)[0]
            if value:
                parts.append(f"{MEASURES[name].label} {value}{' held out' if group == 'held_out' else ''}")
    return f"{record.name}: {', '.join(parts)}"


def _told(group: Group, name: str, record: ReconstructionRecord) -> tuple[str, str, str]:
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
    return value, _tone(group, name, record), note


def _tone(group: Group, name: str, record: ReconstructionRecord) -> str:
    pair = None if record.measures is None else record.measures.groups.get(group)
    change = None if pair is None else _change(pair[0].get(name), pair[1].get(name))
    if change is None or abs(change) < _STEADY:
        return "idle"
    better = MEASURES[name].more_is_better if name in MEASURES else True
    return "good" if (change > 0) == better else "bad"


def _change(before: float | None, after: float | None) -> float | None:
    """Relative change; None when it cannot be told."""
    if (
        before is None
        or after is None
        or not math.isfinite(before)
        or not math.isfinite(after)
        or before == 0
    ):
        return None
    return (after - before) / abs(before)


def _spoken(stage: StageReport) -> str:
    return stage.stage.replace("_", " ")


def _label(name: str) -> str:
    return _STAGE_LABELS.get(name, name.replace("_", " ").replace("iou", "IoU"))


def _short(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.4f}" if abs(value) < 10 else f"{value:.1f}"


def _sentence(text: str) -> str:
    """A reason as it stands in a paragraph: with a capital and a full stop."""
    told = text.strip()
    return told[:1].upper() + told[1:] + ("" if not told or told[-1] in ".!?" else ".")


def _percent(share: float) -> str:
    return f"{share:.2f} %" if share >= 0.01 else "less than 0.01 %"
