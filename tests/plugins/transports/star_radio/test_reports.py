"""State reports are decoded whatever their bits are."""

from __future__ import annotations

import numpy as np
import pytest

from star_core import Frames, Supervisor
from star_fleet.variables import VARIABLES
from star_radio.connection.link import Link
from star_radio.connection.tables import Entry
from star_radio.report import BLOCK, Layout, flying
from star_radio.telemetry import TelemetryBuffer
from star_radio.vehicle import Vehicle

LAYOUT = Layout.of({entry.name: Entry(i, entry.code) for i, entry in enumerate(VARIABLES)})


@pytest.mark.parametrize(
    "bits", [0x7C00, 0xFC00, 0x7E00, 0x7C01], ids=["inf", "-inf", "NaN", "sNaN"]
)
def test_values_that_are_no_numbers_are_unknown(bits: int) -> None:
    report = np.zeros(1, LAYOUT.dtype)
    halves = [name for name in LAYOUT.dtype.names or () if LAYOUT.dtype[name] == np.float16]
    for name in halves:
        report.view(np.uint8)[LAYOUT.dtype.fields[name][1] :][:2] = [bits & 0xFF, bits >> 8]  # type: ignore[index]
    report["block"] = BLOCK
    vehicle = Vehicle("cf1", Link("udp://127.0.0.1:1", "cf1"))
    vehicle.stream.layout = LAYOUT
    vehicle.stream._take(report.tobytes(), 1.0)
    telemetry = TelemetryBuffer([vehicle]).gather(0.0, Frames.none())
    assert np.isnan(telemetry.attitude).all()
    assert np.isfinite(telemetry.position).all()


@pytest.mark.parametrize(
    ("commander", "height", "flies"),
    [
        (Supervisor(0), 0.0, True),  # it begins to climb
        (Supervisor.COMMANDER_FINISHED, 0.05, False),  # it has landed
        (Supervisor.COMMANDER_FINISHED, 0.5, True),
        (Supervisor.COMMANDER_FINISHED, np.nan, True),
        (Supervisor.COMMANDER_ACTIVE, np.nan, True),
        (Supervisor.COMMANDER_ACTIVE | Supervisor.COMMANDER_FINISHED, 0.0, True),
    ],
)
def test_a_drone_flies_unless_it_is_low_and_finished(
    commander: Supervisor, height: float, *, flies: bool
) -> None:
    state = int(Supervisor.FLYING | commander)
    assert flying(state, height) == flies
    assert flying(np.array([state, int(commander)]), np.full(2, height)).tolist() == [flies, False]
