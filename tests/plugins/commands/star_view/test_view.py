"""The page of `star view`: what it shows at each time, and that only this machine can see it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from star_core import Registry, load, read_run
from star_core.cli.main import main
from star_view.command import simulate
from star_view.page import LOOPBACK
from star_view.replay import Replay

FIRST_FLIGHT = Path(__file__).parents[4] / "missions" / "first_flight.yaml"


@pytest.fixture(scope="module")
def viewer() -> Iterator[Replay]:
    mission = load(FIRST_FLIGHT, registry := Registry())
    shown = Replay(simulate(mission, registry), mission.scene.agents, 0.25, port=18230)
    yield shown
    shown.close()


def test_the_page_is_served_on_this_machine_only(viewer: Replay) -> None:
    assert viewer.address.startswith(f"http://{LOOPBACK}:")
    with urllib.request.urlopen(viewer.address, timeout=5) as page:  # noqa: S310 -- http
        assert page.status == 200


def test_agents_are_where_they_were_at_the_time_of_the_slider(viewer: Replay) -> None:
    position = viewer._run.arrays["truth_position"]
    for tick in (0, 150, 400):
        viewer.show(tick)
        for i, agent in enumerate(viewer.swarm.agents):
            assert agent.position == pytest.approx(position[tick, i], abs=1e-6)
    viewer.timeline.value = 7.5
    expected = position[150, 0]
    deadline = time.monotonic() + 5
    while viewer.swarm.agents[0].position != pytest.approx(expected, abs=1e-6):
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert "flying" in viewer.status.content
    assert "goto cf1" in viewer.status.content


def test_ellipsoids_are_two_standard_deviations(viewer: Replay) -> None:
    viewer.show(300)
    std = viewer._run.arrays["estimate_position_std"][300, 1]
    assert sorted(viewer.swarm.ellipsoids[1].scale) == pytest.approx(sorted(2 * std))


def test_ctrl_c_ends_it(tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert main(["run", str(FIRST_FLIGHT), "--out", str(run)]) == 0
    star = Path(sys.executable).with_name("star")
    command = [str(star), "view", str(run), "--port", "18240"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as view:
        assert view.stdout is not None
        assert b"Ctrl-C" in view.stdout.readline()
        os.kill(view.pid, signal.SIGINT)
        try:
            assert view.wait(10) == 0
        finally:
            view.kill()
        assert view.stderr is not None
        assert b"Traceback" not in view.stderr.read()


def test_what_holds_no_flight_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(tmp_path)]) == 2
    assert "[no-record]" in capsys.readouterr().err
    with pytest.raises(Exception, match="no-record"):
        read_run(tmp_path)
