"""A whole episode in the simulator with a planner that looks: the server in the model's place sees the front camera's
picture, finds colours in it, and answers in the published form. No weights are run.
"""

import json
import re
from contextlib import closing

import pytest

from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.planning.colours import colours_in
from tests.local_model import LocalModel, said

pytest.importorskip("sapien", reason="needs the simulator: pip install 'gvla2[sim]'")


@pytest.fixture
def pointing(eyes):
    def answer(request):
        asked = request["messages"][0]["content"]
        if isinstance(asked, str):
            colour, square = re.search(r"instruction is: .*?(\w+) block.*?(\w+) square", asked).groups()
            task = {
                "skill": "place",
                "theme": f"{colour} block",
                "goal": f"{square} square",
                "relation": "on",
            }
            return said(json.dumps(task))
        asked, _, _ = eyes.words(request).partition("Your answer")
        points = eyes.some(request, colours_in(asked)[0])
        return said("[" + ", ".join(f"({u:.3f}, {v:.3f})" for u, v in points) + "]")

    return answer


def test_an_episode_by_eye(registry, compose_run, pointing):
    with LocalModel(pointing) as model:
        overrides = (
            "planner=robopoint",
            "task=put_block",
            "memory=none",
            "perceiver=oracle",  # whatever the planner looks at
            "robot.cameras=[front]",
            "robot.video_size=16",
            "language=endpoint",
            f"language.base_url={model.url}",
            "language.model=m",
        )
        parts = build_components(compose_run(*overrides), registry)
        with closing(parts.robot), closing(parts.memory):
            record = run_episode(parts, EpisodeRequest(seed=4))
    assert record.failure is None, record.failure
    assert record.checks.passed
    assert record.success_check.relaxed, record.verdict
    assert record.plan.transcript
