"""Rollouts in the real simulator become a data set for training."""

import json

import gymnasium
import numpy as np
import pytest

from gvla2 import cli
from gvla2.errors import ConfigurationError, OutputError
from gvla2.gym import RecordRollouts
from gvla2.record.motion import STATES

# imageio-ffmpeg leaves the pipe to its reading process to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
ENV, SMALL = "gvla2/put_block-v0", {"image_size": 48, "cameras": ["front"], "control": "joint_delta"}


def test_rollouts_are_exported(tmp_path, capsys):
    pq = pytest.importorskip("pyarrow.parquet", reason="pip install 'gvla2[export]'")
    env = RecordRollouts(gymnasium.make(ENV, max_episode_steps=4, **SMALL), tmp_path / "rollouts")
    turn = np.zeros(env.action_space.shape, np.float32)
    turn[0] = 1.0
    measured = []
    for seed in (0, 1):
        seen, info = env.reset(seed=seed)
        measured.append(seen["joints"])
        over = False
        while not over and not (seed == 1 and len(measured) == 8):  # the second is left half-way
            seen, _, terminated, truncated, _ = env.step(turn)
            measured.append(seen["joints"])
            over = terminated or truncated
    env.close()
    results = [
        json.loads((tmp_path / "rollouts" / name / "result.json").read_text())
        for name in ("000000", "000001")
    ]
    assert results[1]["instruction"] == info["instruction"]
    assert [one["success"] for one in results] == [False, False]
    with np.load(tmp_path / "rollouts" / "000000" / STATES) as kept:
        assert kept["fps"] == 20.0
        np.testing.assert_allclose(kept["joints"], measured[:5])
    assert cli.main(["export", "lerobot", str(tmp_path / "rollouts"), f"to={tmp_path / 'no'}"]) == 1
    assert "2 not succeeded" in capsys.readouterr().err
    wanted = ["export", "lerobot", str(tmp_path / "rollouts"), f"to={tmp_path / 'set'}", "only=all"]
    assert cli.main(wanted) == 0
    rows = pq.read_table(tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet")
    assert rows["episode_index"].to_pylist() == [0] * 5 + [1] * 3
    states = np.array(rows["observation.state"].to_pylist())[:, :-1]
    np.testing.assert_allclose(states, measured, atol=1e-6)


def test_what_cannot_be_kept_is_told(tmp_path):
    env = gymnasium.make(ENV, obs_mode="state", **SMALL)
    with pytest.raises(ConfigurationError, match="obs_mode='rgbd'"):
        RecordRollouts(env, tmp_path / "rollouts")
    env.close()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    env = gymnasium.make(ENV, **SMALL)
    with pytest.raises(OutputError, match="not empty"):
        RecordRollouts(env, tmp_path / "full")
    env.close()
    env = gymnasium.make(ENV, **{**SMALL, "image_size": 12})
    with pytest.raises(ConfigurationError, match="image_size=16 or more"):
        RecordRollouts(env, tmp_path / "tiny")
    env.close()
