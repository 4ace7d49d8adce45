"""The table of a study is read with its types."""

from __future__ import annotations

from pathlib import Path

import pytest

from star_core import InputError, read_study
from star_core.toolkit import StudyFlight, StudyResults

MEASURES = ("count", "length_m", "done", "list", "text")


def flight(seed: int, summary: dict[str, object] | None) -> StudyFlight:
    return StudyFlight("hop", {"radius": "0.25"}, seed, "completed", "", 1.5, summary)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    summary: dict[str, object] = dict(zip(MEASURES, (3, 0.1 + 0.2, True, [1], "7 m"), strict=True))
    results = StudyResults((flight(0, summary), flight(12, None)))
    (tmp_path / "results.csv").write_text(results.as_csv(["radius"], MEASURES))
    return tmp_path


def test_values_keep_their_types_and_precision(folder: Path) -> None:
    table = read_study(folder)
    assert list(table)[:5] == ["mission", "radius", "seed", "outcome", "reason"]
    assert (table["mission"], table["radius"], table["seed"]) == (
        ["hop", "hop"],
        ["0.25", "0.25"],
        [0, 12],
    )
    assert [table[name][0] for name in MEASURES] == [3, 0.1 + 0.2, True, "[1]", "7 m"]
    assert [table[name][1] for name in MEASURES] == [None] * 5


def test_the_table_is_one_for_pandas(folder: Path) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(read_study(str(folder)))
    assert frame.shape[0] == 2
    assert frame.groupby("mission")["length_m"].mean()["hop"] == 0.1 + 0.2


def test_a_study_without_flights_has_its_columns(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text(StudyResults(()).as_csv(["radius"], ["a"]))
    assert read_study(tmp_path)["a"] == []


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"a,b\n1,2\n",
        b"mission,seed\n",
        b"mission,seed,outcome,reason,a,a\n",
        b"mission,seed,outcome,reason\nhop\n",
        b"\xff\xfe",
    ],
)
def test_another_table_is_refused(text: bytes, tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_bytes(text)
    with pytest.raises(InputError, match=r"results\.csv: .* \[no-record\]"):
        read_study(tmp_path)


def test_a_folder_without_a_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"results\.csv.* \[no-record\]"):
        read_study(tmp_path)
