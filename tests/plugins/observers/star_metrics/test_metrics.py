"""Known tracks, and what is measured of a flight along them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from star_basics.summary_text import format_summary
from star_core import AgentPhase, Registry, fly, load
from star_core.testing import scene
from star_metrics.metrics import FlightMetrics
from tests.core.records.test_summary import FLYING, LANDING, PERIOD, apart, tick

KEYS = (
    *("deadlocks", "waits", "jams", "path_length_m"),
    *("position_mse_m2", "position_rmse_m", "position_worst_m", "position_nees"),
)


def measured(
    truth: Any,
    *,
    estimate: Any = None,
    phases: Sequence[AgentPhase] | None = None,
    has_truth: bool = True,
) -> dict[str, Any]:
    """What is measured of a flight of ticks 0.05 s apart.

    Args:
        truth: (T, N, 3) positions of the agents, m.
        estimate: (T, N, 3) estimated positions, m; the true ones if not given.
        phases: (T) the phase of all agents at each tick; flying if not given.
        has_truth: Whether there is a ground truth.
    """
    track = np.array(truth, np.float64)
    t, n, _ = track.shape
    metrics = FlightMetrics(scene(n), print)
    for k in range(t):
        phase = [FLYING if phases is None else phases[k]] * n
        where = track[k] if estimate is None else np.array(estimate)[k]
        metrics.star_ticked(tick(k * PERIOD, where, track[k] if has_truth else None, phase))
    return metrics.star_summary()


def test_the_error_is_in_space() -> None:
    summary = measured([[[0, 0, 1]]], estimate=[[[0.2, 0.3, 1.6]]])
    assert summary["position_rmse_m"] == pytest.approx(0.7)
    assert summary["position_worst_m"] == pytest.approx(0.7)


def test_position_error_is_estimate_minus_truth() -> None:
    truth = [[[0, 0, 1], [0, 1, 1]]] * 2
    estimate = [[[0, 0, 1], [0.3, 1.4, 1]], [[0, 0, 1], [0, 1, 1]]]
    summary = measured(truth, estimate=estimate)
    assert summary["position_mse_m2"] == {
        "mean": pytest.approx(0.25 / 4),
        "std": pytest.approx(np.std([0, 0.25, 0, 0])),
        "per_agent": {"cf1": 0.0, "cf2": pytest.approx(0.125)},
    }
    assert summary["position_rmse_m"] == pytest.approx(0.25)
    assert summary["position_worst_m"] == pytest.approx(0.5)


def test_position_error_counts_located_ticks_of_lost_agents() -> None:
    truth = [[[0.0, 0.0, 1.0]]] * 5
    unknown = [[np.nan, 0.0, 1.0]]
    estimate = [[[7.0, 0.0, 1.0]], [[0.5, 0.0, 1.0]], [[1.5, 0.0, 1.0]], unknown, [[9.0, 0.0, 1.0]]]
    phases = [AgentPhase.LOST, FLYING, AgentPhase.LOST, AgentPhase.LOST, LANDING]
    summary = measured(truth, estimate=estimate, phases=phases)
    assert summary["position_mse_m2"]["mean"] == pytest.approx((0.25 + 2.25) / 2)
    assert summary["position_worst_m"] == pytest.approx(1.5)


def test_position_error_excludes_takeoff_and_landing() -> None:
    truth = [[[0.0, 0.0, 1.0]]] * 4
    estimate = [[[9.0, 0.0, 1.0]], [[0.5, 0.0, 1.0]], [[0.5, 0.0, 1.0]], [[9.0, 0.0, 1.0]]]
    phases = [AgentPhase.TAKING_OFF, FLYING, FLYING, LANDING]
    assert measured(truth, estimate=estimate, phases=phases)["position_rmse_m"] == pytest.approx(
        0.5
    )


def test_an_agent_that_never_flew_has_no_position_error() -> None:
    metrics = FlightMetrics(scene(2), print)
    both = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    metrics.star_ticked(tick(0.0, both, both, [FLYING, AgentPhase.GROUNDED]))
    summary = metrics.star_summary()
    assert summary["position_mse_m2"]["per_agent"] == {"cf1": 0.0, "cf2": None}


@pytest.mark.parametrize("phase", [FLYING, LANDING])
def test_position_error_is_none_without_truth_or_flight(phase: AgentPhase) -> None:
    summary = measured(apart(1.0), phases=[phase], has_truth=phase is LANDING)
    assert (summary["position_mse_m2"], summary["position_rmse_m"]) == (None, None)


def test_the_path_is_as_long_as_its_legs_together() -> None:
    track = [[[0, 0, 0], [5, 5, 0]], [[3, 4, 0], [5, 5, 0]], [[3, 4, 2], [5, 6, 0]]]
    assert measured(track)["path_length_m"] == {
        "total": pytest.approx(8.0),
        "per_agent": {"cf1": pytest.approx(7.0), "cf2": pytest.approx(1.0)},
    }


def test_the_path_leaves_out_where_an_agent_was_nowhere() -> None:
    track = [[[0, 0, 0]], [[1, 0, 0]], [[np.nan] * 3], [[5, 0, 0]], [[5, 2, 0]]]
    assert measured(track, has_truth=False)["path_length_m"]["total"] == pytest.approx(3.0)


@pytest.mark.parametrize(("other", "total"), [(0.0, 1.0), (np.nan, None)])
def test_path_length_is_unknown_if_never_located(other: float, total: float | None) -> None:
    track = [[[np.nan] * 3, [other, x, 0]] for x in (0.0, 0.5, 1.0)]
    assert measured(track)["path_length_m"] == {
        "total": total,
        "per_agent": {"cf1": None, "cf2": total},
    }


def test_a_flight_without_a_tick_has_measures_too() -> None:
    summary = FlightMetrics(scene(2), print).star_summary()
    assert summary["path_length_m"]["total"] == 0.0
    assert summary["position_rmse_m"] is None


def test_flights_without_the_plugin_have_no_measures(
    missions: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STAR_BLOCK_PLUGINS", "mcap,metrics")
    registry = Registry()
    summary = fly(load(missions / "first_flight.yaml", registry), registry)
    assert summary["outcome"] == "completed"
    assert not {*KEYS} & {*summary}
    assert "flown" not in format_summary(summary, None)
