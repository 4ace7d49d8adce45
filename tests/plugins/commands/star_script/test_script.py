"""Scripts for crazyflie_py and pycrazyswarm, run as they are."""

from __future__ import annotations

import json
import sys
import textwrap
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import star_yaml
from star_core import InputError, Operator, Registry, hookimpl, load, read_run
from star_core.testing import scene
from star_script.run_script import run_script
from star_verbs.follow.files import PIECE_COLUMNS
from tests.commands import Printed, command
from tests.core.conftest import Lab
from tests.simulators import ideal_fleet

main = command("script")

ROBOTS = """\
fileversion: 3
robots:
  cf1: {enabled: true, uri: radio://0/80/2M/E7E7E7E701, initial_position: [0, 0, 0], type: cf21}
  cf2: {enabled: true, uri: radio://0/80/2M/E7E7E7E702, initial_position: [0, 1, 0], type: cf21}
robot_types:
  cf21: {motion_capture: {enabled: true}, big_quad: false}
"""
BEGIN = """\
import numpy as np
from crazyflie_py import Crazyswarm
swarm = Crazyswarm()
timeHelper, allcfs = swarm.timeHelper, swarm.allcfs
cf1, cf2 = allcfs.crazyflies
allcfs.takeoff(targetHeight=0.8, duration=2.0)
timeHelper.sleep(4.0)
"""
END = """
allcfs.land(targetHeight=0.04, duration=2.0)
timeHelper.sleep(4.0)
"""

Fly = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def fly(tmp_path: Path, capsys: Printed) -> Fly:
    """Run a script; return the exit status and the summary."""
    (tmp_path / "crazyflies.yaml").write_text(ROBOTS)

    def run(body: str, *options: str, begin: str = BEGIN, end: str = END) -> Any:
        script = tmp_path / "hover.py"
        script.write_text(begin + textwrap.dedent(body) + end)
        swarm = str(tmp_path / "crazyflies.yaml")
        if "--out" not in options:
            options = ("--no-record", *options)
        status = main([str(script), "--swarm", swarm, "--json", "--seed", "3", *options])
        out = capsys.readouterr().out
        return status, json.loads(out[out.index("{\n") :])

    return run


def completed(flight: tuple[int, dict[str, Any]]) -> None:
    status, summary = flight
    assert (status, summary["outcome"]) == (0, "completed"), summary["reason"]


def events(summary: dict[str, Any]) -> list[str]:
    """Return what the script commanded."""
    return [event["text"] for event in summary["events"] if event["kind"] == "script"]


def test_a_script_flies_is_recorded_and_flies_the_same_again(fly: Fly, tmp_path: Path) -> None:
    body = """
    pos = np.array(cf1.initialPosition) + np.array([0.5, 0, 1.0])
    cf1.goTo(pos, 0, 2.0)
    timeHelper.sleep(3.0)
    assert abs(cf1.position[0] - 0.5) < 0.06, cf1.position
    assert np.allclose(cf2.get_position()[2], 0.8, atol=0.1)
    """
    runs = []
    for name in ("first", "second"):
        status, summary = fly(body, "--out", str(tmp_path / name))
        assert (status, summary["outcome"]) == (0, "completed"), summary["reason"]
        runs.append(read_run(tmp_path / name))
    assert events(summary)[:2] == ["hover.py:6 takeoff cf1, cf2", "hover.py:10 goTo cf1"]
    first, second = (run.arrays for run in runs)
    assert first["truth_position"].tobytes() == second["truth_position"].tobytes()
    assert first.keys() == second.keys()
    assert runs[0].agents == ("cf1", "cf2")


def test_trajectories_are_flown_in_their_own_time(fly: Fly, tmp_path: Path) -> None:
    axes = np.zeros((4, 8))
    for power, factor in ((3, 10), (4, -15), (5, 6)):
        axes[0, power] = factor * 0.8 / 2.0**power
    row = ",".join(map(repr, [2.0, *axes.ravel().tolist()]))
    (tmp_path / "way.csv").write_text(f"{','.join(PIECE_COLUMNS)},\n{row},\n")
    body = """
    from pathlib import Path
    from crazyflie_py.uav_trajectory import Trajectory
    traj = Trajectory()
    traj.loadcsv(Path(__file__).parent / "way.csv")
    for cf in allcfs.crazyflies:
        cf.uploadTrajectory(0, 0, traj)
    allcfs.startTrajectory(0)
    for expected in (0.4, 0.8):
        timeHelper.sleep(1.0)
        assert abs(cf1.position[0] - expected) < 0.12, (expected, cf1.position)
    timeHelper.sleep(1.0)
    cf2.startTrajectory(0, timescale=0.9, reverse=True)
    timeHelper.sleep(2.5)
    assert abs(cf2.position[0]) < 0.12, cf2.position
    """
    completed(fly(body))


