"""Data sets of LeRobot back in the environment."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from gvla2.errors import Gvla2Error, reading
from gvla2.gym.env import TaskEnv


def replay(
    dataset: str | Path, episode: int = 0, *, task: str = "", seed: int | None = None, **options: Any
) -> bool:
    """Whether an episode's actions reach the goal once more, in the layout that they were recorded in.

    ``dataset`` is a folder in LeRobot's layout v3.0 whose actions are joints and the width between the fingers. Task
    and seed are those that `gvla2 export` notes, or given for others' data; ``options`` are further ones of
    :class:`~gvla2.gym.env.TaskEnv`. Raises :class:`Gvla2Error` for a folder that is no data set, an episode that it
    lacks, and one without task and seed.
    """
    import pyarrow.parquet as pq

    with reading("a data set of LeRobot", dataset, Gvla2Error):
        info = json.loads((Path(dataset) / "meta/info.json").read_text())
        rows = pq.read_table(Path(dataset) / "meta/episodes").to_pylist()
        mine = [("episode_index", "=", episode)]
        actions = pq.read_table(Path(dataset) / "data", columns=["action"], filters=mine)[
            "action"
        ].to_pylist()
    row = next((one for one in rows if one["episode_index"] == episode), None)
    if row is None:
        raise Gvla2Error(f"The data set '{dataset}' has {len(rows)} episodes; there is no episode {episode}.")
    task, seed = task or row.get("environment", ""), row.get("seed", -1) if seed is None else seed
    if not task or seed < 0:
        raise Gvla2Error(
            f"Episode {episode} of '{dataset}' doesn't say its task and seed: give task= and seed=."
        )
    mode: dict[str, Any] = {"control": "joint_position", "robot": info["robot_type"]}
    env = TaskEnv(task, **(mode | options))
    try:
        env.reset(seed=seed)
        steps = (env.actions.step(action) for action in actions)  # no pictures
        return any(getattr(done, options.get("profile", "relaxed")) for done in steps)
    finally:
        env.close()
