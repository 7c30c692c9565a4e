"""Which names a bank may have, and that the library keeps to it."""

from pathlib import Path

import pytest

from gvla2.errors import MemoryStoreError
from gvla2.memory.bank import KnowledgeBank
from gvla2.memory.contracts import Lesson, Verdict
from gvla2.memory.store import LONGEST_NAME as LONGEST
from gvla2.memory.store import wrong_bank_name

GOOD = Verdict.from_criteria({"done": 1.0})


@pytest.mark.parametrize(
    "name",
    ["default", "2026_11", "1e3", "true", "null", "b\u00fccher", "\u4ed3\u5e93",
     "\u0645\u062e\u0632\u0646", "\u0917\u094b\u0926\u093e\u092e",
     "lab/arm-2.v3", "x" * LONGEST],
)  # fmt: skip
def test_names_of_any_language(name: str):
    assert wrong_bank_name(name) == ""


@pytest.mark.parametrize(
    "name",
    ["", " ", "a b", "a,b", "a\nb", "a\x00b", "x\x1b[31m", "\u202eabc", "a\u200bb", "bu\u0308cher",
     "-a", "../a", ".a", "a=b", "a'b",
     "\ud800", "x" * (LONGEST + 1)],
)  # fmt: skip
def test_names_that_would_mislead(name: str, tmp_path: Path):
    said = wrong_bank_name(name)
    assert "cannot be the name of a bank" in said
    assert "of any language" in said
    assert all(c.isprintable() for c in said)
    with (
        KnowledgeBank(f"sqlite:///{tmp_path / 'm.db'}", bank=name) as bank,
        pytest.raises(MemoryStoreError, match="cannot be the name of a bank"),
    ):
        bank.admit(Lesson("tool_usage", "Hold the rim."), GOOD, task="lift", trusted=True)
