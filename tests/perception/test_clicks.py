"""A vision model behind real HTTP, which answers from rendered truth."""

import json

import numpy as np
import pytest

from gvla2.language import Endpoint
from gvla2.perception.clicks import Segments, localized, locate
from gvla2.perception.clusters import iou
from gvla2.perception.frames import frames_of
from gvla2.perception.objects import object_of
from gvla2.perception.options import VisionOptions
from gvla2.planning.scene import Scene
from tests.local_model import LocalModel, refused, said


def clicking(*answers):
    """A model that gives these answers, one a call, the last one forever."""
    left = list(answers)

    def answer(request):
        one = left.pop(0) if len(left) > 1 else left[0]
        return said(one if isinstance(one, str) else json.dumps(one))

    return LocalModel(answer)


def at(mask, shift=0):
    """The click on the pixel in the middle of a mask, in thousandths."""
    pixels = np.argwhere(mask) + 0.5
    row, column = pixels[np.argmin(np.linalg.norm(pixels - pixels.mean(axis=0) - shift, axis=1))]
    return {"done": False, "x": 1000 * column / mask.shape[1], "y": 1000 * row / mask.shape[0]}


DONE = {"done": True, "x": 0, "y": 0}


@pytest.fixture
def seen(world, two):
    """The first picture, encoded, and what stands in it."""
    image = two.observation.views[0].image
    return image, world.ByColour(120.0).encode(image), [two.truth[0] == 1, two.truth[0] == 2]


def ask(model, seen):
    options = VisionOptions(base_url=model.url)
    return locate(Endpoint(options), *seen, "lift the bottle", options)


def test_it_settles_on_the_object_that_is_clicked(seen):
    target = seen[2][1]
    with clicking(at(target), at(target, shift=6)) as model:
        found = ask(model, seen)
    assert found.stopped == "settled"
    assert len(found.clicks) == 2
    assert iou(found.mask, target) > 0.8
    words = json.dumps(model.requests[0])
    assert "lift the bottle" in words
    assert "image_url" in words


def test_done_ends_it_but_not_before_something_is_marked(seen):
    target = seen[2][0]
    with clicking(DONE, at(target), DONE) as model:
        found = ask(model, seen)
    assert found.stopped == "done"
    assert found.mask[target].mean() > 0.3
    assert "nothing is marked yet" in json.dumps(model.requests[1])


def test_clicks_outside_the_picture_are_refused_with_the_reason(seen):
    with clicking({"done": False, "x": 1400, "y": 20}, at(seen[2][1]), DONE) as model:
        found = ask(model, seen)
    assert (found.refused, len(found.clicks)) == (1, 1)
    assert "outside the picture" in json.dumps(model.requests[1])
    assert found.mask is not None


def test_the_budget_ends_it_and_the_last_good_mask_is_kept(seen):
    outside = {"done": False, "x": -5, "y": 20}
    with clicking(at(seen[2][1]), outside) as model:
        found = ask(model, seen)
    assert (found.stopped, len(model.requests)) == ("budget", 5)
    assert iou(found.mask, seen[2][1]) > 0.8


def test_a_mask_that_is_no_object_does_not_replace_a_good_one(seen):
    image, encoded, proposals = seen

    class Turns:
        """Good once, then the whole picture."""

        calls = 0

        def segment(self, prompts):
            self.calls += 1
            if self.calls == 1:
                return encoded(prompts)
            return Segments(np.ones((1, 1, *image.shape[:2]), bool), np.array([[0.9]]))

    with clicking(at(proposals[1]), at(proposals[1], shift=5)) as model:
        found = ask(model, (image, Turns().segment, proposals))
    assert iou(found.mask, proposals[1]) > 0.8
    assert found.refused


def test_a_model_that_fails_leaves_what_was_good(seen):
    calls = []

    def answer(request):
        calls.append(request)
        return said(json.dumps(at(seen[2][1]))) if len(calls) == 1 else refused(400, "no")

    with LocalModel(answer) as model:
        found = ask(model, seen)
    assert found.stopped == "no_answer"
    assert found.mask is not None
    with clicking("I see a bottle.") as model:
        assert ask(model, seen).mask is None


def test_the_scene_says_which_object_was_meant(world, two):
    frames, table, _ = frames_of(two.observation.views, world.WORKSPACE)
    objs = [
        object_of(
            np.concatenate([f.points[t == k] for f, t in zip(frames, two.truth, strict=True)]),
            np.concatenate([f.view.image[t == k] for f, t in zip(frames, two.truth, strict=True)]) / 255.0,
            world.TABLE, 1.0, f"o{k}",
        )
        for k in (1, 2)
    ]  # fmt: skip
    scene = Scene(tuple(objs), world.TABLE, world.WORKSPACE)
    # Clicks are asked for in the picture that shows most.
    shown = int(np.argmax([(t > 0).sum() for t in two.truth]))
    with clicking(at(two.truth[shown] == 2), DONE) as model:
        options = VisionOptions(base_url=model.url)
        asked = localized(
            scene, frames, world.ByColour(120.0), table, "lift the bottle", Endpoint(options), options
        )
    assert any(note.startswith("o2 is the target") for note in asked.notes)
    assert asked.objects == scene.objects


def test_a_part_that_geometry_did_not_separate_is_added(world, two):
    frames, table, _ = frames_of(two.observation.views, world.WORKSPACE)
    points = np.concatenate([f.points[t == 1] for f, t in zip(frames, two.truth, strict=True)])
    whole = object_of(points, np.ones_like(points), world.TABLE, 1.0, "o1")
    scene = Scene((whole,), world.TABLE, world.WORKSPACE)

    shown = int(np.argmax([(t == 1).sum() for t in two.truth]))
    painted = (two.truth[shown] == 1) & (frames[shown].view.image[..., 1] > 120)

    class Painted:
        def encode(self, image):
            return lambda prompts: Segments(painted[None, None], np.array([[0.9]]))

    with clicking(at(painted), DONE) as model:
        options = VisionOptions(base_url=model.url)
        asked = localized(scene, frames, Painted(), table, "press the end", Endpoint(options), options)
    assert asked.objects[1].parent == "o1"
    assert asked.objects[1].extents[:2].prod() < 0.6 * whole.extents[:2].prod()
