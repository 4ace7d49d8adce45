"""Errors of positions that a rehearsal expects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from star_core import Registry, load
from star_explain.uncertainty import GROWTH, PERIOD, Uncertainty

MISSIONS = Path(__file__).parents[4] / "missions"


@pytest.fixture
def uncertainty() -> Uncertainty:
    registry = Registry()
    return Uncertainty(load(MISSIONS / "first_flight.yaml", registry), registry)


def advance(uncertainty: Uncertainty, begin: float, end: float) -> None:
    for time in np.arange(begin, end, PERIOD / 2):
        uncertainty.add(time, np.full((3, 3), 0.2 * time), np.zeros(3))


def test_errors_grow_along_the_path(uncertainty: Uncertainty) -> None:
    advance(uncertainty, 0.0, 5.0)
    early = uncertainty.std()
    advance(uncertainty, 5.0, 30.0)
    assert (uncertainty.std() > 1.5 * early).all()


def test_errors_are_kept_until_they_are_due(uncertainty: Uncertainty) -> None:
    advance(uncertainty, 0.0, 10.0)
    first = uncertainty.std()
    advance(uncertainty, 10.0, GROWTH * 10.0 - PERIOD)
    assert uncertainty.std() is first