def test_setpoints_are_flown_and_end(fly: Fly) -> None:
    body = """
    start = timeHelper.time()
    while timeHelper.time() - start < 2.0:
        t = timeHelper.time() - start
        cf1.cmdFullState([0.3 * t, 0, 0.8], [0.3, 0, 0], [0, 0, 0], 0.0, [0, 0, 0])
        cf2.cmdVelocityWorld([0.2, 0, 0], yawRate=0)
        timeHelper.sleepForRate(30)
    assert abs(cf1.position[0] - 0.6) < 0.1, cf1.position
    assert 0.25 < cf2.position[0] < 0.5, cf2.position
    for _ in range(40):
        cf1.cmdPosition([0.6, 0.0, 1.0], yaw=0.0)
        cf2.cmdHover(-0.2, 0, 0, 0.6)
        timeHelper.sleep(0.05)
    assert abs(cf1.position[2] - 1.0) < 0.1, cf1.position
    assert abs(cf2.position[2] - 0.6) < 0.1, cf2.position
    allcfs.notifySetpointsStop()
    timeHelper.sleep(1.0)
    before = cf2.position
    timeHelper.sleep(1.0)
    assert np.linalg.norm(np.array(cf2.position) - before) < 0.1
    """
    completed(fly(body))


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (
            "cf1.goTo([0, 1, 0.8], 0, 3)\ntimeHelper.sleep(4)",
            "hover.py:8 and hover.py:6: cf1 and cf2 would be 0.1",
        ),
        (
            "cf1.goTo([0, 1, 0.8], 0, 3)\ncf2.goTo([0, 0, 0.8], 0, 3)\ntimeHelper.sleep(4)",
            "hover.py:8 and hover.py:9: cf1 and cf2 would be ",
        ),
        ("cf1.goTo([9, 0, 1], 0, 3)", "hover.py:8: goTo: cf1 would leave: [9, 0, 1] is outside"),
        ("cf2.cmdPosition([0, 0, 9])", "hover.py:8: cmdPosition: cf2 would leave: [0, 0, 9]"),
        ("cf2.takeoff(9, 3)", "hover.py:8: takeoff: 9 m is outside"),
        ("cf1.goTo([np.nan, 0, 1], 0, 3)", "hover.py:8: goTo: [nan, 0.0, 1.0], expected numbers"),
        ("cf1.startTrajectory(7)", "hover.py:8: KeyError: 'cf1 has no trajectory 7; upload it"),
        ("1 / 0", "hover.py:8: ZeroDivisionError: division by zero"),
        ("raise SystemExit(3)", "hover.py exited with 3"),
    ],
)
def test_a_script_that_fails_is_stopped_and_its_line_named(
    fly: Fly, body: str, text: str
) -> None:  # fmt: skip
    status, summary = fly(body, begin=BEGIN.replace("sleep(4.0)", "sleep(2.5)"))
    assert status == 1
    assert summary["outcome"] == "failed"
    assert summary["reason"].startswith(text), summary["reason"]
    assert summary["collisions"]["agent_agent"] == 0
    assert [event["text"] for event in summary["events"]][-1]


def test_agents_that_exchange_positions_are_no_collision(fly: Fly) -> None:
    body = """
    cf1.goTo([0.0, 1.0, 0.8], 0, 4)
    cf2.goTo([0.0, 2.0, 0.8], 0, 4)
    timeHelper.sleep(5)
    assert abs(cf1.position[1] - 1.0) < 0.1
    """
    completed(fly(body))


