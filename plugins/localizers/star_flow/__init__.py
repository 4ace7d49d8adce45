"""A localizer that trusts the on-board estimate: no tags, so it drifts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from star_core import LocalizerSpec, deferred, hookimpl
from star_core.toolkit import number, positive

OPTIONS: dict[str, Any] = {
    "type": "object",
    "properties": {
        "max_report_age": positive("Age up to which an agent's report is valid, s.", default=0.5),
        "error_std": number(
            "For studies: standard deviation along each axis of an artificial "
            "position error, m; its variance is part of the covariance.",
            minimum=0,
            default=0.0,
        ),
        "error_time_constant": positive(
            "For studies: correlation time of the artificial error, s.", default=1.0
        ),
        "latency": number(
            "Time from exposure to arrival, for on-board tag detections without a timestamp, s.",
            minimum=0,
            maximum=2,
            default=0.15,
        ),
    },
}


@hookimpl
def star_localizers() -> Iterable[LocalizerSpec]:
    yield LocalizerSpec(
        name="flow",
        summary="Trust the on-board estimate from where each agent started; it drifts.",
        make=deferred("star_flow.localizer:Flow"),
        options=OPTIONS,
        corrects_heights=True,
        edge_clearance=0.5,  # benchmarks/heights.py
        drift=deferred("star_flow.drift:expected_std"),
    )
