"""What `gvla2 bench robot` measures when nothing is said: cameras that err, clutter, scans, strangers' sentences."""

import json
import logging
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from gvla2.errors import ConfigurationError
from gvla2.evaluation.suites.robot_conditions import Reworded, sentences_of
from gvla2.evaluation.suites.robot_design import TASKS, designs, subjects
from gvla2.evaluation.suites.robot_episodes import chosen_components
from gvla2.plugins.assembly import with_known_objects
from gvla2.testing.robot import SITE
from tests.composing import bench_config

DATA = Path(__file__).parents[2] / "data"


def test_the_default_bench_measures_what_users_meet(registry, monkeypatch, caplog):
    config = bench_config(registry, "bench_suite=robot", "arms=[off]")
    assert config.depth_noise.kind == "realistic"
    monkeypatch.setenv("GVLA2_DATA", str(DATA))
    found = subjects(config, registry)
    assert list(found) == [*TASKS, "tabletop_objects"]
    assert {task["distractors"] for task in found.values()} == {2}
    scans = {"root": str(DATA / "ycb30")}
    assert found["tabletop_objects"]["objects"] == scans
    for name, gallery in (("tabletop_objects", scans["root"]), ("open_jar", "")):
        chosen = with_known_objects(chosen_components(config, found[name]), registry)
        assert chosen["perceiver"].gallery == gallery, (
            "the sentence names the scan, so the robot has to know it"
        )
    (design,) = designs(config, registry)
    factors = design.plan[0].factors
    assert (factors["depth_noise"].split()[0], factors["distractors"], factors["sentences"]) == (
        "realistic", 2, "unseen",
    )  # fmt: skip

    monkeypatch.setenv("GVLA2_DATA", "/nowhere")
    monkeypatch.chdir("/")
    with caplog.at_level(logging.WARNING):
        without = list(subjects(config, registry))
    if without == list(TASKS):  # unless the scans lie beside the repository
        assert "No scanned objects are measured: ycb30 is not in /nowhere" in caplog.text


def test_clean_conditions_are_one_option_and_each_is_one_by_itself(registry):
    clean = bench_config(registry, "bench_suite=robot", "conditions=clean", "arms=[off]")
    assert clean.depth_noise.kind == "none"
    assert set(map(str, subjects(clean, registry).values())) == {str({"name": task}) for task in TASKS}
    factors = designs(clean, registry)[0].plan[0].factors
    assert not {"distractors", "sentences"} & factors.keys(), "as rows that were measured before"
    mixed = bench_config(
        registry, "bench_suite=robot", "tasks=[open_jar,lamp_on]", "+task_options.lamp_on.distractors=5"
    )
    assert [task["distractors"] for task in subjects(mixed, registry).values()] == [2, 5]
    scaled = bench_config(registry, "bench_suite=robot", "scale=0.8", f"scans={DATA / 'ycb30'}")
    assert list(subjects(scaled, registry)) == list(TASKS), "scans are as large as they are"
    nowhere = bench_config(registry, "bench_suite=robot", "scans=/nowhere")
    with pytest.raises(ConfigurationError, match="there is no folder /nowhere"):
        subjects(nowhere, registry)


@pytest.mark.parametrize("name", TASKS)
def test_strangers_sentences_change_the_words_and_nothing_else(registry, name: str):
    config = bench_config(registry, "bench_suite=robot")
    task, said = registry.build({"task": {"name": name}}, "task"), sentences_of(config, name)
    assert said
    assert not {*said} & {*task.instructions}
    other, changed = Reworded(task, said), 0
    for seed in range(6):
        plain, asked = (one.sample(np.random.default_rng(seed), SITE) for one in (task, other))
        assert str(asked.layout) == str(plain.layout)
        assert "{" not in asked.instruction
        changed += asked.instruction != plain.instruction
        given = other.sample(np.random.default_rng(seed), SITE, "lift it")
        assert given.instruction == "lift it"
    assert changed


def test_nobody_developed_on_the_unseen_sentences():
    unseen = json.loads(files("gvla2.evaluation").joinpath("sentences.json").read_text("utf-8"))
    for kind in ("development", "traps"):
        known = json.loads((DATA.parent / "benchmarks" / "sentences" / f"{kind}.json").read_text())
        assert not {row["sentence"] for row in known} & {one for some in unseen.values() for one in some}
