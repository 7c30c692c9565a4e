"""Addresses and names: one file has one name, and a mistake is named with what is meant."""

from pathlib import Path

import pytest

from gvla2.errors import ConfigurationError
from gvla2.io.database_url import parsed
from gvla2.memory.store import LONGEST_NAME, Store, check_bank, resolved_address


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("sqlite://host/x.db", "names no file"),
        ("sqlite://x.db", "names no file.*three slashes"),
        ("sqlite:///", "names no file"),
        ("sqlite:///:memory:", "names no file"),
        ("sqlite:///x.db?mode=ro", "names no file"),
        ("mysql://robot:hush@host/x", "are SQLite or PostgreSQL, not 'mysql'"),
        ("file:///x.db", "are SQLite or PostgreSQL, not 'file'"),
        ("", "Not a database address"),
        ("C:x.db", "Not a database address"),
        ("sqlite:///~no-such-user/x.db", "is not valid: Could not determine home"),
    ],
)
def test_mistakes_are_named(url: str, said: str) -> None:
    for opened in (Store.open, lambda url: resolved_address(url or ":", {})):
        with pytest.raises(ConfigurationError, match=said) as caught:
            opened(url)
        assert "hush" not in str(caught.value)


def test_the_file_has_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "folder")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path / "folder")
    real = (tmp_path / "folder" / "x.db").resolve()
    for url in ("sqlite:///x.db", f"sqlite:///{tmp_path}/link/x.db", "sqlite:///~/link/../folder/x.db", "x.db",
                "~/folder/x.db"):  # fmt: skip
        assert parsed(url).database == str(real)
        assert resolved_address(url, {}) == f"sqlite:///{real}"
    (tmp_path / "round").symlink_to(tmp_path / "round")
    assert parsed(tmp_path / "round").database == str(tmp_path / "round")


@pytest.mark.parametrize("name", ["h?one", "p%41q", "a#b", "with space", "c&d=e"])
def test_a_home_may_have_characters_that_urls_read_otherwise(tmp_path: Path, name: str) -> None:
    address = resolved_address("", {"GVLA2_HOME": str(tmp_path / name)})
    assert resolved_address(address, {}) == address
    (tmp_path / name).mkdir()
    Store.open(address).close()
    assert [path.name for path in (tmp_path / name).glob("*.db")] == ["memory.db"]
    assert [path.name for path in tmp_path.iterdir()] == [name]


@pytest.mark.parametrize(
    "name",
    ["", " ", "a b", "a,b", "a\nb", "a\x00b", "x\x1b[31m", "\u202eabc", "a\u200bb", "bu\u0308cher",
     "-a", "../a", ".a", "a=b", "a'b",
     "\ud800", "x" * (LONGEST_NAME + 1)],
)  # fmt: skip
def test_names_that_would_mislead(name: str, tmp_path: Path):
    with pytest.raises(ConfigurationError, match=r"cannot be the name of a bank.*of any language") as caught:
        check_bank(name)
    assert all(c.isprintable() for c in str(caught.value))
    with (
        Store.open(tmp_path / "m.db") as store,
        pytest.raises(ConfigurationError, match="cannot be the name of a bank"),
        store.writing(name, actor="a", now=0.0),
    ):
        pass
