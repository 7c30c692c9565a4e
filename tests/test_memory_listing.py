"""Listings on terminals of any width: whole names, sentences that can be read, nothing folded to a few letters."""

import fcntl
import io
import os
import pty
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from gvla2.commands.tables import Listing
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, Verdict

ID = "avoid-0123456789ab"
SAYS = "Never grasp the bottle at its neck, because the neck is thin and turns in the gripper."
COLUMNS = ("id", "type", "state", "conf.", "content")
LISTING = Listing(COLUMNS, [(ID, "failure_avoidance", "active", "0.50", SAYS)] * 3, prose=("content",))


def printed(listing: Listing, width: int) -> str:
    out = Console(file=io.StringIO(), width=width, color_system=None)
    out.print(listing.laid_out(width))
    assert isinstance(out.file, io.StringIO)
    return out.file.getvalue()


@pytest.mark.parametrize("width", [30, 40, 60, 80, 100, 200])
def test_names_and_words_are_whole_at_any_width(width: int):
    text = printed(LISTING, width)
    assert text.count(ID) == 3
    assert set(SAYS.split()) <= set(text.split())
    assert all(len(line) <= width for line in text.splitlines())


def test_where_a_table_does_not_fit_it_becomes_blocks():
    assert isinstance(LISTING.laid_out(110), Table)
    assert not isinstance(LISTING.laid_out(60), Table)
    blocks = printed(LISTING, 60)
    head = f"{ID}  type failure_avoidance  state active  conf. \n0.50\n  Never grasp"
    assert head.replace(" \n", " ").split() == blocks.split()[: len(head.split())]
    sides = Listing(
        ("id", "says", "against", "which says"),
        [("a-1", "Lift 15 cm.", "b-2", "Lift 5 cm.")],
        prose=("says", "which says"),
    )
    told = ["a-1", "against", "b-2", "Lift", "15", "cm.", "which", "says:", "Lift", "5", "cm."]
    assert printed(sides, 20).split() == told
    wide = Listing(COLUMNS, [("字" * 9, "", "", "", "字" * 30)], prose=("content",))
    assert printed(wide, 40).count("字") == 39


@pytest.mark.skipif(os.name != "posix", reason="pseudo terminals are POSIX's")
@pytest.mark.parametrize("verb", ["list", "search bottle"])
def test_a_terminal_of_sixty_columns(tmp_path: Path, verb: str):
    with KnowledgeBank(f"sqlite:///{tmp_path / 'm.db'}") as bank:
        (id,) = bank.admit(
            Lesson("tool_usage", SAYS),
            Verdict.from_criteria({"done": 1.0}),
            task="open the bottle",
            trusted=True,
        ).added
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 30, 60, 0, 0))
    environment = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES")} | {"TERM": "xterm"}
    command = [
        sys.executable,
        "-m",
        "gvla2.cli",
        "memory",
        *verb.split(),
        f"url=sqlite:///{tmp_path / 'm.db'}",
    ]
    with os.fdopen(slave, "w") as terminal:
        done = subprocess.run(command, stdout=terminal, env=environment, cwd=tmp_path, check=False)
    text = os.read(master, 100_000).decode()
    os.close(master)
    assert done.returncode == 0
    assert id in text
    assert "  Never grasp the bottle at its neck, because the neck is" in text
