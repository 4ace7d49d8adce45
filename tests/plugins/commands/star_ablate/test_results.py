"""Results are tabulated in full for machines, and summed up for people."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st

from star_ablate.flight import Result
from star_ablate.journal import Journal
from star_ablate.study import Condition, Run, Study
from star_core.toolkit import StudyResults, value_at

NO_MISSION: Any = None
CONDITION = Condition("hop", {"avoider": "orca"}, NO_MISSION)


def a_study(*measures: str, seeds: int = 2) -> Study:
    return Study("s", ("avoider",), (CONDITION,), tuple(range(seeds)), measures, None, {})


def results(*summaries: Any) -> list[tuple[Run, Result]]:
    return [
        (Run(CONDITION, seed, f"key-{seed}"), Result("completed", "", 1.23456, summary))
        for seed, summary in enumerate(summaries)
    ]


def as_csv(study: Study, flown: list[tuple[Run, Result]]) -> str:
    flights = tuple(run.flight(result) for run, result in flown)
    return StudyResults(flights, interrupted=False).as_csv(study.factors, study.measures)


@pytest.mark.parametrize(
    ("path", "value"), [("a.b", 3), ("a", {"b": 3}), ("a.c", None), ("a.b.c", None), ("d", None)]
)
def test_a_measure_is_found_by_its_path(path: str, value: object) -> None:
    assert value_at({"a": {"b": 3}}, path) == value


# results.csv


def test_numbers_stand_in_full_in_the_table() -> None:
    table = as_csv(a_study("a.b", "c"), results({"a": {"b": 1 / 3}, "c": None}))
    assert table.splitlines() == [
        "mission,avoider,seed,outcome,reason,a.b,c",
        "hop,orca,0,completed,,0.3333333333333333,",
    ]


def test_what_is_a_column_already_is_not_there_twice() -> None:
    heading = as_csv(a_study("outcome", "a"), []).splitlines()[0]
    assert heading == "mission,avoider,seed,outcome,reason,a"


def test_maps_and_lists_stand_as_json() -> None:
    table = as_csv(a_study("a", "b"), results({"a": {"x": 1}, "b": [True]}))
    assert table.splitlines()[1] == 'hop,orca,0,completed,,"{""x"": 1}",[true]'


# The journal


def test_a_journal_gives_back_what_left_a_summary(tmp_path: Path) -> None:
    ((first, flew), (second, _)) = results({"a": 0.1}, {"a": 2})
    with closing(Journal(tmp_path / "runs.jsonl", [first], ["a"])) as journal:
        journal.add(first, flew)
        journal.add(second, Result("crashed", "gone", 1.0, None))
    with closing(Journal(tmp_path / "runs.jsonl", [first], ["a"])) as journal:
        assert journal.done == {"key-0": flew}


def test_a_line_that_was_not_finished_costs_its_own_run_only(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    ((first, flew), (second, flew_too)) = results({"a": 1}, {"a": 2})
    with closing(Journal(path, [first, second], ["a"])) as journal:
        journal.add(first, flew)
        journal.add(second, flew_too)
    path.write_text(path.read_text()[:-9])
    with closing(Journal(path, [first, second], ["a"])) as journal:
        assert list(journal.done) == ["key-0"]
        journal.add(second, flew_too)
    with closing(Journal(path, [first, second], ["a"])) as journal:
        assert list(journal.done) == ["key-0", "key-1"]


@given(st.text())
def test_any_text_is_a_journal(text: str) -> None:
    from star_ablate.journal import _parsed

    assert _parsed(text) is None or cast(Any, _parsed(text))[0]
