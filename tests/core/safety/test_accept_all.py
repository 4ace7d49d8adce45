"""The kernel of the estimate gate does what its readable method does, and no more."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from star_core import Telemetry, Transform
from star_core.safety.estimate_gate import EstimateGate
from star_core.testing import estimate

N, PERIOD = 3, 0.05  # s
STATE = (
    "_last_position", "_last_velocity", "_time", "_position", "_covariance", "_unexplained",
    "_rejected", "_corrected", "_flown", "_range", "_still_path", "_reports", "_spoiled_until",
    "_above", "_last_time",
)  # fmt: skip


def values(gate: EstimateGate) -> list[Any]:
    return [np.array(getattr(gate, name)) for name in STATE] + [gate._frames.yaw]


@pytest.mark.parametrize("seed", range(8))
def test_the_kernel_agrees_with_the_readable_check(seed: int) -> None:
    rng = np.random.default_rng(seed)
    quick, readable = EstimateGate(N, 0.5), EstimateGate(N, 0.5)
    position, quiet, loud = rng.normal(size=(N, 3)), 0, 0
    for tick in range(200):
        velocity = rng.choice(
            [0.0, 0.2, 0.5, np.nan, 9.0], (N, 3), p=[0.3, 0.35, 0.349, 0.0005, 0.0005]
        )
        moved = PERIOD * np.nan_to_num(velocity) * (rng.random() < 0.9)
        position = position + moved + (rng.random((N, 1)) < 0.004) * rng.normal(size=(N, 3))
        now = replace(
            estimate(position, time=PERIOD * tick),
            valid=rng.random(N) < 0.95,
            covariance=rng.uniform(0.01, 0.02) * np.tile(np.eye(3), (N, 1, 1)),
            map_from_odom=Transform(rng.normal(size=N), np.zeros((N, 3))),
        )
        height = position[:, 2] + 0.02 * rng.normal(size=N)
        heights = np.column_stack([np.zeros((N, 2)), height])
        level = np.tile([0.0, 0.0, 0.0, 1.0], (N, 1))
        unknown, state = np.full(N, np.nan), np.zeros(N, np.int64)
        reports = Telemetry(now.time, heights, velocity, level, unknown, state, np.zeros(N))
        airborne, heard = np.full(N, tick > 20), rng.random(N) < 0.95
        before = values(quick)
        accepted = quick.accepts(now, reports, airborne, heard)
        if not accepted:
            for one, other in zip(values(quick), before, strict=True):
                np.testing.assert_array_equal(one, other)
        known = np.where(heard[:, None], velocity, np.nan), heard, np.where(heard, height, np.nan)
        checked, jumps = readable.check(now, airborne, *known)
        if accepted:
            quiet += 1
            assert checked is now
            assert not jumps
        else:
            loud += 1
            quick.check(now, airborne, *known)
        for one, other in zip(values(quick), values(readable), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    assert quiet > 20
    assert loud > 0
