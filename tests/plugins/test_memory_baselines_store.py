"""Entries on a shelf: found by similarity, grown by repetition, shared by processes, kept over restarts."""

from pathlib import Path

import numpy as np
import pytest

from gvla2.memory.contracts import Lesson, MemoryEpisode, MemoryTask, Verdict
from gvla2.memory.embedding import StaticEmbedder
from gvla2.memory.store import Store
from gvla2_plugins.memory_baselines import VectorStoreConfig
from gvla2_plugins.memory_baselines.methods import Draft, Semantic, WholeMethod, Workflows
from tests.memory.looking import look

GOOD = Verdict.from_criteria({"done": 1.0})
POOR = Verdict.from_criteria({"done": 0.7})


@pytest.fixture
def store(tmp_path: Path):
    with Store.open(f"sqlite:///{tmp_path / 'm.db'}") as opened:
        yield opened


def shelf(store: Store, method: type[WholeMethod] = Workflows) -> WholeMethod:
    return method(store.name, VectorStoreConfig(bank="b"), StaticEmbedder(), clock=lambda: 1.8e9)


def size(kept: WholeMethod) -> int:
    return len(kept.nearest("lift the cup", 99))


def episode(query: str, source: str = "run/1") -> MemoryEpisode:
    return MemoryEpisode(MemoryTask(query), (), source=source)


def prior(value: float) -> Lesson:
    effect = {"kind": "prior", "parameter": "depth", "value": value, "sd": 0.0, "count": 1}
    return Lesson("procedural_hint", "this depth succeeded", effect)


def lesson(text: str) -> Lesson:
    return Lesson("procedural_hint", text)


def test_the_entry_of_the_most_similar_task_comes_first(store: Store):
    kept = shelf(store)
    for query in ("open the wine bottle", "push the red block", "switch on the lamp"):
        kept.add([Draft((lesson(f"about {query}"), prior(0.1)))], episode(query), GOOD)
    found = kept.nearest("push a blue block", 2)
    assert found[0][0][0].content == "about push the red block"
    assert [r.effect != "" for r in found[0][0]] == [False, True]
    assert found[0][1] > found[1][1]
    embedder = StaticEmbedder()
    cosine = embedder.embed(["push a blue block"])[0] @ embedder.embed(["push the red block"])[0]
    assert found[0][1] == pytest.approx(float(cosine), abs=1e-6)


def test_without_a_key_everything_is_kept_and_with_one_it_grows(store: Store):
    kept = shelf(store)
    for number in range(3):
        learned = kept.add([Draft((lesson("same"),))], episode("q", f"run/{number}"), GOOD)
        assert (len(learned.added), learned.merged) == (1, ())
    assert size(kept) == 3
    first = kept.add([Draft((lesson("flow"), prior(0.1)), "k")], episode("lift the cup", "a"), GOOD)
    grown = kept.add([Draft((lesson("flow"), prior(0.3)), "k")], episode("raise the mug", "b"), POOR)
    assert grown.merged == first.added
    assert size(kept) == 4
    ((found, _),) = kept.nearest("raise the mug", 1)
    leading, value = found
    assert leading.count == 2
    assert leading.quality == pytest.approx(0.85)
    assert leading.query == "lift the cup\nraise the mug"
    assert leading.sources() == ("a", "b")
    assert value.effect_json()["value"] == pytest.approx(0.2)
    assert value.effect_json()["count"] == 2


def test_values_that_come_in_another_order_are_all_kept(store: Store):
    kept = shelf(store)
    other = Lesson("procedural_hint", "this tilt succeeded", dict(prior(0.5).effect) | {"parameter": "tilt"})
    for values in ((prior(0.1),), (other, prior(0.3)), (other,)):
        kept.add([Draft((lesson("flow"), *values), "k")], episode("lift"), GOOD)
    for reader in (kept, shelf(store)):
        ((found, _),) = reader.nearest("lift", 5)
        effects = {r.effect_json()["parameter"]: r.effect_json()["count"] for r in found[1:]}
        assert effects == {"depth": 2, "tilt": 2}


def test_both_wordings_of_an_entry_find_it(store: Store):
    kept = shelf(store)
    for query in ("lift the cup", "hebe die Tasse an"):
        kept.add([Draft((lesson("flow"),), "k")], episode(query), GOOD)
    kept.add([Draft((lesson("other"),))], episode("zzz"), GOOD)
    for query in ("lift the cup", "hebe die Tasse an"):
        found = kept.nearest(query, 2)
        assert found[0][0][0].content == "flow"
        assert found[0][1] > 0.6


def test_others_changes_are_followed_and_restarts_survived(store: Store):
    mine, other = shelf(store), shelf(store)
    mine.add([Draft((lesson("one"),))], episode("lift the cup"), GOOD)
    ((found, _),) = other.nearest("lift the cup", 3)
    with store.writing("b", actor="t", now=1.8e9) as tx:
        tx.forget(found[0].id)
    assert mine.nearest("lift the cup", 3) == []
    other.add([Draft((lesson("two"), prior(0.1)))], episode("lift the cup"), GOOD)
    assert [r.content for f, _ in mine.nearest("lift the cup", 3) for r in f] == [
        "two",
        "this depth succeeded",
    ]
    assert size(shelf(store)) == 1
    assert look(store, "b").verify() == []


def test_the_content_counts_where_it_is_asked_for(store: Store):
    kept = shelf(store, Semantic)
    kept.add([Draft((lesson("tighten the screw"),)), Draft((lesson("peel it"),))], episode("q"), GOOD)
    assert kept.nearest("loosen a screw", 1)[0][0][0].content == "tighten the screw"


@pytest.mark.parametrize("text", ["", "   ", "\x00\ud800", "x" * 1_000_000])
def test_texts_of_any_kind_can_be_asked_and_kept(store: Store, text: str):
    kept = shelf(store)
    assert kept.nearest(text, 3) == []
    kept.add([Draft((lesson(text or "-"),))], episode(text), GOOD)
    assert all(np.isfinite(cosine) for _, cosine in kept.nearest(text, 3))
    assert look(store, "b").verify() == []
