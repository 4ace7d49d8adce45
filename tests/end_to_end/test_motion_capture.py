"""``star run`` by motion capture over ``star fleet``, in real time: all processes and sockets."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from tests.end_to_end.test_over_the_air import star
from tests.plugins.commands.star_fleet.test_command import free

MISSION = Path(__file__).parents[2] / "missions" / "motion_capture.yaml"


@pytest.mark.campaign
def test_the_fleet_is_flown_by_its_motion_capture(tmp_path: Path) -> None:
    port = free(3)
    fleet = star("fleet", MISSION, "--port", port, "--mocap", "0")
    try:
        assert fleet.stdout is not None
        lines = iter(fleet.stdout.readline, "")
        served = next(line for line in lines if line.startswith("motion capture: "))
        next(line for line in lines if line.startswith("cf3 "))
        command_port = int(served.split()[-1])
        system = f"{{natnet: {{host: 127.0.0.1, multicast: false, command_port: {command_port}}}}}"
        changes = [f"swarm.cf{row + 1}.uri=udp://127.0.0.1:{port + row}" for row in range(3)]
        changes += [
            f"transport={{use: radio, cache: {tmp_path}}}",
            f"localizer={{use: mocap, forward: extpose, source: {system}}}",
        ]
        flight = star("run", MISSION, "--out", tmp_path / "run", *(f"--set={c}" for c in changes))
        output, _ = flight.communicate(timeout=120)
    finally:
        fleet.send_signal(signal.SIGINT)
        fleet.communicate(timeout=30)
    assert flight.returncode == 0, output
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    assert summary["outcome"] == "completed"
