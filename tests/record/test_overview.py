from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest

from gvla2.record.contents import EpisodeRecord
from gvla2.record.overview import episode_folder
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
    records = [episode(instruction="<script>alert(1)</script>"), abstained, episode(judgement=None)]
    for k, record in enumerate(records[:2]):
        RunRecorder(episode_folder(tmp_path, k), "").finish(record)
    html = write_index(tmp_path, records).read_text(encoding="utf-8")
    page = Links(html)
    assert {f"episode_{k:03d}/index.html" for k in range(3)} == set(page.links)
    assert len(page.sources) == 2
    assert all(s.startswith("data:image/jpeg") for s in page.sources)
    assert "Declined, nothing moved" in html
    assert "1 of 3" in html


@pytest.mark.parametrize("count", [0, 1])
def test_few_episodes_are_fine(tmp_path: Path, episode: Callable[..., EpisodeRecord], count: int) -> None:
    page = write_index(tmp_path, [episode()] * count)
    assert f"{count} episode" in page.read_text(encoding="utf-8")