def test_agents_may_pass_above_each_other(fly: Fly) -> None:
    body = """
    cf2.goTo([0.0, 1.0, 1.4], 0, 2)
    timeHelper.sleep(2.5)
    cf1.goTo([0.0, 2.0, 0.8], 0, 5)
    timeHelper.sleep(7)
    assert abs(cf1.position[1] - 2.0) < 0.15, cf1.position
    """
    completed(fly(body))


def test_groups_heed_their_masks(fly: Fly) -> None:
    begin = BEGIN.partition("allcfs.takeoff")[0]
    body = """
    cf1.setGroupMask(0b1001)
    cf2.setGroupMask(0b0100)
    allcfs.takeoff(0.5, 2.0, groupMask=2)
    timeHelper.sleep(1.0)
    assert cf1.position[2] < 0.1
    allcfs.takeoff(0.5, 2.0, groupMask=1)
    timeHelper.sleep(3.0)
    assert cf1.position[2] > 0.4
    assert cf2.position[2] < 0.1
    """
    completed(fly(body, begin=begin))


def test_an_emergency_stops_the_motors(fly: Fly) -> None:
    status, summary = fly("cf1.emergency()\ntimeHelper.sleep(1.5)\nassert cf1.position[2] < 0.1")
    assert summary["outcome"] != "completed" or status == 0
    assert any("hover.py:8 emergency cf1" in text for text in events(summary))


def test_parameters_status_and_the_rest_of_the_interface(fly: Fly) -> None:
    body = """
    cf1.arm(True)
    allcfs.arm(False)
    allcfs.setParam('led.bitmask', 128)
    assert cf2.getParam('led.bitmask') == 128
    cf1.setLEDColor(1, 0, 0)
    status = cf1.get_status()
    assert status['pm_state'] == 0 and status['battery'] > 3, status
    assert status['id'] == 'cf1'
    assert allcfs.crazyfliesById[2] is cf2 and allcfs.crazyfliesByName['cf1'] is cf1
    assert abs(cf1.get_pose()['orientation'][3]) > 0.9
    assert cf2.uri == 'radio://0/80/2M/E7E7E7E702'
    before = timeHelper.time()
    swarm.input.waitUntilButtonPressed()
    assert abs(timeHelper.time() - before - 0.5) < 0.06
    assert not timeHelper.isShutdown()
    allcfs.goTo([0.2, 0, 0], 0, 2.0)
    timeHelper.sleep(3.0)
    assert abs(cf2.position[0] - 0.2) < 0.06
    """
    completed(fly(body, "--button", "0.5"))


def test_scripts_of_pycrazyswarm_run_too(fly: Fly) -> None:
    begin = BEGIN.replace("from crazyflie_py import Crazyswarm", "from pycrazyswarm import *")
    body = """
    import uav_trajectory
    uav_trajectory.Trajectory()
    assert abs(cf1.position()[2] - 0.8) < 0.1
    assert abs(cf1.yaw()) < 0.1
    """
    completed(fly(body, begin=begin))
    assert "pycrazyswarm" not in sys.modules
    assert "crazyflie_py" not in sys.modules


THREADS = """
from threading import Thread
def go(cf, y):
    cf.goTo([0.5, y, 0.8], 0.0, 2.0)
    timeHelper.sleep(2.5)
    cf.setParam("a.b", round(cf.position[0], 9))
    cf.land(0.04, 2.0)
    timeHelper.sleep(4.0)
for cf, y in ((cf1, 0.0), (cf2, 1.0)):
    Thread(target=go, args=(cf, y)).start()
"""


def test_threads_of_a_script_share_mission_time(fly: Fly) -> None:
    flights = [fly(THREADS, end="") for _ in range(2)]
    completed(flights[0])
    summary = flights[0][1]
    assert len(events(summary)) == 7
    assert sorted(events(summary)) == sorted(events(flights[1][1]))
    assert 4 + 2.5 + 4 <= summary["flight_time_s"] < 15


def test_a_thread_that_fails_fails_its_script(fly: Fly) -> None:
    body = THREADS.replace("[0.5, y, 0.8]", "[99, y, 0.8]")
    status, summary = fly(body, end="")
    assert status == 1
    assert summary["reason"].startswith("hover.py:11: goTo: ")


def test_a_script_that_fails_stops_its_threads(fly: Fly) -> None:
    body = THREADS + "timeHelper.sleep(1.0)\nraise ValueError('enough')\n"
    status, summary = fly(body, end="")
    assert (status, summary["reason"]) == (1, "hover.py:19: ValueError: enough")
    assert len(events(summary)) == 3


