"""Missions through the real protocols: `star run` with cflib's drivers, against the fleet.

The same mission is flown in the simulator itself, in lock-step, and over UDP and TCP in real time.
What the two take for where the drones are, and where the fleet's drones are in truth, is compared.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from star_core import Array, Registry, Scene, load
from star_core.commands.main import main
from star_fleet.aideck import Wifi
from star_sim.camera_sim.options import camera_options
from tests.simulators import ideal_fleet

pytest.importorskip("cflib")

MISSIONS = Path(__file__).parents[2] / "missions"
PATIENCE = 240.0  # s on the wall, for a flight of half a minute on a busy machine

# The greatest RMSE of seeds 0 to 9 of three_eyes.yaml in the simulator itself, with images that are
# not stamped, as a deck's are not (`--set transport.camera.timestamps=false`); least: 0.017 m.
NEAR = 0.023  # m

# The greatest of first_flight.yaml, which flies by dead reckoning; the least is 0.10 m.
DRIFT = 0.25  # m
SPEED = 0.5  # m/s, that the drones fly
BESIDE = 0.2  # m, `limits.separation` of first_flight.yaml, as it is if not given


IDEAL = [  # as drones of `Fleet` fly
    *(f"--set=transport.{pair}" for pair in ("noise=false", "profile=ideal", "controller=ideal")),
    "--set=limits.uncertainty_margin=0",
]


SWAP = (
    "mission=[{takeoff: {height: 0.4}}, {parallel: [{goto: {agents: cf1, to: [1.2, 0, 0.4]}},"
    " {goto: {agents: cf2, to: [-1.2, 0, 0.4]}}]}, {land: {speed: 0.6}}]"
)


class Flown(NamedTuple):
    """A flight as it was recorded: (T,) s, and (T, N, 3) m."""

    time: Array
    estimate: Array


def recorded(folder: Path) -> Flown:
    with np.load(folder / "trajectory.npz") as record:
        return Flown(record["time"], record["estimate_position"])


def star(*arguments: object) -> subprocess.Popen[str]:
    program = "import sys; from star_core.commands.main import main; sys.exit(main(sys.argv[1:]))"
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def over_the_air(
    mission: Path,
    folder: Path,
    *,
    noise: bool,
    cameras: bool,
    more: str = "",
    changes: Sequence[str] = (),
) -> tuple[Flown, Flown, float]:
    """Fly a mission in real time.

    Args:
        mission: To fly.
        folder: Where to record.
        noise: Whether the estimators of the drones err.
        cameras: Whether their cameras are streamed.
        more: Options of the transport, each with a comma.
        changes: Further changes to the mission.

    Returns:
        What was recorded; where the drones were; and by how much the fleet was behind real time,
        RMS, s. So much is an image late, whose time is told by when it arrives.
    """
    scene = load(mission, Registry()).scene
    camera = camera_options() if cameras else None
    with ideal_fleet(scene, noise=noise, camera=camera) as fleet:
        wifi = Wifi(fleet, scene, "127.0.0.1", links=None, cameras=0 if cameras else None)
        with closing(wifi):
            settings = [
                f"swarm.{a.name}.uri={u}"
                for a, u in zip(scene.agents, fleet.addresses, strict=True)
            ]
            radio = f"use: radio, udp: cflib, {decks(scene, wifi)}{more}cache: '{folder.parent}'"
            settings += [f"transport={{{radio}}}", *changes]
            settings.append("limits.uncertainty_margin=0")
            flight = star("run", mission, "--out", folder, *(f"--set={pair}" for pair in settings))
            times, places, behind, end = [], [], [], time.monotonic() + PATIENCE
            while flight.poll() is None and time.monotonic() < end:
                now, where = time.monotonic(), fleet.simulator.drones["position"].copy()
                times.append(now)
                places.append(where)
                behind.append(now - fleet.time)
                time.sleep(0.01)
            flight.kill()
            output, _ = flight.communicate()
    assert flight.returncode == 0, output
    late = float(np.sqrt(np.mean((np.array(behind) - min(behind)) ** 2)))
    return recorded(folder), Flown(np.array(times), np.array(places)), late


def decks(scene: Scene, wifi: Wifi) -> str:
    """The transport's option with the addresses of the cameras."""
    named = (f"{scene.agents[row].name}: '{place}'" for row, place in wifi.cameras.items())
    return f"cameras: {{{', '.join(named)}}}, " if wifi.cameras else ""


def apart(flight: Flown, other: Flown, *, later: float = 0.0) -> float:
    """RMS distance of the drones in two flights, m; the other's clock is `later` by so much, s."""
    when = flight.time + later
    same = (when >= other.time[0]) & (when <= other.time[-1])
    other_position = np.apply_along_axis(
        lambda track: np.interp(when[same], other.time, track), 0, other.estimate
    )
    away = np.linalg.norm(flight.estimate[same] - other_position, axis=2)
    return float(np.sqrt(np.mean(away**2)))


