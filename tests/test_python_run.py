"""One episode from Python, and where a result says it comes from."""

import json
from pathlib import Path

import numpy as np
import pytest

import gvla2
from gvla2.commands.hydra_job import as_overrides, composed
from gvla2.record.origin import Origin, changed_options


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
    ],
)
def test_wrong_options_are_errors_of_ours(options: dict[str, object], message: str):
    with pytest.raises(gvla2.Gvla2Error) as error:
        gvla2.run(**options)
    assert message in str(error.value)


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
