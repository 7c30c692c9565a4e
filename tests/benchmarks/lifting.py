"""Slow: how many scanned objects are lifted, one at a time on the table or among others, with true perception or any.

    python tests/benchmarks/lifting.py FOLDER [--names a,b] [--poses upright,fallen] [--seeds 0,1] [--count 1]
        [--perceiver oracle] [--gallery FOLDER] [--sentence "lift the object"] [--replan 0] [--out FILE]

Prints one line an episode: the narrowest side, how many holds the planner found and how many of those fit (nothing but
the check's limit of tries speaks against them), whether the object was lifted, and why not. Then the shares: of all, of
the objects whose narrowest side is below 75 mm, and of those of them where a hold fits; and those that failed. With
``--count`` 5, five of the objects lie there, a seed a scene, and the sentence asks for one. A perceiver that does not
know names wants a gallery of the objects, or a sentence without names. Episodes that FILE has are not run again.
"""

from __future__ import annotations

import argparse
import json
import logging
import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hydra import compose, initialize_config_module
from omegaconf import OmegaConf

from gvla2.commands.hydra_job import schemas
from gvla2.commands.run import build_components
from gvla2.episode.loop import Components, EpisodeRequest, run_episode
from gvla2.episode.record import EpisodeRecord
from gvla2.plugins.hydra_config import register
from gvla2.plugins.registry import Registry, load_plugins
from gvla2.robot.scan import mesh_library, read_scan, spoken

NARROW = 0.075


@dataclass(frozen=True)
class Case:
    """One episode: what may lie there, how, and who looks."""

    names: tuple[str, ...]
    pose: str
    seed: int
    count: int
    perceiver: str
    gallery: str
    sentence: str
    replan: int

    def key(self) -> str:
        """By which its row is known again."""
        who = self.names[0] if self.count == 1 else f"{self.count} of {len(self.names)}"
        how = f"{' gallery' * bool(self.gallery)}{' unnamed' * bool(self.sentence)}"
        return f"{who} {self.pose} {self.seed} {self.perceiver}{how} {self.replan}"


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--names", default="")
    parser.add_argument("--poses", default="upright,fallen")
    parser.add_argument("--seeds", default="0,1")
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--perceiver", default="oracle")
    parser.add_argument("--gallery", default="")
    parser.add_argument("--sentence", default="")
    parser.add_argument("--replan", type=int, default=0)
    parser.add_argument("--out", default="")
    options = parser.parse_args()
    logging.disable(logging.WARNING)
    registry = load_plugins()
    library = mesh_library(options.folder, options.names.split(",") if options.names else [])
    register(registry, schemas())
    narrow = {name: min(read_scan(path).size) for name, path in library.items()}
    groups = [tuple(library)] if options.count > 1 else [(name,) for name in library]
    how = (options.count, options.perceiver, options.gallery, options.sentence, options.replan)
    cases = [
        Case(group, pose, int(seed), *how)
        for group in groups
        for pose in options.poses.split(",")
        for seed in options.seeds.split(",")
    ]
    kept = Path(options.out) if options.out else None
    lines = kept.read_text().splitlines() if kept is not None and kept.is_file() else []
    known = {row["key"]: row for row in map(json.loads, lines)}
    rows = []
    for case in cases:
        row = known.get(case.key())
        if row is None:
            row = {"key": case.key(), **_episode(registry, case, options.folder)}
            row["narrow"] = round(narrow[row["name"]], 4)
            print(json.dumps(row), flush=True)
            if kept is not None:
                with kept.open("a") as file:
                    file.write(json.dumps(row) + "\n")
        rows.append(row)
    _summarise(rows)


def _summarise(rows: list[dict]) -> None:
    narrow = [row for row in rows if row["narrow"] < NARROW]
    for what, of in (
        ("all", rows),
        ("narrow", narrow),
        ("narrow, a hold fits", [r for r in narrow if r["fit"]]),
    ):
        for profile in ("relaxed", "strict"):
            lifted = sum(r[profile] for r in of)
            print(f"{what} {profile}: {lifted} of {len(of)}, {100 * lifted / max(1, len(of)):.0f} %")
    print("no hold fits:", sum(not r["fit"] for r in rows))
    for row in rows:
        if not row["strict"]:
            print(f"{row['key']}: {'wide, ' * (row['narrow'] >= NARROW)}{row['why']} | {row['how']}")
    print(f"median planning {np.median([r['planning_s'] for r in rows]):.2f} s")


def _parts(case: Case, folder: str, registry: Registry) -> Components:
    with initialize_config_module("gvla2.conf", version_base="1.3"):
        asked = [f"task.objects.root={folder}", f"task.objects.names=[{','.join(case.names)}]"]
        asked += [f"task.objects.pose={case.pose}", f"task.objects.count={case.count}"]
        choices = ["memory=none", "task=tabletop_objects", f"perceiver={case.perceiver}", *asked]
        choices += [f"perceiver.gallery={case.gallery}"] if case.gallery else []
        config = OmegaConf.to_object(compose("run", overrides=choices))
    return build_components(config, registry)


def _episode(registry: Registry, case: Case, folder: str) -> dict:
    parts = _parts(case, folder, registry)
    started = time.perf_counter()
    with closing(parts.robot), closing(parts.memory):
        request = EpisodeRequest(case.seed, case.sentence or None, replan=case.replan)
        record = run_episode(parts, request)
        return {**_row(record, case), "seconds": round(time.perf_counter() - started, 1)}


def _row(record: EpisodeRecord, case: Case) -> dict:
    """The row of an episode; of several attempts the last counts."""
    judged, plan, report = record.success_check, record.plan, record.report
    tried = () if plan is None else plan.candidates
    fit = [c for c in tried if not c.rejected or c.rejected.startswith("not checked")]
    if report is not None and report.abort is not None:
        why = f"{report.abort.abort}: {report.abort.message}"
    elif plan is not None and plan.abstention is not None:
        why = plan.abstention.message
    elif record.failure is not None:
        why = f"{record.failure.stage}: {record.failure.message}"
    else:
        why = "" if judged and judged.strict else "not high enough, or not in the hand"
    best = [c.description for c in tried if not c.rejected]
    said = [n for n in case.names if spoken(n) in record.instruction]
    return {
        "name": max(said, key=len, default=case.names[0]),
        "relaxed": bool(judged and judged.relaxed),
        "strict": bool(judged and judged.strict),
        "holds": len(tried),
        "fit": len(fit),
        "attempts": len(record.attempts) + 1,
        "planning_s": round(record.timings.get("plan", 0.0), 2),
        "why": why[:240],
        "how": best[0][:160] if best else f"none of {len(tried)}",
    }


if __name__ == "__main__":
    main()
