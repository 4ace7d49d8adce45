"""Errors of estimated positions, and how well their covariances describe them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from star_core import AgentPhase, Array, Mask, Tick
from star_core.toolkit import some

FLYING, LOST = int(AgentPhase.FLYING), int(AgentPhase.LOST)
NEES_BATCH: Final = 64  # ticks whose errors are normalized together: one call costs as for one


class PositionErrors:
    """Compares estimated positions with ground truth.

    The position error is the distance in space between estimate and ground truth, unaligned, from
    the end of an agent's take-off to the start of its landing. NEES, the mean of the squared error
    over the covariance of the estimate per degree of freedom, is 1 if the covariance is right;
    a localizer with a greater value is overconfident.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._up = np.zeros(len(names), np.bool_)  # between take-off and landing, lost or not
        self._errors: list[tuple[Mask, Array]] = []  # (N,) squared, m²
        self._offsets: list[tuple[Array, Array]] = []  # with their covariances, for NEES
        self._worst = 0.0  # m
        self._nees = 0.0
        self._normalized = 0

    def add(self, tick: Tick) -> None:
        """Add the errors of a tick that has a ground truth."""
        phase = tick.health.phase
        self._up = (phase == FLYING) | (self._up & (phase == LOST))
        if tick.truth is not None and some(self._up):
            offset = tick.estimate.position - tick.truth.position
            self._add(offset, tick.estimate.covariance)

    def summary(self) -> dict[str, Any]:
        """Return the figures of the flight; None if there was no ground truth or no flight."""
        self._add_nees()
        mse = self._mse()
        return {
            "position_mse_m2": mse,
            "position_rmse_m": None if mse is None else float(np.sqrt(mse["mean"])),
            "position_worst_m": self._worst if self._errors else None,
            "position_nees": self._nees / self._normalized if self._normalized else None,
        }

    def _mse(self) -> Mapping[str, Any] | None:
        """Return mean and deviation over all agents, and the mean of each agent, m²."""
        if not self._errors:
            return None
        flying = np.array([mask for mask, _ in self._errors])  # (T, N)
        squared = np.where(flying, np.array([error for _, error in self._errors]), np.nan)
        samples = squared[flying]
        return {
            "mean": float(np.mean(samples)),
            "std": float(np.std(samples)),
            "per_agent": {
                name: float(np.mean(squared[flying[:, i], i])) if flying[:, i].any() else None
                for i, name in enumerate(self._names)
            },
        }

    def _add(self, offset: Array, covariance: Array) -> None:
        """Add the (N, 3) errors of an estimate, m, with their (N, 3, 3) covariance, m²."""
        squared = np.vecdot(offset, offset)
        counted = self._up & np.isfinite(squared)
        number = np.count_nonzero(counted)
        if not number:
            return
        self._errors.append((counted, squared))
        every = number == len(counted)
        worst = max(squared.tolist()) if every else float(squared[counted].max())
        self._worst = max(self._worst, math.sqrt(worst))
        if not every:
            offset, covariance = offset[counted], covariance[counted]
        self._offsets.append((offset, covariance))
        if len(self._offsets) == NEES_BATCH:
            self._add_nees()

    def _add_nees(self) -> None:
        """Add the squared errors of some ticks, normalized by their covariances."""
        if not self._offsets:
            return
        offset, covariance = (np.concatenate(column) for column in zip(*self._offsets, strict=True))
        self._offsets.clear()
        usable = np.isfinite(offset.sum(axis=1) + covariance.sum(axis=(1, 2)))
        usable &= np.linalg.det(covariance) > 0
        if usable.any():
            offset = offset[usable][..., None]
            squares = offset.transpose(0, 2, 1) @ np.linalg.solve(covariance[usable], offset)
            self._nees += float(squares.sum()) / 3
            self._normalized += int(usable.sum())
