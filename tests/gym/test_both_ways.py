"""Demonstrations become a data set, the data set drives the robot again, and so does a policy, in closed loop."""

from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gvla2
from gvla2 import Component, ComponentConfig, cli, hookimpl
from gvla2.errors import Gvla2Error
from tests.pages import plugin_of

pytest.importorskip("gymnasium", reason="pip install 'gvla2[gym]'")
pq = pytest.importorskip("pyarrow.parquet", reason="pip install 'gvla2[export]'")
pytest.importorskip("sapien", reason="pip install 'gvla2[sim]'")

# imageio-ffmpeg leaves the pipe to its reading process to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")

TASK = {"task": "put_block", "seed": 0, "memory": "none", "perceiver": "oracle"}
FILM = {"robot.video_size": 32, "robot.video_fps": 20, "robot.video_cameras": ["front", "wrist"]}


@dataclass
class PlayedConfig(ComponentConfig):
    """Options of a policy that plays the actions of a data set for some seconds."""

    folder: str = ""
    seconds: float = 20.0


class Played:
    rate, source = 20.0, "played"

    def __init__(self, config: PlayedConfig) -> None:
        self.seconds = config.seconds
        self.actions = pq.read_table(Path(config.folder) / "data")["action"].to_pylist()

    def begin(self, instruction: str) -> None:
        assert instruction
        self.left = list(self.actions)

    def act(self, observation: object) -> np.ndarray:
        return np.array(self.left.pop(0) if len(self.left) > 1 else self.left[0])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("both")
    record = gvla2.run(folder / "run", **TASK, **FILM)
    assert record.success_check.relaxed
    assert cli.main(["export", "lerobot", str(folder / "run"), f"to={folder / 'set'}"]) == 0
    return folder / "set"


def test_the_actions_of_a_data_set_reach_the_goal_again(dataset: Path):
    from gvla2.gym import replay

    assert replay(dataset)
    assert not replay(dataset, seed=5), "another layout"
    with pytest.raises(Gvla2Error, match="no episode 3"):
        replay(dataset, 3)


def test_so_do_those_of_a_simulator_of_ones_own(tmp_path: Path):
    from gvla2.gym import replay

    with plugin_of("your_simulator.md", 0):
        options = {"robot": "toy", "task": "toy/lift", "memory": "none", "robot.video_fps": 20}
        assert gvla2.run(tmp_path / "run", **options).success_check.relaxed
        assert cli.main(["export", "lerobot", str(tmp_path), f"to={tmp_path / 'set'}"]) == 0
        assert replay(tmp_path / "set")


def test_a_policy_drives_until_the_goal_is_reached_and_the_record_says_how(dataset: Path, tmp_path: Path):
    component = Component("played", PlayedConfig, Played, summary="plays a data set")
    name = gvla2.register(SimpleNamespace(gvla2_policies=hookimpl(lambda: [component])), "played")
    played = {"policy": "played", "policy.folder": str(dataset)}
    played |= {"robot.cameras": ["front"], "robot.image_size": 32}
    record = gvla2.run(tmp_path, **TASK, **played)
    other = gvla2.run(**TASK, **played, **{"policy.seconds": 1.0})
    gvla2.unregister(name)
    assert record.success_check.relaxed
    assert (record.failure, record.plan, record.verdict) == (None, None, None)
    assert record.rollout.source == "played"
    assert 20 < record.rollout.steps < 400
    assert (tmp_path / "episode.mp4").is_file()
    assert (other.failure.kind, other.rollout.steps) == ("goal_not_reached", 20)
