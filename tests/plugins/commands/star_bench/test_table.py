"""What is reported of single flights, and how the table sums it up."""

from __future__ import annotations

import csv
from io import StringIO
from typing import Any

import pytest

from star_bench.scenario import Scenario, level
from star_bench.table import (
    COLUMNS,
    LEGEND,
    Key,
    Metrics,
    as_csv,
    as_markdown,
    metrics,
    path_ratio,
    rows,
    time_ratio,
)
from star_core.toolkit import StudyFlight
from star_metrics.deadlocks import MAX_WAIT, WAITING_DISTANCE

TWO = level([(0, 0), (0, 5)], [(3, 4), (1, 5)], about="Two go 5 m and 1 m.")
TWICE = Scenario(
    "One goes up 1 m, back 2 m.", ((0, 0),), (1.0,), (((1, 0, 1.0),), ((-1, 0, 1.0),)), (0, 0),
    (0, 0),
)  # fmt: skip
KEY = Key("orca", "circle", "2", "ideal", "exact")


def step(name: str, begun: float, ended: float, **more: Any) -> dict[str, Any]:
    times = {"begun_s": begun, "ended_s": ended}
    return {"verb": "goto", "agents": [name], "outcome": "success", **times, **more}


def flown(outcome: str = "completed", **measures: Any) -> StudyFlight:
    """A flight of a study with some measures, with ``__`` for a dot."""
    summary: dict[str, Any] = {
        "collisions": {"agent_agent": 0, "agent_obstacle": 0},
        "min_separation_m": 0.4,
    }
    for path, value in measures.items():
        key, _, inner = path.partition("__")
        summary[key] = {**summary.get(key, {}), inner: value} if inner else value
    return StudyFlight("a", {}, 0, outcome, "", 1.0, summary)


def flight(**figures: float | None) -> Metrics:
    """The metrics of a flight; their names are the first words of columns."""
    metrics: dict[str, float | None] = {"runs": 1, "success": 1.0}
    for name, value in figures.items():
        words = name.replace("agent_agent", "agent-agent").replace("_", " ")
        metrics[next(column for column in COLUMNS if column.startswith(words))] = value
    return metrics


def cells(*flights: Metrics) -> dict[str, float | None]:
    ((_, figures), _) = rows([(KEY, run) for run in flights])
    return dict(zip(COLUMNS, figures, strict=True))


# Metrics of one flight


def test_the_time_ratio_is_that_of_the_last_to_arrive() -> None:
    steps = [step("d1", 10.0, 22.0), step("d2", 10.0, 25.0)]
    assert time_ratio(steps, TWO, speed=0.5) == 15.0 / (1.0 / 0.5)
    steps = [step("d1", 10.0, 26.0), step("d2", 10.0, 25.0)]
    assert time_ratio(steps, TWO, speed=0.5) == 16.0 / (5.0 / 0.5)


def test_the_time_ratio_takes_all_legs_together() -> None:
    steps = [step("d1", 0.0, 4.0), step("d1", 4.0, 10.0)]
    assert time_ratio(steps, TWICE, speed=0.5) == 10.0 / (3.0 / 0.5)


@pytest.mark.parametrize(
    "steps",
    [
        [],
        [step("d1", 0.0, 9.0)],
        [step("d1", 0.0, 9.0), step("d2", 0.0, 9.0, outcome="failure")],
        [step("d1", 0.0, 9.0), step("d2", 0.0, 9.0, verb="takeoff")],
    ],
)
def test_there_is_no_time_ratio_if_an_agent_did_not_arrive(steps: list[dict[str, Any]]) -> None:
    assert time_ratio(steps, TWO, speed=0.5) is None


def test_the_path_ratio_leaves_out_climb_and_descent() -> None:
    assert path_ratio({"d1": 7.5 + 2.0, "d2": 1.5 + 2.0}, TWO) == pytest.approx(9.0 / 6.0)


def test_there_is_no_path_ratio_without_all_lengths_or_a_way() -> None:
    still = level([(0, 0)], [(0, 0)], about="No agent moves.")
    assert path_ratio({"d1": 7.5}, TWO) is None
    assert path_ratio({"d1": 7.5}, still) is None


@pytest.mark.parametrize(
    ("changes", "success"),
    [
        ({}, True),
        ({"outcome": "failed"}, False),
        ({"collisions__agent_agent": 1}, False),
        ({"collisions__agent_obstacle": 1}, False),
        ({"collisions__agent_agent": None}, False),
    ],
)
def test_a_flight_succeeds_if_it_completes_and_nothing_is_hit(
    changes: dict[str, Any],
    success: bool,  # noqa: FBT001 -- what is expected
) -> None:
    assert metrics(flown(**changes), TWO, 0.5)["success"] == success


