"""Results are tabulated in full for machines, and summed up for people."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from star_ablate.flight import Result
from star_ablate.journal import Journal
from star_ablate.results import as_markdown, finite, statistics, study_results
from star_ablate.study import Condition, Run, Study
from star_core.toolkit import value_at

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
    return study_results(flown, interrupted=False).as_csv(study.factors, study.measures)


# The spread of a measure


@given(st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20).filter(lambda x: len(set(x)) > 1))
def test_the_interval_is_that_of_students_t(values: list[float]) -> None:
    found = statistics(values)
    expected = stats.ttest_1samp(values, 0).confidence_interval(0.95)
    assert found.mean - found.half_width == pytest.approx(expected.low, rel=1e-6, abs=1e-6)
    assert found.mean + found.half_width == pytest.approx(expected.high, rel=1e-6, abs=1e-6)


def test_a_single_value_has_no_deviation() -> None:
    found = statistics([3.0])
    assert (found.n, found.mean) == (1, 3.0)
    assert math.isnan(found.std)
    assert math.isnan(found.half_width)


def test_what_is_no_number_is_not_summed_up() -> None:
    assert finite([1, 2.5, True, None, "x", math.nan, math.inf]) == [1.0, 2.5, 1.0]


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


# results.md


def test_a_measure_is_summed_up_over_seeds() -> None:
    page = as_markdown(a_study("a"), results({"a": 1.0}, {"a": 3.0}))
    assert "| mission | avoider | n | completed | a |" in page
    assert "| hop | orca | 2 | 100% | 2 ± 1.41 [-10.7, 14.7] |" in page


def test_a_measure_that_some_runs_lack_shows_how_many_have_it() -> None:
    page = as_markdown(a_study("a", seeds=3), results({"a": 1.0}, {"a": 3.0}, {"a": None}))
    assert "| 2 ± 1.41 [-10.7, 14.7] (n 2) |" in page


def test_large_numbers_are_written_to_the_unit() -> None:
    assert "| 123457 |" in as_markdown(a_study("a"), results({"a": 123456.7}))


def test_a_study_that_is_not_finished_reports_it() -> None:
    page = as_markdown(a_study("a"), results({"a": 1.0}))
    assert "1 of 2 runs: 1 conditions, 2 seeds each." in page


def test_a_study_whose_missions_have_own_seeds_reports_it() -> None:
    page = as_markdown(replace(a_study("a"), seeds=None), results({"a": 1.0}))
    assert "1 of 1 runs: 1 conditions, own seeds." in page


def test_a_condition_without_runs_stands_in_the_table() -> None:
    assert "| hop | orca | 0 | - | - |" in as_markdown(a_study("a"), [])


def test_a_reason_cannot_break_the_table() -> None:
    run = Run(CONDITION, 0, "key")
    page = as_markdown(a_study(), [(run, Result("failed", "a|b\nc", 1.0, None))])
    assert "| hop, avoider: orca, seed 0 | failed | a\\|b c |" in page


# The journal


def test_a_journal_gives_back_what_left_a_summary(tmp_path: Path) -> None:
    ((first, flew), (second, _)) = results({"a": 0.1}, {"a": 2})
    with closing(Journal(tmp_path / "runs.jsonl")) as journal:
        journal.add(first, flew)
        journal.add(second, Result("crashed", "gone", 1.0, None))
    with closing(Journal(tmp_path / "runs.jsonl")) as journal:
        assert journal.done == {"key-0": flew}


def test_a_line_that_was_not_finished_costs_its_own_run_only(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    ((first, flew), (second, flew_too)) = results({"a": 1}, {"a": 2})
    with closing(Journal(path)) as journal:
        journal.add(first, flew)
        journal.add(second, flew_too)
    path.write_text(path.read_text()[:-9])
    with closing(Journal(path)) as journal:
        assert list(journal.done) == ["key-0"]
        journal.add(second, flew_too)
    with closing(Journal(path)) as journal:
        assert list(journal.done) == ["key-0", "key-1"]


@given(st.text())
def test_any_text_is_a_journal(text: str) -> None:
    from star_ablate.journal import _parsed

    assert _parsed(text) is None or cast(Any, _parsed(text))[0]
