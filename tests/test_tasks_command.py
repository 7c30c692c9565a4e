"""``gvla2 tasks``: one page, pictures inside."""

import re
from pathlib import Path

import pytest

from gvla2 import cli
from gvla2.commands import hydra_job
from gvla2.commands.tasks import main
from gvla2.errors import Gvla2Error


def test_the_page_shows_a_task_from_every_camera(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    page = tmp_path / "page.html"
    assert main(["take_umbrella", "--seed", "2", "--output", str(page)]) == 0
    assert capsys.readouterr().out.strip() == str(page)
    html = page.read_text()
    pictures = re.findall(r'alt="(\w+)" src="data:image/png;base64,', html)
    assert set(pictures) == {"front", "left_shoulder", "right_shoulder", "wrist"}
    assert "http" not in html  # nothing is loaded from elsewhere


def test_wrong_usage(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["tasks", "--nothing"]) == 2
    assert cli.main(["tasks", "--help"]) == 0
    capsys.readouterr()
    assert main(["putt_block", "--output", str(tmp_path / "page.html")]) == 1
    assert "Did you mean 'put_block'" in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()


def test_by_default_all_tasks_are_shown_that_need_no_option(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def broken(*_: object) -> dict[str, object]:
        raise Gvla2Error("there is no robot")

    monkeypatch.setattr(hydra_job, "composed", broken)
    page = tmp_path / "page.html"
    assert main(["--output", str(page)]) == 1, "none could be laid out"
    html = page.read_text()
    assert html.count("there is no robot") >= 17
    assert "open_drawer" in html
    assert "tabletop_objects" not in html, "it needs a folder of meshes"
