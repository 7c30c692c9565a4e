"""Whole episodes in the simulator with planners that look: the server in the model's place sees the front camera's
picture, finds colours in it, and answers in the published form. No weights are run.
"""

import re
from contextlib import closing

import pytest

from gvla2.commands.run import build_components
from gvla2.episode.loop import EpisodeRequest, run_episode
from gvla2.planning.colours import colours_in
from gvla2.testing.language import LocalModel, said

pytest.importorskip("sapien", reason="needs the simulator: pip install 'gvla2[sim]'")

CLOSE, OPEN = "<action>Close Gripper</action>", "<action>Open Gripper</action>"


@pytest.fixture
def drawing(eyes):
    def above(point, by):
        return point[0], max(0.0, point[1] - by)

    def answer(request):
        found = re.search(r"<quest>(.*?)</quest>", eyes.words(request))
        objects = [eyes.middle(request, colour) for colour in colours_in(found.group(1))]
        steps = [above(objects[0], 0.2), objects[0], CLOSE, above(objects[0], 0.3)]
        if len(objects) > 1:
            steps += [above(objects[1], 0.3), objects[1], OPEN, above(objects[1], 0.2)]
        shown = [s if isinstance(s, str) else f"({s[0]:.3f}, {s[1]:.3f})" for s in steps]
        return said(f"<ans>[{', '.join(shown)}]</ans>")

    return answer


@pytest.fixture
def pointing(eyes):
    def answer(request):
        asked, _, _ = eyes.words(request).partition("Your answer")
        points = eyes.some(request, colours_in(asked)[0])
        return said("[" + ", ".join(f"({u:.3f}, {v:.3f})" for u, v in points) + "]")

    return answer


@pytest.mark.parametrize(
    ("planner", "task", "seed"),
    [("hamster", "pick_and_lift", 3), ("hamster", "put_block", 4), ("robopoint", "put_block", 4)],
)
def test_an_episode_by_eye(registry, compose_run, drawing, pointing, planner, task, seed):
    with LocalModel(drawing if planner == "hamster" else pointing) as model:
        overrides = (
            f"planner={planner}",
            f"task={task}",
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
            record = run_episode(parts, EpisodeRequest(seed=seed))
    assert record.failure is None, record.failure
    assert record.checks.passed
    assert record.success_check.relaxed, record.verdict
    assert record.plan.transcript