def error(flight: Flown, truth: Flown) -> float:
    """RMS of the estimate's error, m, with the clocks shifted to where they agree best.

    The truth has the clock of the computer, on which the start of the mission is not known.
    """
    first, last = truth.time[0] - flight.time[0], truth.time[-1] - flight.time[-1]
    for step in (0.1, 0.01, 0.002):
        begins = np.arange(first, last, step)
        best = min(begins, key=lambda begin: apart(flight, truth, later=begin))
        first, last = best - step, best + step
    return apart(flight, truth, later=best)


@pytest.mark.extended
def test_the_demo_flies_over_udp_as_in_the_simulator(tmp_path: Path) -> None:
    mission = MISSIONS / "first_flight.yaml"
    simulated = ["run", str(mission), "--out", str(tmp_path / "sim"), *IDEAL, f"--set={SWAP}"]
    assert main(simulated) == 0
    flown, truth, late = over_the_air(
        mission, tmp_path / "air", noise=False, cameras=False, changes=[SWAP]
    )
    near = 0.05 + SPEED / 20  # a take-off by radio begins a tick later: it is written first
    assert apart(flown, recorded(tmp_path / "sim")) < near + SPEED * late
    assert error(flown, truth) < NEAR + SPEED * late


@pytest.mark.campaign
def test_the_demo_drifts_no_more_over_udp_than_in_the_simulator(tmp_path: Path) -> None:
    mission = MISSIONS / "first_flight.yaml"
    flown, truth, late = over_the_air(mission, tmp_path / "air", noise=True, cameras=False)
    assert error(flown, truth) < DRIFT + SPEED * late


@pytest.mark.campaign
def test_flown_by_whole_states_the_drones_of_the_demo_stay_apart(tmp_path: Path) -> None:
    mission = MISSIONS / "first_flight.yaml"
    flown, truth, late = over_the_air(
        mission, tmp_path, noise=False, cameras=False, more="setpoints: full-state, "
    )
    assert error(flown, truth) < NEAR + SPEED * late
    pairs = np.linalg.norm(truth.estimate[:, :, None] - truth.estimate[:, None], axis=3)
    assert pairs[:, *np.triu_indices(pairs.shape[1], 1)].min() > BESIDE


@pytest.mark.campaign
def test_noiseless_streamed_flights_match_the_simulator(tmp_path: Path) -> None:
    mission = MISSIONS / "three_eyes.yaml"
    alone = star("run", mission, "--out", tmp_path / "sim", *IDEAL)
    output, _ = alone.communicate(timeout=PATIENCE)
    assert alone.returncode == 0, output
    flown, _, late = over_the_air(mission, tmp_path / "air", noise=False, cameras=True)
    assert apart(flown, recorded(tmp_path / "sim")) < 0.05 + SPEED * late


@pytest.mark.campaign
def test_three_drones_localize_by_streamed_images(tmp_path: Path) -> None:
    mission = MISSIONS / "three_eyes.yaml"
    flown, truth, late = over_the_air(mission, tmp_path / "air", noise=True, cameras=True)
    assert error(flown, truth) < NEAR + SPEED * late


@pytest.mark.campaign
def test_three_drones_localize_with_position_feedback(tmp_path: Path) -> None:
    changes = ["localizer={use: apriltag, feedback: extpose}"]
    mission = MISSIONS / "three_eyes.yaml"
    flown, truth, late = over_the_air(
        mission, tmp_path / "air", noise=True, cameras=True, changes=changes
    )
    assert error(flown, truth) < NEAR + SPEED * late


HANGS = """
import itertools, sys, threading
from types import SimpleNamespace
from star_core import AvoiderSpec, Registry, fly, hookimpl, load

class Hangs:
    @hookimpl
    def star_avoiders(self):
        calls = itertools.count()

        def avoid(estimate, wanted):
            if next(calls) == 140:  # s / 0.05: on the way, at 0.8 m
                threading.Event().wait()
            return wanted

        make = lambda scene: SimpleNamespace(avoid=avoid)
        yield AvoiderSpec(name="hangs", summary="Hangs.", make=make)

registry = Registry(Hangs())
print(fly(load(sys.argv[1], registry, sys.argv[2:]), registry)["reason"])
"""


@pytest.mark.campaign
def test_drones_hover_while_a_plugin_hangs_and_then_land() -> None:
    mission = MISSIONS / "first_flight.yaml"
    with ideal_fleet(load(mission, Registry()).scene) as fleet:
        uris = [f"swarm.cf{i + 1}.uri={uri}" for i, uri in enumerate(fleet.addresses)]
        changes = [*uris, "transport=radio", "avoider=hangs"]
        program = [sys.executable, "-c", HANGS, str(mission), *changes]
        with subprocess.Popen(program, stdout=subprocess.PIPE, text=True) as flight:
            sink, end = [], time.monotonic() + PATIENCE
            while flight.poll() is None and time.monotonic() < end:
                drones = fleet.simulator.drones
                sink.append(-drones["velocity"][:, 2])
                time.sleep(0.01)
            flight.kill()
            output, _ = flight.communicate()
        height = fleet.simulator.drones["position"][:, 2].copy()
    assert "avoider 'hangs' (__main__:Hangs): PluginTimeout: no result after 1" in output
    assert height.max() < 0.1
    assert np.max(sink) < 1.0  # m/s; dropped from 0.8 m it would be 4
