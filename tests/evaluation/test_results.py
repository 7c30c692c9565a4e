import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from gvla2.errors import ConfigurationError, Gvla2Error
from gvla2.evaluation.results import Cell, Results, file_of


def cell(key: str, **factors) -> Cell:
    return Cell(key, {"object": "mug", **factors}, {"psnr": 20.0, "ssim": None}, {"status": "ok"})


def open_at(tmp_path) -> Results:
    return Results.open(f"sqlite:///{tmp_path}/deep/results.sqlite")


def test_cells_come_back_as_they_were(tmp_path):
    with open_at(tmp_path) as results:
        run = results.begin("s", tmp_path, "")
        results.add(run, "s", [cell("a", seed=0), cell("b", seed=1)])
    with open_at(tmp_path) as results:
        cells = results.cells("s")
        assert [c.key for c in cells] == ["a", "b"]
        assert cells[0].measures == {"psnr": 20.0, "ssim": None}
        assert cells[0].flat() == {"object": "mug", "seed": 0, "psnr": 20.0, "ssim": None, "status": "ok"}
        assert [c.key for c in results.cells("s", {"seed": ["1"]})] == ["b"]
        assert results.cells("s", runs=[run + 1]) == []
        assert results.cells("other") == []
        assert set(results.with_keys(["a", "zzz"])) == {"a"}
        assert [r.id for r in results.runs("s")] == [run]


def test_the_same_key_is_replaced(tmp_path):
    with open_at(tmp_path) as results:
        first, second = (results.begin("s", tmp_path, "") for _ in range(2))
        results.add(first, "s", [cell("a")])
        results.add(second, "s", [cell("a")])
        assert [c.run for c in results.cells("s")] == [second]


def test_two_benches_measure_into_one_new_database(tmp_path):
    ready = threading.Barrier(2)

    def bench(number: int) -> None:
        ready.wait()
        with open_at(tmp_path) as results:
            run = results.begin("s", tmp_path, "")
            for key in range(40):
                results.add(run, "s", [cell(str(key), bench=number)])

    with ThreadPoolExecutor(2) as both:
        list(both.map(bench, range(2)))
    with open_at(tmp_path) as results:
        assert len(results.cells("s")) == 40


def test_all_cells_of_one_call_or_none(tmp_path):
    broken = Cell("b", {"object": object()}, {}, {})
    with open_at(tmp_path) as results:
        run = results.begin("s", tmp_path, "")
        with pytest.raises(TypeError):
            results.add(run, "s", [cell("a"), broken])
        assert results.cells("s") == []


def test_addresses(tmp_path):
    assert file_of("sqlite:///a/b.sqlite").name == "b.sqlite"
    assert file_of("postgresql://robot@host/results") is None
    for wrong in ("sqlite://", "mysql://robot:hush@host/x", ""):
        with pytest.raises(ConfigurationError) as caught:
            Results.open(wrong)
        assert "hush" not in str(caught.value)


def test_a_file_that_is_no_database(tmp_path):
    path = tmp_path / "x.sqlite"
    path.write_text("this is a letter, not a database, and long enough to be distinguished" * 20)
    with pytest.raises(Gvla2Error, match="cannot be used"):
        Results.open(f"sqlite:///{path}")
    assert path.read_text().startswith("this is a letter")


def test_a_damaged_row_is_named(tmp_path):
    with open_at(tmp_path) as results:
        results.add(results.begin("s", tmp_path, ""), "s", [cell("a")])
    with sqlite3.connect(tmp_path / "deep" / "results.sqlite") as connection:
        connection.execute("UPDATE bench_row SET measures = '{'")
    connection.close()
    with open_at(tmp_path) as results, pytest.raises(Gvla2Error, match="damaged"):
        results.cells("s")


def test_several_machines_share_a_database_of_postgresql(postgres_url, tmp_path):
    with Results.open(postgres_url) as results:
        run = results.begin("s", tmp_path, "")
        results.add(run, "s", [cell("a", seed=0)])
        results.add(run, "s", [cell("a", seed=1)])
    with Results.open(postgres_url) as results:
        assert [c.factors["seed"] for c in results.cells("s")] == [1]
