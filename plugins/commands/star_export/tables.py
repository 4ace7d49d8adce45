"""The files of an export: names and contents."""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np

from star_core import Array, Mask, Run

AXES = "xyzw"


def csv_files(run: Run) -> Iterator[tuple[str, str]]:
    """Yield a table for each agent: ``time``, and a column for each component of each array."""
    time = run.arrays["time"]
    for i, name in enumerate(run.agents):
        columns = {"time": time}
        for key, array in run.arrays.items():
            if key == "time":
                continue
            of_agent = array[:, i].astype(float)
            if of_agent.ndim == 1:
                columns[key] = of_agent
            else:
                columns |= {f"{key}_{AXES[k]}": of_agent[:, k] for k in range(of_agent.shape[1])}
        yield f"{name}.csv", ",".join(columns) + "\n" + _lines(list(columns.values()), ",")


def tum_files(run: Run) -> Iterator[tuple[str, str]]:
    """Yield the trajectories of each agent in the map, as the TUM RGB-D benchmark defines them.

    The estimate's attitude is its heading. The ground truth is that between take-off and landing,
    from which the summary's position error is computed.
    """
    time, estimate = run.arrays["time"], run.arrays["estimate_position"]
    half = 0.5 * run.arrays["estimate_yaw"]
    level = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=2)
    flying = run.in_flight()
    for i, name in enumerate(run.agents):
        finite = np.isfinite(estimate[:, i].sum(axis=1) + half[:, i])
        yield f"{name}-estimate.tum", _poses(time, estimate[:, i], level[:, i], finite)
        if "truth_position" in run.arrays:
            true, attitude = run.arrays["truth_position"][:, i], run.arrays["truth_attitude"][:, i]
            finite = np.isfinite(attitude).all(axis=1, keepdims=True)  # may be positions only
            attitude = np.where(finite, attitude, [0.0, 0.0, 0.0, 1.0])
            counted = flying[:, i] & np.isfinite((estimate[:, i] - true).sum(axis=1))
            yield f"{name}-ground_truth.tum", _poses(time, true, attitude, counted)


def _poses(time: Array, position: Array, attitude: Array, rows: Mask) -> str:
    return _lines([time[rows], *position[rows].T, *attitude[rows].T], " ")


def _lines(columns: list[Array], separator: str) -> str:
    text = io.StringIO()
    np.savetxt(text, np.column_stack(columns), fmt="%.9g", delimiter=separator)
    return text.getvalue()
