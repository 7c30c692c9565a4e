"""The pages of episodes: self-contained, well-formed, safe against foreign text; and the lines of a terminal."""

import base64
import hashlib
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from rich.console import Console

from gvla2.episode.record import EpisodeRecord, Failure
from gvla2.episode.refine import Refinement
from gvla2.memory.contracts import Learned, MemoryContext, Verdict
from gvla2.planning.calls import SkillCall
from gvla2.planning.contracts import Candidate
from gvla2.record.page import episode_folder, render_page, templates, write_index, write_summary
from gvla2.record.pictures import Pictures
from gvla2.record.progress import Progress
from gvla2.record.recorder import RunRecorder
from gvla2.record.wording import STAGES, finding, state

Episode = Callable[..., EpisodeRecord]
VOID = {"meta", "img", "input", "br", "link", "hr"}
HOSTILE = "<script>alert('x')</script>\"><img src=x onerror=alert(1)>{{ 7*7 }}&amp;"


class Reader(HTMLParser):
    """Checks nesting, collects attributes and the text that a person reads."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
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
            self.text += f" {data}"


def read(record: EpisodeRecord, pictures: Pictures | None = None, **options: object) -> Reader:
    return Reader(render_page(record, pictures or Pictures(), **options))  # type: ignore[arg-type]


def assert_self_contained(page: Reader) -> None:
    for tag, attributes in page.tags:
        assert not any(name.startswith("on") for name in attributes), f"event handler: <{tag} {attributes}>"
        source, link = attributes.get("src"), attributes.get("href")
        assert source is None or source.startswith("data:"), source
        assert link is None or not re.match(r"[a-z]+:|//", link), link
        assert tag not in ("link", "iframe", "object", "embed", "base")
        assert "url(" not in (attributes.get("style") or "")
    assert sum(tag == "script" for tag, _ in page.tags) == 1


def test_a_page_shows_what_every_stage_found(episode: Episode) -> None:
    record = episode()
    film = b"\0\0\0\x20ftypisom...."
    page = read(record, Pictures(film=film), config_yaml="seed: 3\n", beside=["result.json"])
    assert_self_contained(page)
    (video,) = (attributes for tag, attributes in page.tags if tag == "video")
    assert video["src"] == f"data:video/mp4;base64,{base64.b64encode(film).decode()}"
    for shown in (
        record.instruction, "52 × 52 × 52", record.refined[0].reason, "parameter lift_height", "0.17 -> 0.2",
        "the hand would touch the table", "Smallest clearance", "The red cube was seen 4 mm", record.goal, "rec-9",
        "seed: 3", "result.json",
    ):  # fmt: skip
        assert shown in page.text, shown
    for stage in STAGES:
        assert state(record, stage) == "done"
        assert finding(record, stage)


@pytest.mark.parametrize("stage", [stage for stage in STAGES if stage != "success_check"])
def test_a_run_that_failed_says_where(failed_at: Callable[[str], EpisodeRecord], stage: str) -> None:
    record = failed_at(stage)
    page = read(record)
    assert_self_contained(page)
    assert f"The stage {stage} broke." in page.text
    assert state(record, stage) == "failed"  # type: ignore[arg-type]
    assert state(record, "success_check") == "skipped"


def test_foreign_text_never_becomes_markup(episode: Episode) -> None:
    full = episode()
    bad_object = replace(full.scene.objects[0], label=HOSTILE, colour=HOSTILE, parent=HOSTILE)
    path = full.plan.trajectory
    bad_waypoint = replace(path.waypoints[0], stage=HOSTILE, allowed_contacts=frozenset({HOSTILE}))
    item = replace(full.recalled.items[0], content=HOSTILE, terms={HOSTILE: 1.0}, effect={"kind": HOSTILE})
    plan = replace(
        full.plan,
        trajectory=replace(path, waypoints=(bad_waypoint,)),
        skill=HOSTILE,
        notes=(HOSTILE,),
        parameters={HOSTILE: 1.0},
        roles={HOSTILE: HOSTILE},
        candidates=(Candidate(HOSTILE, 1.0, HOSTILE),),
        transcript=({HOSTILE: HOSTILE},),
    )
    record = replace(
        full,
        **dict.fromkeys(("instruction", "task", "goal"), HOSTILE),
        refined=(Refinement(bad_object, None, False, HOSTILE),),
        choices={HOSTILE: HOSTILE},
        scene=replace(full.scene.with_object(bad_object), notes=(HOSTILE,)),
        recalled=MemoryContext((item,), HOSTILE),
        plan=plan,
        verdict=Verdict.from_criteria({HOSTILE: 0.5}, (HOSTILE,), HOSTILE),
        learned=Learned((HOSTILE,), notes=(HOSTILE,)),
        failure=Failure("execute", HOSTILE, HOSTILE),
        notes=(HOSTILE,),
        parts=(replace(full, plan=plan),),
    )
    page = Reader(render_page(record, Pictures(), HOSTILE, HOSTILE))
    assert_self_contained(page)
    assert not any("onerror" in attributes for _, attributes in page.tags)
    assert HOSTILE in page.text


def test_numbers_that_are_not_numbers_do_not_break_the_page(episode: Episode) -> None:
    nan, full = float("nan"), episode()
    waypoint = replace(full.report.waypoints[0], error=nan, gripper_width=nan, reached=(nan, nan, nan))
    item = replace(full.recalled.items[0], terms={"a": nan}, confidence=nan)
    page = read(
        replace(
            full,
            report=replace(full.report, waypoints=(waypoint,), seconds=nan),
            plan=replace(full.plan, parameters={"depth": nan}, candidates=(Candidate("x", nan),)),
            recalled=replace(full.recalled, items=(item,)),
            timings={"plan": nan},
        )
    )
    assert "nan%" not in " ".join(str(a) for _, a in page.tags)


def test_compiled_templates_are_nobody_elses_to_write(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("GVLA2_CACHE", str(tmp_path))
    (tmp_path / "templates").mkdir()
    (tmp_path / "templates").chmod(0o777)
    assert templates.__wrapped__().bytecode_cache is not None
    assert (tmp_path / "templates").stat().st_mode & 0o077 == 0
    monkeypatch.setattr("os.geteuid", lambda: 12345)
    assert templates.__wrapped__().bytecode_cache is None, "a folder of somebody else"


def test_the_script_matches_its_policy(episode: Episode) -> None:
    html = render_page(episode(), Pictures())
    (policy,) = re.findall(r"script-src 'sha256-([^']+)'", html)
    (script,) = re.findall(r"<script>(.*?)</script>", html, re.DOTALL)
    assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() == policy


def test_parts_conversation_and_cost_are_shown_without_keys(episode: Episode) -> None:
    record, key = episode(), f"sk-{'k9' * 20}"
    transcript = ({"role": "system", "content": "be brief"}, {"role": "assistant", "content": key})
    plan = replace(record.plan, remaining=(SkillCall("pick", "blue_cube"),), transcript=transcript)
    tally = {"calls": 2, "prompt_tokens": 431, "completion_tokens": 17, "seconds": 3.25}
    page = render_page(
        replace(record, parts=(replace(record, plan=plan),), language={"plan": tally}), Pictures()
    )
    assert "be brief" in page
    assert "k9k9k9" not in page
    assert "431" in page
    assert 'id="parts"' in page
    assert 'id="parts"' not in render_page(record, Pictures())


def test_the_overview_and_the_summary_have_every_episode(
    tmp_path: Path, episode: Episode, abstained: EpisodeRecord
) -> None:
    records = [episode(instruction="<script>alert(1)</script>"), abstained, episode(success_check=None)]
    for k, record in enumerate(records[:2]):
        RunRecorder(episode_folder(tmp_path, k), "").finish(record)
    html = write_index(tmp_path, records).read_text(encoding="utf-8")
    page = Reader(html)
    assert not any(tag == "script" for tag, _ in page.tags)
    assert {a["href"] for _, a in page.tags if a.get("href")} == {
        f"episode_{k:03d}/index.html" for k in range(3)
    }
    sources = [a["src"] or "" for _, a in page.tags if a.get("src")]
    assert [source[:15] for source in sources] == ["data:image/jpeg"] * 2, "the third run left no picture"
    summary = json.loads(write_summary(tmp_path, records).read_text(encoding="utf-8"))
    assert (summary["command"], summary["episodes"], summary["succeeded"]) == ("run", 3, 1)
    assert summary["success_share"] == pytest.approx(1 / 3)
    assert [row["success"] for row in summary["rows"]] == [True, None, None]
    assert [row["folder"] for row in summary["rows"]] == ["episode_000", "episode_001", "episode_002"]
    assert json.loads(write_summary(tmp_path, []).read_text())["success_share"] is None


def printed(record: EpisodeRecord, quiet: bool = False, encoding: str = "utf-8") -> str:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    with Progress(quiet=quiet, console=Console(file=stream, width=60, legacy_windows=False)) as progress:
        for stage in ("perceive", "plan", "execute", "verify"):
            progress.begin(stage)
            progress.stage(record, stage)  # type: ignore[arg-type]
        progress.finish(record, Path("out"))
    stream.flush()
    return raw.getvalue().decode(encoding)


@pytest.mark.parametrize(
    "label", ["red cube", "\x1b[2J\x1b]0;title\x07", "[bold red]x[/]", "[/nothing]", "a\nb\r\nc"]
)
def test_progress_prints_one_harmless_line_a_stage(episode: Episode, label: str) -> None:
    record = episode()
    record = replace(record, scene=record.scene.with_object(replace(record.scene.objects[0], label=label)))
    lines = printed(record).splitlines()
    assert [line.split()[1] for line in lines[:4]] == ["perceive", "plan", "execute", "verify"]
    assert lines[4].startswith("Succeeded (relaxed)")
    assert lines[5] == "-> out"
    assert len(lines) == 6
    assert not {"\x1b", "\x07"} & set("".join(lines))
    assert len(printed(record, quiet=True).splitlines()) == 2
    assert "ok" in printed(record, encoding="ascii")


@pytest.mark.parametrize("error", [BrokenPipeError, OSError])
def test_a_closed_terminal_stops_nothing(episode: Episode, error: type[OSError]) -> None:
    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            raise error

    progress = Progress(console=Console(file=Gone()))
    progress.stage(episode(), "plan")
    progress.finish(episode(), Path("out"))
