"""The contents of a reconstruction's page: rows, tones and sentences, no markup."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

from gvla2.reconstruction.branch import BranchOptions
from gvla2.reconstruction.contracts import StageReport
from gvla2.record.reconstruction.contents import ReconstructionRecord
from gvla2.record.reconstruction.numbers import compared
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

_STILL = 1e-4  # mean displacement, as a share of the size, below which an object counts as unmoved


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
    usual = asdict(BranchOptions())
    told = {name: value for name, value in record.options.items() if usual.get(name) != value}
    return {name: str(value).lower() for name, value in told.items()}


def steps(record: ReconstructionRecord) -> list[Step]:
    """Reading, the first reconstruction, each stage of the branch, measuring and drawing, in order."""
    timings = {name: value for name, value in record.timings.items() if name != "refine"}
    total = sum(timings.values()) + sum(s.seconds for s in record.result.stages) or 1.0
    found = {"read": count(len(record.views), "view"), "reconstruct": record.result.g0.status}

    def own(name: str) -> Step:
        made: State = "warn" if name == "reconstruct" and record.result.g0.status != "ok" else "done"
        state: State = made if name in timings else "skipped"
        return Step(name, state, timings.get(name), share(timings.get(name), total), found.get(name, ""))

    def of_branch(stage: StageReport) -> Step:
        told = f"{stage.status}: {stage.reason}"
        name, part = stage.stage.replace("_", " "), share(stage.seconds, total)
        return Step(name, STATES[stage.status], stage.seconds, part, told)

    stages = map(of_branch, record.result.stages)
    return [own("read"), own("reconstruct"), *stages, own("measure"), own("draw")]


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
            parts.append(f"{number.style.label} {number.told}{where}")
    return f"{record.name}: {', '.join(parts)}"
