import base64
import hashlib
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.memory.contracts import Learned, MemoryContext, Verdict
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Candidate
from gvla2.record.page import render_page
from gvla2.record.pictures import Pictures
from gvla2.robot.backend import SuccessCheck

VOID = {"meta", "img", "input", "br", "link", "hr"}
STAGES = [
    "setup",
    "observe",
    "perceive",
    "reconstruct",
    "recall",
    "plan",
    "check",
    "execute",
    "verify",
    "learn",
]
HOSTILE = "<script>alert('x')</script>\"><img src=x onerror=alert(1)>{{ 7*7 }}&amp;"


class Reader(HTMLParser):
    """Checks nesting, collects attributes and the text that a person reads."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.feed(html)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop() == tag, f"</{tag}> at line {self.getpos()[0]} closes the wrong element"

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in ("script", "style"):
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))


def read(record: EpisodeRecord, **options: object) -> Reader:
    return Reader(render_page(record, options.pop("pictures", Pictures()), **options))  # type: ignore[arg-type]


def assert_self_contained(page: Reader) -> None:
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), (
            f"<{tag}> has an event handler: {attributes}"
        )
        source = attributes.get("src")
        assert source is None or source.startswith("data:"), source
        link = attributes.get("href")
        assert link is None or not re.match(r"[a-z]+:|//", link), link
        assert tag not in ("link", "iframe", "object", "embed", "base")
        assert "url(" not in (attributes.get("style") or "")
    assert sum(tag == "script" for tag, _ in page.tags) == 1


def test_a_full_run_tells_everything(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode()
    page = read(record, config_yaml="seed: 3\n", beside=["result.json"])
    assert_self_contained(page)
    for words in (
        record.instruction,
        "Relaxed only",
        "relaxed ✓",
        "strict ✗",
        "Success 0.84",
        "6 of 6 waypoints",
        "50 × 50 × 50",
        "170 × 170 × 1",
        record.refinement,
        "r text",
        "lift_height >= 0.2",
        "binding",
        "0.17 -> 0.2, bound >= 0.2 from rec-7",
        "The cube is narrower than the open hand.",
        "the hand would touch the table",
        "chosen",
        "0.240, -0.100, 0.902",
        "Smallest clearance on the way.",
        "raised by 4 mm",
        "1.4",
        "theme at goal",
        "The red cube was seen 4 mm",
        record.goal,
        "rec-9",
        "seed: 3",
        "result.json",
    ):
        assert words in page.text, words


def test_success_check_and_verifier_are_told_apart(episode: Callable[..., EpisodeRecord]) -> None:
    wrong = episode(success_check=SuccessCheck(relaxed=False, strict=False))
    text = read(wrong).text
    assert "Not achieved" in text
    assert "Success 0.84" in text
    assert "From the simulation’s true state" in text


@pytest.mark.parametrize("stage", STAGES)
def test_a_run_that_failed_says_where(failed_at: Callable[[str], EpisodeRecord], stage: str) -> None:
    page = read(failed_at(stage))
    assert_self_contained(page)
    assert f"The stage {stage} broke." in page.text
    assert "(error)" in page.text


def test_a_planner_that_declined_is_no_failure(abstained: EpisodeRecord) -> None:
    text = read(abstained).text
    assert "The planner declined (ambiguous)" in text
    assert "Declined, nothing moved" in text
    assert "Stopped at" not in text


def test_every_single_part_may_be_missing(episode: Callable[..., EpisodeRecord]) -> None:
    full = episode()
    optional = [name for name, value in vars(EpisodeRecord).items() if value is None and name != "failure"]
    assert len(optional) >= 11
    for name in optional:
        read(replace(full, **{name: None}))


def test_memory_that_degraded_or_abstained_says_so(episode: Callable[..., EpisodeRecord]) -> None:
    text = read(
        episode(
            recalled=MemoryContext(degraded="the database is locked"),
            learned=Learned(degraded="still locked"),
        )
    ).text
    assert "the database is locked" in text
    assert "still locked" in text
    assert (
        "all scores below 0.3" in read(episode(recalled=MemoryContext(abstained="all scores below 0.3"))).text
    )


def test_an_oracle_run_is_marked(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode()
    assert record.scene is not None
    assert "Oracle perception" in read(replace(record, scene=replace(record.scene, perceiver="oracle"))).text
    assert "Oracle perception" not in read(record).text


def test_hostile_texts_stay_texts(episode: Callable[..., EpisodeRecord]) -> None:
    full = episode()
    assert full.scene
    assert full.recalled
    assert full.plan
    assert full.plan.trajectory
    bad_object = replace(full.scene.objects[0], label=HOSTILE, colour=HOSTILE, parent=HOSTILE)
    bad_waypoint = replace(
        full.plan.trajectory.waypoints[0], stage=HOSTILE, allowed_contacts=frozenset({HOSTILE})
    )
    record = replace(
        full,
        instruction=HOSTILE,
        task=HOSTILE,
        goal=HOSTILE,
        refinement=HOSTILE,
        choices={HOSTILE: HOSTILE},
        scene=replace(full.scene.with_object(bad_object), notes=(HOSTILE,)),
        recalled=MemoryContext(
            (
                replace(
                    full.recalled.items[0], content=HOSTILE, terms={HOSTILE: 1.0}, effect={"kind": HOSTILE}
                ),
            ),
            HOSTILE,
        ),
        plan=replace(
            full.plan,
            trajectory=replace(full.plan.trajectory, waypoints=(bad_waypoint,)),
            skill=HOSTILE,
            notes=(HOSTILE,),
            parameters={HOSTILE: 1.0},
            roles={HOSTILE: HOSTILE},
            candidates=(Candidate(HOSTILE, 1.0, HOSTILE),),
            transcript=({HOSTILE: HOSTILE},),
        ),
        verdict=Verdict.from_criteria({HOSTILE: 0.5}, (HOSTILE,), HOSTILE),
        learned=Learned((HOSTILE,), notes=(HOSTILE,)),
        failure=Failure("execute", HOSTILE, HOSTILE),
        notes=(HOSTILE,),
    )
    html = render_page(record, Pictures(), HOSTILE, HOSTILE)
    page = Reader(html)
    assert_self_contained(page)
    assert not any("onerror" in attributes for _, attributes in page.tags)
    assert "49" not in re.findall(r"alert\(1\)>\s*(\d+)", page.text)
    assert HOSTILE in page.text


def test_numbers_that_are_not_numbers_do_not_break_the_page(episode: Callable[..., EpisodeRecord]) -> None:
    nan = float("nan")
    full = episode()
    assert full.report
    assert full.plan
    assert full.recalled
    waypoint = replace(full.report.waypoints[0], error=nan, gripper_width=nan, reached=(nan, nan, nan))
    record = replace(
        full,
        report=replace(full.report, waypoints=(waypoint,), seconds=nan),
        plan=replace(full.plan, parameters={"depth": nan}, candidates=(Candidate("x", nan),)),
        recalled=replace(
            full.recalled, items=(replace(full.recalled.items[0], terms={"a": nan}, confidence=nan),)
        ),
        timings={"plan": nan},
    )
    page = read(record)
    assert "nan%" not in " ".join(str(a) for _, a in page.tags)


def test_the_script_matches_its_policy(episode: Callable[..., EpisodeRecord]) -> None:
    import base64

    html = render_page(episode(), Pictures())
    policy = re.search(r"script-src 'sha256-([^']+)'", html)
    script = re.search(r"<script>(.*?)</script>", html, re.DOTALL)
    assert policy
    assert script
    assert base64.b64encode(hashlib.sha256(script[1].encode()).digest()).decode() == policy[1]


def test_parts_conversation_and_cost_are_shown_and_nothing_of_them_is_markup(
    episode: Callable[..., EpisodeRecord],
) -> None:
    record, key = episode(), f"sk-{'k9' * 20}"
    assert record.plan is not None
    hostile = "<script>steal()</script>"
    plan = replace(
        record.plan,
        remaining=(SkillCall("pick", "object_1"),),
        transcript=(
            {"role": "system", "content": hostile},
            {"role": "assistant", "content": f"{key} {hostile}"},
        ),
    )
    first = replace(record, plan=plan)
    tally = {"calls": 2, "prompt_tokens": 431, "completion_tokens": 17, "seconds": 3.25}
    whole = replace(record, parts=(first,), language={"plan": tally})
    page = render_page(whole, Pictures())
    assert hostile not in page
    assert page.count("&lt;script&gt;steal()") == 2, "what was said for an earlier part is on the page"
    assert "k9k9k9" not in page
    assert 'id="parts"' in page
    assert "2 of 2 parts" in page
    assert "431" in page
    assert 'id="parts"' not in render_page(record, Pictures())


def test_the_3d_scene_is_on_the_page_once_with_or_without_a_plan(
    episode: Callable[..., EpisodeRecord], failed_at: Callable[[str], EpisodeRecord]
) -> None:
    for record in (episode(), failed_at("plan")):
        page = read(record, pictures=Pictures(model=b"glTF-bytes"))
        assert_self_contained(page)
        (figure,) = (
            attributes for tag, attributes in page.tags if tag == "figure" and "data-glb" in attributes
        )
        assert base64.b64decode(figure["data-glb"]) == b"glTF-bytes"
        assert sum(tag == "canvas" for tag, _ in page.tags) == 1
    assert not any(tag == "canvas" for tag, _ in read(episode()).tags)


def test_a_film_is_played_and_the_animation_waits_for_browsers_that_cannot(
    episode: Callable[..., EpisodeRecord],
) -> None:
    film, still = b"\0\0\0\x20ftypisom....", b"GIF89a..."
    page = read(episode(), pictures=Pictures(episode=still, film=film))
    assert_self_contained(page)
    (video,) = (attributes for tag, attributes in page.tags if tag == "video")
    assert video["src"] == f"data:video/mp4;base64,{base64.b64encode(film).decode()}"
    assert "controls" in video
    (picture,) = (
        a for tag, a in page.tags if tag == "img" and (a.get("src") or "").startswith("data:image/gif")
    )
    assert "hidden" in picture
    alone = read(episode(), pictures=Pictures(episode=still))
    assert not any(tag == "video" for tag, _ in alone.tags)
    assert not any("hidden" in a for tag, a in alone.tags if tag == "img")
