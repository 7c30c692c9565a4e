import json
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

from gvla2.episode.record import EpisodeRecord
from gvla2.record.page import episode_folder, write_summary
from gvla2.record.recorder import RunRecorder, write_index


class Links(HTMLParser):
    def __init__(self, html: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.sources: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        assert tag != "script"
        if given.get("href"):
            self.links.append(str(given["href"]))
        if given.get("src"):
            self.sources.append(str(given["src"]))


def test_the_overview_links_every_episode(
    tmp_path: Path, episode: Callable[..., EpisodeRecord], abstained: EpisodeRecord
) -> None:
    records = [episode(instruction="<script>alert(1)</script>"), abstained, episode(success_check=None)]
    for k, record in enumerate(records[:2]):
        RunRecorder(episode_folder(tmp_path, k), "").finish(record)
    html = write_index(tmp_path, records).read_text(encoding="utf-8")
    page = Links(html)
    assert {f"episode_{k:03d}/index.html" for k in range(3)} == set(page.links)
    assert len(page.sources) == 2
    assert all(s.startswith("data:image/jpeg") for s in page.sources)
    assert "Declined, nothing moved" in html
    assert "1 of 3" in html


def test_the_summary_counts_and_has_a_row_for_every_episode(
    tmp_path: Path, episode: Callable[..., EpisodeRecord], abstained: EpisodeRecord
) -> None:
    records = [episode(), abstained, episode(success_check=None)]
    told = json.loads(write_summary(tmp_path, records).read_text(encoding="utf-8"))
    assert (told["command"], told["episodes"], len(told["rows"])) == ("run", 3, 3)
    assert told["succeeded"] == sum(bool(r.success_check and r.success_check.relaxed) for r in records) == 1
    assert told["success_share"] == pytest.approx(1 / 3)
    for row, record, folder in zip(told["rows"], records, ("000", "001", "002"), strict=True):
        assert (row["seed"], row["instruction"]) == (record.seed, record.instruction)
        assert row["folder"] == f"episode_{folder}"
        assert row["seconds"] == pytest.approx(sum(record.timings.values()), abs=1e-3)
    assert told["rows"][2]["success"] is None
    assert told["rows"][1]["failure"]["kind"]
    assert json.loads(write_summary(tmp_path, []).read_text())["success_share"] is None
