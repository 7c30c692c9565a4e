"""Measuring one layout: lay it out, look, perceive, compare with the ground-truth pixels."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gvla2.errors import ConfigurationError, Gvla2Error, PerceptionError
from gvla2.evaluation.perception.overlay import overlay_sheet
from gvla2.evaluation.perception.scoring import SceneScore, ThingScore, score
from gvla2.evaluation.perception.truth import Segmented, true_things
from gvla2.evaluation.perception.twins import TwinTask, with_twins
from gvla2.evaluation.results import Cell, cell_key
from gvla2.geometry.views import Observation
from gvla2.planning.asking import perceive
from gvla2.planning.contracts import Perceiver, Planner, PlanRequest
from gvla2.planning.scene import Scene
from gvla2.robot.backend import RobotBackend
from gvla2.robot.depth_noise import apply_noise
from gvla2.robot.options import DepthNoise
from gvla2.robot.task import Task

log = logging.getLogger(__name__)

SUITE = "perception"
VERSION = 2
"""Version of the measurement: rows of another version are measured again."""

WHOLE = 0.8
"""Overlap above which a thing without a second piece counts as seen whole."""

SCENE = "scene"
"""The ``object`` and ``kind`` of a whole layout's row."""


@dataclass(frozen=True)
class Bench:
    """The components that measure a layout; with ``planner`` None abstentions are not measured."""

    robot: RobotBackend
    task: Task
    perceiver: Perceiver
    planner: Planner | None
    noise: DepthNoise


@dataclass(frozen=True)
class WantedLayout:
    """One layout to measure: the key and the factors of its row, the seed of the layout, whether to draw it."""

    key: str
    factors: Mapping[str, str | int]
    layout: int
    pictured: bool = False


@dataclass(frozen=True)
class MeasuredLayout:
    """The rows of a layout, the scene's first, then one per true thing; ``picture`` is PNG, if requested."""

    cells: tuple[Cell, ...]
    picture: bytes | None = None


def layout_seed(seed: int, episode: int) -> int:
    """The seed of a layout: a seed's first layout is that of ``gvla2 run seed=...``; no two seeds share any."""
    return seed + 1_000_000 * episode


def measure(wanted: WantedLayout, bench: Bench) -> MeasuredLayout:
    """All rows of a layout; a layout that cannot be measured is a row that says why.

    Raises :class:`ConfigurationError` for a robot without ground truth.
    """
    if not isinstance(bench.robot, Segmented):
        raise ConfigurationError(
            "suite=perception needs a simulated robot that knows what each pixel shows, such as robot=sapien_panda."
        )
    try:
        return _measure(wanted, bench, bench.robot)
    except ConfigurationError:
        raise
    except Exception as error:  # a perceiver's crash is its layout's, not the bench's
        log.info("A layout could not be measured.", exc_info=True)
        why = str(error) if isinstance(error, Gvla2Error) else f"crashed, {type(error).__name__}: {error}"
        return MeasuredLayout((_scene_row(wanted, {}, {"status": f"failed: {why}", "objects": []}),))


def _measure(wanted: WantedLayout, bench: Bench, truth: Segmented) -> MeasuredLayout:
    instance = bench.robot.reset(bench.task, wanted.layout)
    if instance is None:
        raise ConfigurationError("suite=perception needs a simulated robot, which lays out tasks.")
    # The truth is what ideal cameras would show.
    clear = bench.robot.observe()
    observation = _noisy(clear, bench, wanted.layout)
    things = true_things(truth, clear, instance.layout)
    started, worked = time.perf_counter(), time.process_time()
    scene, note = _perceive(bench, observation, instance.instruction)
    measures: dict[str, float | None] = {
        "seconds": time.perf_counter() - started,
        "cpu_seconds": time.process_time() - worked,
    }
    result = score(things, scene, clear)
    picture = overlay_sheet(clear, result, scene) if wanted.pictured else None
    twins = with_twins(instance)
    if twins is not None and bench.planner is not None:
        measures["abstained"] = float(_abstains(bench, bench.planner, wanted.layout))
    cut = {stray.piece_of for stray in result.strays}
    rows = [_thing_row(wanted, one, one.thing.name in cut) for one in result.things]
    measures |= {"found": result.found, "false": float(len(result.strays))}
    notes = {
        "status": "ok",
        "instruction": instance.instruction,
        "objects": [row.key for row in rows],
        "strays": _strays(result, scene),
        "note": note,
    }
    return MeasuredLayout((_scene_row(wanted, measures, notes), *rows), picture)


def _noisy(clear: Observation, bench: Bench, layout: int) -> Observation:
    """The cameras' views with the noise of an episode of that seed."""
    return apply_noise(clear, bench.noise, np.random.default_rng([layout, 0]), layout)


def _perceive(bench: Bench, observation: Observation, instruction: str) -> tuple[Scene, str]:
    """The scene; an empty one with the reason if the perceiver sees none."""
    workspace = bench.robot.arm.workspace
    try:
        return perceive(bench.perceiver, observation, instruction, workspace, "The perceiver"), ""
    except PerceptionError as error:
        return Scene((), 0.0, workspace), f"Nothing was perceived: {error}"


def _abstains(bench: Bench, planner: Planner, layout: int) -> bool:
    """Whether perceiver and planner together refuse a sentence that fits two things."""
    instance = bench.robot.reset(TwinTask(bench.task), layout)
    assert instance is not None
    observation = _noisy(bench.robot.observe(), bench, layout)
    scene, note = _perceive(bench, observation, instance.instruction)
    if note:
        return True
    request = PlanRequest(
        instance.instruction,
        scene,
        bench.robot.arm,
        observation.world_from_tcp,
        observation.joints,
        observation,
    )
    return planner.plan(request).abstention is not None


def _strays(result: SceneScore, scene: Scene) -> list[str]:
    """A line for each false object."""
    lines = []
    for stray in result.strays:
        what = f"a piece of {stray.piece_of}" if stray.piece_of else "nothing that is there"
        lines.append(f"{scene.objects[stray.index].label}: {what}")
    return lines


def _scene_row(wanted: WantedLayout, measures: Mapping[str, float | None], notes: Mapping[str, Any]) -> Cell:
    return Cell(wanted.key, {**wanted.factors, "object": SCENE, "kind": SCENE}, dict(measures), dict(notes))


def _thing_row(wanted: WantedLayout, one: ThingScore, cut: bool) -> Cell:
    thing, words = one.thing, one.words
    measures: dict[str, float | None] = {
        "found": float(one.match.found),
        "iou": one.match.iou,
        "whole": float(one.match.iou >= WHOLE and not cut),
        "label": _number(words.label),
        "colour": _number(words.colour),
        "noun": _number(words.noun),
        "centre_mm": one.centre_mm,
        "extent_mm": one.extent_mm,
        "pixels": float(thing.whole.sum()),
    }
    for axis, error in zip("xyz", one.extents_mm, strict=True):
        measures[f"extent_{axis}_mm"] = error
    factors = {**wanted.factors, "object": thing.name, "kind": thing.kind}
    notes = {"status": "ok", "true": thing.label, "perceived": one.perceived, "part": thing.part}
    return Cell(object_key(wanted.key, thing.name), factors, measures, notes)


def object_key(scene_key: str, name: str) -> str:
    """The key of a thing's row, by the key of its scene's."""
    return cell_key(SUITE, scene_key, name)


def _number(value: bool | None) -> float | None:
    return None if value is None else float(value)