def test_time_of_a_script_is_mission_time(fly: Fly) -> None:
    body = """
    import time
    from time import monotonic, sleep
    begin, real = (time.time(), monotonic()), time.perf_counter()
    cf1.goTo([0.5, 0.0, 0.8], 0.0, 2.0)
    sleep(2.5)
    while time.time() - begin[0] < 20:
        time.sleep(0.1)
    passed = (time.time() - begin[0], monotonic() - begin[1])
    assert np.allclose(passed, 20, atol=0.11), passed
    assert time.perf_counter() - real < 15
    assert abs(cf1.position[0] - 0.5) < 0.3, cf1.position
    """
    completed(fly(body))
    assert time.sleep.__module__ == "time"


def test_a_script_that_waits_without_sleeping_flies_on(fly: Fly) -> None:
    body = """
    cf1.goTo([0.5, 0.0, 0.8], 0.0, 2.0)
    begin = timeHelper.time()
    while timeHelper.time() - begin < 2.5:
        pass
    while cf1.position[0] < 0.3:
        pass
    """
    completed(fly(body))


def test_poses_have_the_fields_of_messages(fly: Fly) -> None:
    body = """
    stamped = cf2.poseStamped
    assert (stamped["id"], stamped["timestamp_sec"]) == ("cf2", 4)
    assert list(stamped["pose"].position) == cf2.position
    assert cf2.get_pose()["position"].y == cf2.position[1]
    assert cf2.pose["orientation"].w > 0.9
    assert cf2.status == cf2.get_status()
    """
    completed(fly(body))


def test_a_flight_after_a_landing_waits_for_the_floor(fly: Fly) -> None:
    body = """
    allcfs.land(0.04, 1.0)
    timeHelper.sleep(1.5)
    allcfs.takeoff(0.6, 2.0)
    timeHelper.sleep(11.0)
    assert abs(cf1.position[2] - 0.6) < 0.1, cf1.position
    """
    completed(fly(body))


def test_arguments_and_files_beside_a_script_are_its_own(fly: Fly, tmp_path: Path) -> None:
    (tmp_path / "beside.py").write_text("HEIGHT = 0.5\n")
    body = """
    import sys
    from beside import HEIGHT
    assert sys.argv[1:] == ['--fast'], sys.argv
    """
    completed(fly(body, "--", "--fast"))


@pytest.mark.parametrize("begin", ["\ufeffstar: 1\n", '"star": 1\n'])
def test_missions_keep_their_fence_and_limits(tmp_path: Path, begin: str) -> None:
    (tmp_path / "room.yaml").write_text(
        "star: 1\nname: room\nfence: {low: [-1, -1, 0], high: [1, 1, 2]}\n"
    )
    (tmp_path / "mission.yaml").write_text(
        f"{begin}name: small\nworld: room.yaml\nlimits: {{speed: 0.3}}\n"
        "swarm: {cf1: {start: [0, 0, 0]}}\ntransport: sim\nlocalizer: flow\n"
        "planner: straight\navoider: none\nmission: [hold: {}]\n",
        encoding="utf-8",
    )
    (tmp_path / "look.py").write_text(
        "from crazyflie_py import Crazyswarm\nscene = Crazyswarm().flight.scene\n"
        "assert (scene.world.fence.high, scene.limits.speed) == ((1, 1, 2), 0.3)\n"
    )
    swarm = str(tmp_path / "mission.yaml")
    assert main([str(tmp_path / "look.py"), "--swarm", swarm, "--no-record"]) == 0


def test_a_missing_script_and_a_missing_swarm_are_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none.py: no such file \[file-not-found\]"):
        main([str(tmp_path / "none.py"), "--swarm", "first_flight"])
    (tmp_path / "empty.py").write_text("")
    with pytest.raises(InputError, match=r"none\.yaml"):
        main([str(tmp_path / "empty.py"), "--swarm", str(tmp_path / "none.yaml")])


