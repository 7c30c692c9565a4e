"""Worlds that are not as a task means them: every episode ends in success or in a typed failure, never in a traceback.

Simulation, perceiver, planner and verifier are the real ones; only the layout, the images or the world's speeds are
tampered with.
"""

import json
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from gvla2.commands.run import build_components, run_episodes, success_rate
from gvla2.episode.loop import EpisodeRequest, SilentListener, run_episode
from gvla2.geometry.views import Views
from gvla2.planning.colours import COLOURS, colours_in
from tests.composing import composed, offer
from tests.quick import QUICK

OUTCOMES = {"success", "perception", "nothing_matches", "ambiguous", "unreachable", "slipped", "tracking", "no_path",
            "collision", "not_achieved", "goal_not_reached", "rejected", "simulation"}  # fmt: skip
"""What may come of a bad world; "error" and "crashed" are not among it."""


class Meddler(SilentListener):
    """Gives the asked body a speed (m/s) and a turn (rad/s) at the picture ``at`` of the motion, once."""

    def __init__(self, robot, at, speed, turn=(0.0, 0.0, 0.0)):
        self.robot, self.at, self.speed, self.turn, self.seen = robot, at, speed, turn, 0
        self.task = None

    def moment(self, moment):  # pictures come later, from the film's own thread
        self.seen += 1
        if self.seen == self.at:
            body = self.robot._world._movers[self.task.index]
            body.set_linear_velocity(self.speed)
            body.set_angular_velocity(self.turn)

    def pose(self):
        """Where the asked body is at the end, (4, 4)."""
        return self.robot._world.body_pose(self.robot._layout.bodies[self.task.index].name)


class Altered:
    """Another task's episode with bodies changed: ``change`` gets whether a body is the one that is asked for."""

    instructions = ("-",) * 4

    def __init__(self, task, change):
        self._task, self._change = task, change

    def sample(self, rng, site, instruction=None):
        instance = self._task.sample(rng, site, instruction)
        (colour,) = colours_in(instance.instruction)
        self.index = [body.solids[0].rgb for body in instance.layout.bodies].index(COLOURS[colour])
        bodies = tuple(
            self._change(index == self.index, body) for index, body in enumerate(instance.layout.bodies)
        )
        return replace(instance, layout=replace(instance.layout, bodies=bodies))


@pytest.fixture(scope="module")
def parts(registry):
    """A run's parts, built once: three cubes, small pictures, no memory."""
    offer(registry)
    config = composed(
        "run", "memory=none", "robot.image_size=160", "robot.video_size=16", "robot.video_fps=20"
    )
    built = build_components(config, registry)
    with closing(built.robot):
        yield built


def moved(body, x, y):
    pose = body.world_from_body.copy()
    pose[:2, 3] = x, y
    return replace(body, world_from_body=pose)


def the_asked(change):
    """Changes the body that is asked for and no other."""
    return lambda asked, body: change(body) if asked else body


def outcome(record):
    if record.failure is not None:
        return record.failure.kind
    assert record.success_check is not None
    assert record.success_check.relaxed
    return "success"


def run(parts, change=None, listener=None, robot=None, **request):
    task = Altered(parts.task, change or (lambda asked, body: body))
    if isinstance(listener, Meddler):
        listener.task = task
    altered = replace(parts, task=task, robot=robot or parts.robot)
    record = run_episode(altered, EpisodeRequest(seed=2, **request), listener or SilentListener())
    assert outcome(record) in OUTCOMES, record.failure
    assert record.failure is None or len(record.failure.message) > 20
    return record


@pytest.fixture(scope="module")
def clean(parts):
    """The episode of the plain world."""
    return run(parts)


def test_the_plain_world_succeeds(clean):
    assert outcome(clean) == "success"


@pytest.mark.parametrize("place", [(0.98, 0.0), (0.25, 0.85), (-0.40, 0.45)], ids=["far", "aside", "behind"])
def test_what_is_out_of_reach_or_view_is_declined_before_any_motion(parts, place):
    record = run(parts, the_asked(lambda body: moved(body, *place)))
    assert record.failure.kind in ("nothing_matches", "unreachable", "rejected")
    assert record.report is None


def test_two_alike_are_distinguished_by_nobody(parts):
    asked_for = []  # the colour's solids; every other cube gets the same

    def note(asked, body):
        if asked:
            asked_for[:] = body.solids
        return body

    def alike(asked, body):
        return replace(body, solids=tuple(asked_for))

    Altered(parts.task, note).sample(np.random.default_rng(2), parts.robot._site())
    record = run(parts, alike)
    assert (record.failure.stage, record.failure.kind) == ("plan", "ambiguous")
    assert record.report is None


def test_what_slips_is_a_failure_with_its_signal(parts):
    slippery = the_asked(lambda body: replace(body, friction=0.0))
    world = parts.robot._config
    world.finger_friction, before = 0.0, world.finger_friction
    try:
        record = run(parts, slippery)
    finally:
        world.finger_friction = before
    assert record.failure.kind in ("slipped", "not_achieved")
    assert not record.success_check.relaxed
    assert record.verdict.outcome != "verified_success"


class Blinded:
    """A robot some of whose cameras see nothing."""

    def __init__(self, robot, dead):
        self._robot, self._dead = robot, dead

    def __getattr__(self, name):
        return getattr(self._robot, name)

    def observe(self):
        seen = self._robot.observe()
        views = tuple(
            replace(v, image=np.zeros_like(v.image), depth=np.full_like(v.depth, np.nan))
            if v.name in self._dead
            else v
            for v in seen.views
        )
        return replace(seen, views=Views(views))


def test_all_cameras_gone_black_is_a_failure_of_perception(parts):
    names = ("front", "left_shoulder", "right_shoulder", "wrist")
    assert run(parts, robot=Blinded(parts.robot, names)).failure.kind == "perception"


def test_a_simulation_that_explodes_is_marked_and_the_next_episode_is_clean(parts, clean):
    record = run(parts, listener=Meddler(parts.robot, 4, (float("nan"), 0.0, 0.0)))
    assert (record.failure.stage, record.failure.kind) == ("execute", "simulation")
    assert "blown up" in record.failure.message
    assert record.report.abort is not None
    # What happened in such a world is neither judged nor learned from.
    assert record.verdict is None
    assert record.learned is None
    assert record.success_check is None
    after = run(parts)
    assert outcome(after) == "success"
    np.testing.assert_array_equal(after.report.joint_path, clean.report.joint_path)


def test_a_run_of_several_goes_on_after_an_explosion(registry, compose_run, tmp_path, monkeypatch):
    from gvla2_plugins.sapien.driver import SapienDriver

    follow, calls = SapienDriver.follow, []

    def explosive(self, *motion):
        calls.append(1)
        if len(calls) == 2:
            self._world._movers[0].set_linear_velocity((0.0, 0.0, 1e8))
        return follow(self, *motion)

    monkeypatch.setattr(SapienDriver, "follow", explosive)
    out = tmp_path / "out"
    share = success_rate(run_episodes(compose_run("memory=none", "episodes=2", *QUICK), registry, out))
    shown = json.loads((out / "result.json").read_text())
    first, second = shown["rows"]
    assert first["failure"]["kind"] == "simulation"
    assert first["success"] is None
    assert second["success"] is True
    assert (shown["episodes"], share) == (2, 0.5)
    page = (out / "episode_000" / "index.html").read_text()
    assert "blown up" in page
