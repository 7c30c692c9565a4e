"""One episode from Python, and where a result says it comes from."""

import json
from pathlib import Path

import numpy as np
import pytest

import gvla2
from gvla2.commands.hydra_job import as_overrides, composed
from gvla2.record.origin import Origin, changed_options
from gvla2.record.wording import summary_line


def test_an_episode_from_python_gives_its_record_and_its_folder(tmp_path: Path):
    options = {"planner.lift_height": 0.22, "robot.image_size": 128, "robot.video_size": 16}
    record = gvla2.run(tmp_path, task="push_block", instruction="push it, please", memory="none", **options)
    assert record.instruction == "push it, please"
    assert record.verdict is not None
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["origin"]["options"] == options
    assert result["origin"]["version"] == gvla2.__version__
    page = (tmp_path / "index.html").read_text()
    assert "<span>planner.lift_height</span>0.22" in page
    assert "<span>agent</span>" not in page


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"taks": "push_block"}, "Did you mean 'task'?"),
        ({"task": "push_blok"}, "Did you mean 'push_block'?"),
        ({"planner.trys": 3}, "Did you mean 'tries'?"),
        ({"episodes": 2}, "runs one episode"),
        ({"planner": None}, "No planner named 'none'"),
    ],
)
def test_wrong_options_are_errors_of_ours(options: dict[str, object], message: str):
    with pytest.raises(gvla2.Gvla2Error) as error:
        gvla2.run(**options)
    assert message in str(error.value)


@pytest.mark.parametrize("word", ["push_block", "task=push_block"])
def test_a_task_in_place_of_the_folder_is_refused(word: str):
    with pytest.raises(gvla2.Gvla2Error, match=f"a folder for its files, not '{word}'"):
        gvla2.run(word)


def test_the_tasks_own_goal_is_checked_whatever_the_sentence_asks():
    options = {"perceiver": "oracle", "memory": None, "robot.image_size": 64}
    record = gvla2.run(task="put_block", instruction="push the block 3 cm to the left", **options)
    assert record.choices["memory"] == "none"
    assert record.failure.message.endswith("not what a sentence of your own asks.")
    assert "success check: relaxed no, strict no" in summary_line(record)
    assert "instruction='push the block 3 cm to the left'" in repr(record)
    assert len(repr(record)) < 1000


def test_every_changed_option_is_named_and_of_a_preset_people_see_its_name():
    config, _ = composed("run", ["depth_noise=realistic", "task.distractors=2", "seed=4"])
    options = dict(changed_options(config))
    assert options["task.distractors"] == 2
    assert options["depth_noise.kind"] == "realistic"
    assert "seed" not in options
    shown = Origin(options=options).shown
    assert set(shown) == {"depth_noise.kind", "task.distractors"}


@pytest.mark.parametrize(
    ("option", "value"),
    [("seed", 0), ("seed", 1), ("planner.explore", 0.0), ("planner.lift_height", np.float64(0.25)),
     ("quiet", False), ("instruction", "it's #1, {please}"), ("instruction", None),
     ("robot.cameras", ["front", "wrist"])],
)  # fmt: skip
def test_python_values_arrive_as_they_are(option: str, value: object):
    config, _ = composed("run", as_overrides({option: value}))
    for name in option.split("."):
        config = getattr(config, name)
    assert config == value
    assert isinstance(config, bool) == isinstance(value, bool)