def test_figures_are_read_from_the_summary() -> None:
    figures = metrics(
        flown(
            deadlocks=2,
            waits=7,
            min_clearance_m=0.25,
            corrected={"fence": 1, "speed": 0, "separation": 4},
            compute_us={"avoider": 12.5, "planner": 3.0},
            steps=[step("d1", 0.0, 20.0), step("d2", 0.0, 4.0)],
            path_length_m__per_agent={"d1": 7.0, "d2": 3.0},
        ),
        TWO,
        0.5,
    )
    assert (figures["deadlocks"], figures["waits"]) == (2, 7)
    assert (figures["min separation (m)"], figures["min clearance (m)"]) == (0.4, 0.25)
    assert (figures["time ratio"], figures["path ratio"]) == (2.0, 1.0)
    assert figures["corrected"] == 5
    times = [figures[f"{plugin} (us)"] for plugin in ("avoider", "planner", "localizer", "safety")]
    assert times == [12.5, 3.0, None, None]


def test_what_a_summary_does_not_have_is_not_known() -> None:
    figures = metrics(flown(), TWO, 0.5)
    names = {name for name, value in figures.items() if value is not None}
    assert names == {
        "runs",
        "success",
        "agent-agent collisions",
        "agent-obstacle collisions",
        "min separation (m)",
    }


def test_a_flight_that_did_not_complete_has_no_path_ratio() -> None:
    lengths = {"d1": 7.0, "d2": 3.0}
    figures = metrics(flown(outcome="failed", path_length_m__per_agent=lengths), TWO, 0.5)
    assert figures["path ratio"] is None


# The table


def test_counts_are_sums_distances_least_and_ratios_means() -> None:
    totals = cells(
        flight(
            agent_agent_collisions=1,
            deadlocks=2,
            waits=4,
            min_separation=0.3,
            time_ratio=1.5,
            path_ratio=1.2,
        ),
        flight(
            agent_agent_collisions=3,
            deadlocks=0,
            waits=1,
            min_separation=0.2,
            time_ratio=2.5,
            path_ratio=1.4,
        ),
    )
    assert totals["runs"] == 2
    assert (totals["agent-agent collisions"], totals["deadlocks"], totals["waits"]) == (4, 2, 5)
    assert totals["min separation (m)"] == 0.2
    assert (totals["time ratio"], totals["path ratio"]) == pytest.approx((2.0, 1.3))


def test_success_is_the_share_of_flights() -> None:
    assert cells(flight(success=True), flight(success=False))["success"] == 0.5


def test_what_some_flights_lack_is_summed_up_over_the_others() -> None:
    totals = cells(flight(time_ratio=1.5, min_separation=None), flight(time_ratio=None))
    assert totals["time ratio"] == 1.5
    assert totals["min separation (m)"] is None


def test_compute_is_a_mean_for_each_part() -> None:
    means = cells(flight(avoider=1.0, planner=2.0), flight(avoider=3.0))
    assert (means["avoider (us)"], means["planner (us)"]) == (2.0, 2.0)


def test_flights_are_grouped_and_pooled_by_avoider_and_setting() -> None:
    keys = [
        Key("none", "circle", "2", "ideal", "exact"),
        Key("none", "disc", "2", "ideal", "exact"),
        Key("none", "disc", "2", "default", "flow"),
        Key("orca", "circle", "2", "ideal", "exact"),
    ]
    table = rows([(key, flight(agent_agent_collisions=1)) for key in keys])
    pooled = {
        tuple(key): line[list(COLUMNS).index("agent-agent collisions")]
        for key, line in table[len(keys) :]
    }
    assert [key for key, _ in table[: len(keys)]] == keys
    assert pooled == {
        ("none", "all", "all", "ideal", "exact"): 2,
        ("none", "all", "all", "default", "flow"): 1,
        ("orca", "all", "all", "ideal", "exact"): 1,
    }


def test_the_page_shows_what_is_not_known_as_a_dash() -> None:
    page = as_markdown(rows([(KEY, flight(agent_agent_collisions=0, min_separation=0.4))]))
    key = "| orca | circle | 2 | ideal | exact | 1 |"
    assert f"{key} 100.0% | 0 | - | - | - | 0.40 | - | - | - | - | - |" in page


def test_the_page_explains_its_columns() -> None:
    page = as_markdown(rows([(KEY, flight())]))
    lines = page.splitlines()
    assert lines[0].count("|") == lines[1].count("|") == lines[2].count("|")
    assert "Time ratio: " in page


def test_page_states_the_thresholds_that_count_waits() -> None:
    words = " ".join(LEGEND.split())
    assert f"makes no progress for {MAX_WAIT:g} s" in words
    assert f"ahead of it within {WAITING_DISTANCE:g} m" in words


def test_csv_has_full_precision_and_blanks_for_unknown_values() -> None:
    (first, _) = csv.DictReader(StringIO(as_csv(rows([(KEY, flight(min_separation=1 / 3))]))))
    assert first["min separation (m)"] == "0.3333333333333333"
    assert first["min clearance (m)"] == ""
    assert first["planner (us)"] == ""