def test_observers_receive_the_ticks_of_a_script(tmp_path: Path) -> None:
    class Ticks:
        count = 0

        @hookimpl
        def star_ticked(self) -> None:
            self.count += 1

    ticks = Ticks()
    registry = Registry(ticks)
    script = tmp_path / "short.py"
    script.write_text("from crazyflie_py import Crazyswarm\nCrazyswarm().timeHelper.sleep(1)\n")
    mission = load("first_flight", registry)
    summary, failed = run_script(script, (), mission, registry, Operator())
    assert not failed
    assert summary["outcome"] == "completed"
    assert ticks.count >= 20


def test_a_script_in_real_time_flies_in_its_own_thread(lab: Lab, tmp_path: Path) -> None:
    class Paced:
        @hookimpl
        def star_ticked(self) -> None:
            time.sleep(0.002)  # for the thread of the script

    script = tmp_path / "thread.py"
    script.write_text(
        "import threading\n"
        "from crazyflie_py import Crazyswarm\n"
        "swarm = Crazyswarm()\n"
        "assert threading.current_thread() is not threading.main_thread()\n"
        "swarm.allcfs.takeoff(1.0, 1.0)\n"
        "swarm.timeHelper.sleep(3.0)\n"
        "swarm.allcfs.crazyflies[0].goTo([0.5, 0, 1.0], 0, 2.0)\n"
        "swarm.timeHelper.sleep(4.0)\n"
        "assert abs(swarm.allcfs.crazyflies[0].position[0] - 0.5) < 0.1\n"
    )
    lab.realtime = True
    lab.registry = Registry(star_yaml, lab, Paced(), installed=False)
    limits = "limits: {speed: 1, height: [0, 2]}\n"
    summary, failed = run_script(
        script, (), lab.load(more=limits), lab.registry, Operator()
    )  # fmt: skip
    assert not failed, summary["reason"]
    assert summary["outcome"] == "completed"
    assert lab.went("cf1")[-1] == "landed"


def test_parameters_and_colors_are_sent_to_drones(tmp_path: Path) -> None:
    pytest.importorskip("cflib")
    script = tmp_path / "colors.py"
    script.write_text(
        "from crazyflie_py import Crazyswarm\n"
        "swarm = Crazyswarm()\n"
        "first, second = swarm.allcfs.crazyflies\n"
        "swarm.allcfs.arm(True)\n"
        "swarm.allcfs.setParam('led/bitmask', 128)\n"
        "first.setLEDColor(1, 0.5, 0)\n"
        "swarm.timeHelper.sleep(0.5)\n"
        "second.setParam('ring.effect', 13)\n"
    )
    with ideal_fleet(scene(2), arms_itself=False) as fleet:
        robots = ROBOTS
        for row, uri in enumerate(fleet.addresses):
            robots = robots.replace(f"radio://0/80/2M/E7E7E7E70{row + 1}", uri)
        (tmp_path / "crazyflies.yaml").write_text(robots)
        registry = Registry()
        choices = ["transport=radio", "localizer=flow", f"transport.cache={tmp_path}"]
        mission = load(tmp_path / "crazyflies.yaml", registry, choices)
        _summary, failed = run_script(script, (), mission, registry, Operator())
        armed = [vehicle.supervisor.armed for vehicle in fleet.vehicles]
        values = [vehicle._parameters for vehicle in fleet.vehicles]
    assert not failed
    assert armed == [True, True]
    assert [value["led.bitmask"] for value in values] == [128, 128]
    solid = [f"ring.solid{color}" for color in ("Red", "Green", "Blue")]
    assert [values[0][name] for name in solid] == [255, 128, 0]
    assert [value["ring.effect"] for value in values] == [7, 13]


def test_a_flight_that_ends_stops_its_script(lab: Lab, tmp_path: Path) -> None:
    script = tmp_path / "endless.py"
    script.write_text(
        "from crazyflie_py import Crazyswarm\n"
        "swarm = Crazyswarm()\n"
        "swarm.allcfs.takeoff(1.0, 1.0)\n"
        "while True:\n    swarm.timeHelper.sleep(1.0)\n"
    )
    lab.spoil("transport", "wait", RuntimeError("boom"), range(60, 61))
    limits = "limits: {speed: 1, height: [0, 2]}\n"
    summary, failed = run_script(script, (), lab.load(more=limits), lab.registry, Operator())
    assert failed
    assert "boom" in summary["reason"]
    assert lab.went("cf1")[-1] == "landed"
