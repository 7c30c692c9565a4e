"""The run's log, where somebody or something is in its way."""

import logging
import os
from pathlib import Path

import pytest

from gvla2.record.run_log import RunLog, TerminalFormatter


def written(handler: logging.Handler, *messages: str) -> None:
    for message in messages:
        handler.handle(logging.LogRecord("gvla2", logging.INFO, "", 0, message, None, None))
    handler.close()


@pytest.mark.parametrize("plant", ["link", "dangling", "pipe"])
def test_the_log_is_a_file_of_its_own(tmp_path: Path, plant: str):
    precious, log = tmp_path / "precious", tmp_path / "run.log"
    if plant == "pipe":
        os.mkfifo(log)
    else:
        log.symlink_to(precious)
    if plant == "link":
        precious.write_text("mine")
    written(RunLog(str(log)), "hello")
    assert log.read_text() == "hello\n"
    assert not precious.exists() or precious.read_text() == "mine"


def test_an_existing_log_is_continued(tmp_path: Path):
    for message in ("one", "two"):
        written(RunLog(str(tmp_path / "run.log")), message)
    assert (tmp_path / "run.log").read_text() == "one\ntwo\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device here")
def test_a_full_disk_is_reported_once(tmp_path: Path, capsys):
    handler = RunLog(str(tmp_path / "run.log"))
    handler.stream.close()
    handler.stream = Path("/dev/full").open("w")  # noqa: SIM115 - closed below
    for _ in range(5):
        handler.handle(logging.LogRecord("gvla2", logging.INFO, "", 0, "text", None, None))
    said = capsys.readouterr().err
    assert said.count("No space left") == 1
    assert "Traceback" not in said
    with pytest.raises(OSError, match="No space left"):
        handler.stream.close()


def test_no_message_or_traceback_controls_the_terminal():
    try:
        raise ValueError("\x1b[2J\u202eRTL")
    except ValueError as error:
        about = (ValueError, error, error.__traceback__)
        record = logging.LogRecord("gvla2", logging.WARNING, "", 0, "a\x1b]0;title\x07", None, about)
    text = TerminalFormatter("%(message)s").format(record)
    assert "Traceback" in text
    assert not {"\x1b", "\x07", "\u202e"} & set(text)
