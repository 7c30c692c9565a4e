import io
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from gvla2.episode.record import EpisodeRecord
from gvla2.record.progress import Progress
from gvla2.record.wording import summary_line
from gvla2.robot.backend import SuccessCheck


def printed(
    record: EpisodeRecord, terminal: bool = False, quiet: bool = False, encoding: str = "utf-8"
) -> str:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding)
    console = Console(file=stream, force_terminal=terminal, width=60, legacy_windows=False)
    with Progress(quiet=quiet, console=console) as progress:
        for stage in ("perceive", "plan", "execute", "verify"):
            progress.begin(stage)  # type: ignore[arg-type]
            progress.stage(record, stage)  # type: ignore[arg-type]
        progress.finish(record, Path("out"))
    stream.flush()
    return raw.getvalue().decode(encoding)


def test_plain_lines_without_a_terminal(episode: Callable[..., EpisodeRecord]) -> None:
    lines = printed(episode()).splitlines()
    assert [line.split()[1] for line in lines[:4]] == ["perceive", "plan", "execute", "verify"]
    assert "3 objects: red cube, olive cube, white plate" in lines[0]
    assert "6 waypoints, skill pick_place" in lines[1]
    assert "verified_success 0.84" in lines[3]
    assert lines[4].startswith("Succeeded (relaxed) | success check: relaxed yes, strict no")
    assert lines[5].endswith("index.html")
    assert "\x1b" not in "".join(lines)


def test_a_terminal_gets_colours_and_the_same_words(
    episode: Callable[..., EpisodeRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    text = printed(episode(), terminal=True)
    assert "\x1b[" in text
    assert "red cube" in text


def test_quiet_says_only_how_it_ended(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode()
    lines = printed(record, quiet=True).splitlines()
    assert lines[0] == summary_line(record)
    assert lines[1].startswith("-> ")
    assert len(lines) == 2


@pytest.mark.parametrize("error", [BrokenPipeError, OSError])
def test_a_terminal_that_is_gone_stops_nothing(
    episode: Callable[..., EpisodeRecord], error: type[OSError]
) -> None:
    class Gone(io.StringIO):
        def write(self, text: str) -> int:
            raise error

    progress = Progress(console=Console(file=Gone()))
    progress.stage(episode(), "plan")
    progress.finish(episode(), Path("out"))


def test_a_terminal_without_unicode_is_no_error(episode: Callable[..., EpisodeRecord]) -> None:
    record = episode(instruction="größer", failure=None)
    assert "ok" in printed(record, encoding="ascii")


@pytest.mark.parametrize("bad", ["\x1b[2J\x1b]0;title\x07", "[bold red]x[/]", "[/nothing]", "a\nb\r\nc"])
def test_hostile_texts_are_printed_harmlessly(episode: Callable[..., EpisodeRecord], bad: str) -> None:
    from dataclasses import replace

    record = episode()
    assert record.scene is not None
    record = replace(record, scene=record.scene.with_object(replace(record.scene.objects[0], label=bad)))
    text = printed(record)
    assert "\x1b" not in text
    assert "\x07" not in text
    assert len(text.splitlines()) == 6


def test_the_summary_is_one_line(
    episode: Callable[..., EpisodeRecord], abstained: EpisodeRecord, failed_at: Callable[[str], EpisodeRecord]
) -> None:
    assert "6 of 6 waypoints" in summary_line(episode())
    assert summary_line(episode(success_check=SuccessCheck(False, False))).startswith("Not achieved")
    assert summary_line(abstained).startswith("Declined, nothing moved | ambiguous")
    assert summary_line(failed_at("perceive")).startswith(
        "Stopped at perceive | error: The stage perceive broke."
    )
    for record in (episode(), abstained, failed_at("setup")):
        assert "\n" not in summary_line(record)
