"""The perception suite from end to end: rows, resuming, and numbers that find a perceiver's errors."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from gvla2.commands.bench import run_bench
from gvla2.component import Component, ComponentConfig
from gvla2.errors import ConfigurationError, PerceptionError
from gvla2.evaluation.config import PerceptionBench, ResultsConfig
from gvla2.evaluation.suites.perception import (
    LayoutUnit,
    measure_layout,
)
from gvla2.plugins.discovery import Plugin
from gvla2.plugins.registry import Offer, Registry

PLUGIN = Plugin("tests")


@dataclass
class OwnConfig(ComponentConfig):
    """Options of perceivers made for a test."""

    shift: float = 0.0


class Half:
    """The true scene without its first object, all of it shifted."""

    def __init__(self, config: OwnConfig, robot) -> None:
        self._shift, self._robot = config.shift, robot

    def perceive(self, observation, instruction, workspace):
        scene = self._robot.true_scene()
        moved = []
        for obj in scene.objects[1:]:
            pose = obj.world_from_object.copy()
            pose[0, 3] += self._shift
            moved.append(replace(obj, world_from_object=pose))
        return replace(scene, objects=tuple(moved))


class Blind:
    def perceive(self, observation, instruction, workspace):
        raise PerceptionError("Too dark.")


@pytest.fixture(scope="module")
def parts(registry: Registry) -> Registry:
    """The installed components, and perceivers that are wrong in a known way."""
    own = [
        Component("half", OwnConfig, lambda config, robot: Half(config, robot), needs=("robot",)),
        Component("blind", OwnConfig, lambda config: Blind()),
    ]
    offers = {kind: dict(registry.offers(kind)) for kind in ("robot", "camera", "task")}
    offers["perceiver"] = {**registry.offers("perceiver"), **{c.name: Offer(c, PLUGIN) for c in own}}
    return Registry(offers, [PLUGIN])


def config_for(parts: Registry, tmp_path: Path, **changes) -> PerceptionBench:
    def choice(kind: str, name: str, **options):
        return parts.get(kind, name).config(name=name, **options)

    settings = {
        "tasks": ["pickup_cup"],
        "seeds": [3],
        "episodes": 1,
        "robot": choice("robot", "sapien_panda", image_size=192),
        "camera": choice("camera", "none"),
        "perceiver": choice("perceiver", "classical"),
        "results": ResultsConfig(f"sqlite:///{tmp_path / 'results.sqlite'}"),
        "workers": 1,
        "quiet": True,
    }
    return PerceptionBench(**{**settings, **changes})


def rows_of(folder: Path) -> list[dict]:
    return json.loads((folder / "result.json").read_text())["rows"]


def test_a_layout_is_a_row_with_its_objects_and_is_measured_once(parts, tmp_path):
    config = config_for(parts, tmp_path)
    assert run_bench(config, parts, tmp_path / "first") == 1
    (row,) = rows_of(tmp_path / "first")
    assert (row["status"], row["false"]) == ("ok", 0)
    assert row["seconds"] > 0
    assert {obj["object"] for obj in row["seen"]} == {"cup_0", "cup_1"}
    for obj in row["seen"]:
        assert all((obj["found"], obj["named"]))
        assert 0 <= obj["centre_mm"] < 6
        assert 0 <= obj["side_mm"] < 12
    assert "pickup_cup" in (tmp_path / "first" / "index.html").read_text()

    assert run_bench(config, parts, tmp_path / "second") == 1
    assert rows_of(tmp_path / "second") == rows_of(tmp_path / "first"), "nothing was measured again"
    run_bench(config_for(parts, tmp_path, episodes=2), parts, tmp_path / "third")
    third = rows_of(tmp_path / "third")
    assert [(row["run"], row["episode"]) for row in third] == [(1, 0), (3, 1)]


def test_a_perceivers_errors_are_measured(parts, tmp_path):
    rows = {}
    for name, perceiver in {
        "oracle": parts.get("perceiver", "oracle").config(name="oracle"),
        "half": OwnConfig(name="half", shift=0.004),
        "blind": OwnConfig(name="blind"),
    }.items():
        config = config_for(parts, tmp_path, perceiver=perceiver)
        assert run_bench(config, parts, tmp_path / name) == 1
        (rows[name],) = rows_of(tmp_path / name)
    seen = {name: {obj["object"]: obj for obj in row["seen"]} for name, row in rows.items()}
    assert seen["oracle"]["cup_0"]["centre_mm"] == pytest.approx(0, abs=1e-3)
    assert [seen["half"][name]["found"] for name in ("cup_0", "cup_1")] == [False, True]
    assert seen["half"]["cup_0"]["centre_mm"] is None
    assert seen["half"]["cup_1"]["centre_mm"] == pytest.approx(4, abs=0.5)
    assert not any(obj["found"] for obj in seen["blind"].values())
    assert "Too dark." in rows["blind"]["note"]
    assert "perceiver blind" in (tmp_path / "blind" / "report.md").read_text()


def test_a_layout_that_does_not_fit_is_a_failed_row(parts, tmp_path):
    class Crowded:
        instructions = ("do it",)

        def sample(self, rng, site, instruction=None):
            from gvla2.errors import RobotError

            raise RobotError("No room.")

    offers = {kind: dict(parts.offers(kind)) for kind in ("robot", "camera", "perceiver")}
    offers["task"] = {"crowded": Offer(Component("crowded", OwnConfig, lambda config: Crowded()), PLUGIN)}
    registry = Registry(offers, [PLUGIN])
    config = config_for(registry, tmp_path, tasks=["crowded"])
    assert run_bench(config, registry, tmp_path / "out") == 0
    (row,) = rows_of(tmp_path / "out")
    assert row["status"] == "failed: No room."
    with pytest.raises(ConfigurationError, match="has no option scale"):
        run_bench(config_for(registry, tmp_path, tasks=["crowded"], scale=1.1), registry, tmp_path / "out")


def test_a_robot_that_knows_no_truth_is_refused(parts, tmp_path):
    class Real:
        arm = None

        def close(self): ...

    unit = LayoutUnit(("key",), "", "pickup_cup", {}, 0, config_for(parts, tmp_path))
    with pytest.raises(ConfigurationError, match="knows what each pixel shows"):
        measure_layout(unit, {"robot": Real(), "task": None, "perceiver": Blind()})
