"""Sources of motion capture, and the system that receives from them."""

from __future__ import annotations

import math
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from itertools import islice
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from star_core import Array, PluginError, PoseFixes, Registry, hookimpl
from star_core.testing import scene
from star_fleet.natnet import NatNetServer
from star_mocap.source import Frame, MocapSourceSpec
from star_mocap.sources import made, natnet, qtm
from star_mocap.system import CaptureClock, MotionCapture
from tests.plugins.localizers.conftest import fixes
from tests.waiting import eventually

QUARTER = math.sqrt(0.5)  # sine and cosine of 45°


def connect(folder: Path = Path(), n: int = 2, **options: Any) -> MotionCapture:
    room = replace(scene(n), folder=folder)
    return MocapSourceSpec.connect(Registry(), room, options)


def mock(**options: Any) -> dict[str, Any]:
    bodies = {"cf1": [1.0, 2.0, 0.5], "second": [0.0, 0.0, 1.0]}
    return {"mock": {"bodies": bodies, "rate": 200, **options}}


def test_bodies_are_named_and_turned_into_the_map() -> None:
    system = connect(source=mock(), bodies={"cf2": "second"}, origin=[10.0, 0.0, 0.0], yaw_deg=90.0)
    with closing(system):
        assert eventually(lambda: len(system.recent()) > 3)
        frame = system.recent()[-1]
    assert frame.poses[:, :3] == pytest.approx(np.array([[8.0, 1.0, 0.5], [10.0, 0.0, 1.0]]))
    assert frame.poses[:, 3:] == pytest.approx(np.array([[0, 0, QUARTER, QUARTER]] * 2))
    assert frame.taken <= frame.arrived


def test_a_frame_with_y_up_is_turned_upright() -> None:
    system = connect(source=mock(), up="y", yaw_deg=90.0)
    with closing(system):
        frame = system.recent()[-1]
    assert frame.poses[0, :3] == pytest.approx([0.5, 1.0, 2.0])
    assert frame.poses[0, 3:] == pytest.approx([0.5, 0.5, 0.5, 0.5])
    assert np.isnan(frame.poses[1]).all()


def test_markers_have_no_names_and_frames_are_taken_once() -> None:
    system = connect(source=mock(labelled=False))
    with closing(system):
        assert eventually(lambda: len(system.recent()) > 3)
        frames = system.take()
        assert len(frames) > 3
        assert system.take() == [] or system.take()[0].arrived > frames[-1].arrived
    assert frames[0].markers.shape == (2, 3)
    assert np.isnan(frames[0].poses).all()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"bodies": {"cf9": "first"}}, (("bodies", "cf9"), "unknown-agent")),
        ({"bodies": {"cf1": "b", "cf2": "b"}}, (("bodies", "cf2"), "duplicate-name")),
        ({"bodies": {"cf1": "cf2"}}, (("bodies", "cf1"), "duplicate-name")),
        ({"bodies": {"cf1": "cf2", "cf2": "cf1"}}, None),
        ({"source": {"replay": {"file": "no"}}}, (("source", "replay", "file"), "file-not-found")),
    ],
)
def test_unusable_bodies_and_files_are_problems(
    options: dict[str, Any], problem: Any, tmp_path: Path
) -> None:
    room = replace(scene(2), folder=tmp_path)
    problems = MocapSourceSpec.check(Registry(), room, {"source": mock()} | options)
    assert [(each.path, each.code) for each in problems] == ([problem] if problem else [])


class Others:
    """A plugin of a third party, with a source."""

    @hookimpl
    def star_mocap_sources(self) -> Iterator[MocapSourceSpec]:
        yield MocapSourceSpec(
            name="theirs",
            summary="Theirs.",
            frames="their_frames:frames",
            options={"properties": {"height": {"type": "number", "default": 0.7}}},
        )


THEIRS = """
import time
from star_mocap.source import Frame

def frames(*, height):
    while True:
        time.sleep(0.01)
        yield Frame({"cf1": (0, 0, height, 0, 0, 0, 1)})
"""


def test_a_source_of_a_third_party_is_received(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "their_frames.py").write_text(THEIRS)
    monkeypatch.syspath_prepend(tmp_path)
    registry = Registry(Others())
    source: dict[str, Any] = {"theirs": {}}
    with closing(MocapSourceSpec.connect(registry, scene(1), {"source": source})) as system:
        frame = system.recent()[-1]
    assert frame.poses[0, :3].tolist() == [0, 0, 0.7]
    assert np.isnan(frame.taken)  # it sends no times
    options = registry.find("localizer", "mocap").offer.options["properties"]["source"]
    assert "theirs" in options["properties"]


RECORDED = """\
time,body,x,y,z,qx,qy,qz,qw
5.0,cf1,0,0,1,0,0,0,1
5.0,,1,2,3,,,,
5.02,cf1,0.1,0,1,0,0,0,1
"""


def test_a_recording_is_replayed_with_its_times(tmp_path: Path) -> None:
    (tmp_path / "bodies.csv").write_text(RECORDED)
    frames = list(made.replay(file=str(tmp_path / "bodies.csv"), repeat=False))
    assert [frame.captured for frame in frames] == pytest.approx([0.0, 0.02])
    assert frames[0].bodies["cf1"] == (0, 0, 1, 0, 0, 0, 1)
    assert frames[0].markers == [(1, 2, 3)]
    again = made.replay(file=str(tmp_path / "bodies.csv"), repeat=True)
    assert [frame.captured for frame in islice(again, 4)] == pytest.approx([0, 0.02, 0.021, 0.041])


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("time,x\n", ":1: expected the header time,body,x"),
        (RECORDED + "6,cf1,1,2,3\n", ":5: expected time,body,x"),
        (RECORDED + "6,cf1,nan,2,3,0,0,0,1\n", ":5: expected"),
        (RECORDED + "4,cf1,1,2,3,0,0,0,1\n", ":5: the time is before"),
        ("time,body,x,y,z,qx,qy,qz,qw\n", ": no frames"),
    ],
)
def test_a_bad_recording_is_located(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "bodies.csv").write_text(text)
    with pytest.raises(PluginError, match=f"bodies.csv{problem}"):
        connect(tmp_path, source={"replay": {"file": "bodies.csv"}})


@pytest.fixture
def stream() -> Iterator[Callable[..., Mapping[str, Any]]]:
    """Return a function that streams measurements each 10 ms, and returns how to reach them."""
    ended = threading.Event()
    threads = []

    def begin(measured: Callable[[float], PoseFixes], delay: float = 0.0) -> Mapping[str, Any]:
        server = NatNetServer(["cf1", "cf2"], "127.0.0.1", 0)

        def serve() -> None:
            with closing(server):
                step = 0
                while not ended.wait(0.01):
                    step += 1
                    server.serve(measured(step / 100), step / 100 + delay)

        threads.append(threading.Thread(target=serve))
        threads[-1].start()
        return {"host": "127.0.0.1", "multicast": False, "command_port": server.port}

    yield begin
    ended.set()
    for thread in threads:
        thread.join()


def test_natnet_sends_poses_and_their_times(stream: Any) -> None:
    pytest.importorskip("natnet")

    def measured(time: float) -> PoseFixes:
        return fixes(time, [[time, 0, 1]], yaw=math.pi / 2)

    system = connect(source={"natnet": stream(measured, delay=0.025)})
    with closing(system):
        assert eventually(lambda: np.isfinite(system.recent()[-1].taken))
        frame = system.recent()[-1]
    assert frame.arrived - frame.taken == pytest.approx(0.025, abs=0.003)
    assert frame.poses[0, 1:] == pytest.approx([0, 1, 0, 0, QUARTER, QUARTER], abs=1e-6)
    assert np.isnan(frame.poses[1]).all()


def test_natnet_sends_markers_without_names(stream: Any) -> None:
    pytest.importorskip("natnet")

    def measured(time: float) -> PoseFixes:
        return fixes(time, [[0.5, 0, 1], [2, 0, 1]], agent=[-1, -1], yaw=0.0)

    frames = natnet.frames(**stream(measured))
    frame = next(frame for frame in frames if frame is not None)
    frames.close()  # type: ignore[attr-defined]
    assert np.array(frame.markers) == pytest.approx(np.array([[0.5, 0, 1], [2, 0, 1]]))
    assert frame.bodies == {}


def test_a_natnet_server_that_is_not_there_is_named() -> None:
    pytest.importorskip("natnet")
    with pytest.raises(
        PluginError, match=r"natnet.*no server answers at 127.0.0.1, command port 9"
    ):
        connect(source={"natnet": {"host": "127.0.0.1", "multicast": False, "command_port": 9}})


def test_a_tick_counter_of_unknown_rate_becomes_seconds() -> None:
    ticks, rate = natnet.Ticks(), 2.4e9
    for k in range(100):
        exposure = round((77 + k / 100) * rate)
        suffix = SimpleNamespace(
            stamp_camera_mid_exposure=exposure,
            stamp_transmit=exposure + round(0.004 * rate),
            timestamp=3.0 + k / 100,
        )
        times = ticks.times(suffix)
    assert times == pytest.approx({"captured": 3.99, "processing": 0.004})


def test_qualisys_sends_poses_in_metres() -> None:
    turned = (0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # columns: 90° about z
    packet = SimpleNamespace(
        timestamp=2_500_000,
        get_6d=lambda: (
            None,
            [
                (SimpleNamespace(x=1000.0, y=2000.0, z=500.0), SimpleNamespace(matrix=turned)),
                (SimpleNamespace(x=math.nan, y=0.0, z=0.0), SimpleNamespace(matrix=turned)),
            ],
        ),
        get_3d_markers_no_label=lambda: (None, [SimpleNamespace(x=10.0, y=0.0, z=0.0, id=4)]),
    )
    settings = "<P><The_6D><Body><Name>cf1</Name></Body><Body><Name>cf2</Name></Body></The_6D></P>"
    frame = qtm.frame_of(packet, qtm.body_names(settings))
    assert frame.bodies.keys() == {"cf1"}
    assert frame.bodies["cf1"] == pytest.approx((1.0, 2.0, 0.5, 0, 0, QUARTER, QUARTER))
    assert np.array(frame.markers) == pytest.approx(np.array([[0.01, 0, 0]]))
    assert frame.captured == 2.5


def test_the_packets_of_the_package_are_read() -> None:
    """A 6D component of one body, as a server of Qualisys packs it."""
    packet = pytest.importorskip("qtm_rt.packet")
    body = struct.pack("<3f9f", 1000, 2000, 500, 0, 1, 0, -1, 0, 0, 0, 0, 1)
    six = struct.pack("<IIIHH", 16 + len(body), 5, 1, 0, 0) + body
    data = struct.pack("<QII", 40_000, 7, 1) + six
    frame = qtm.frame_of(packet.QRTPacket(data), ["cf1"])
    assert frame.bodies["cf1"] == pytest.approx((1.0, 2.0, 0.5, 0, 0, QUARTER, QUARTER))
    assert frame.captured == pytest.approx(0.04)


def test_the_clock_of_a_system_removes_jitter() -> None:
    clock, random = CaptureClock(), np.random.default_rng(3)
    sent = np.arange(0, 10, 0.01)
    arrived = 100 + sent + 0.003 + random.exponential(0.01, len(sent))
    times: Array = np.array([clock.time(*pair) for pair in zip(sent, arrived, strict=True)])
    settled = times[200:] - 100.003 - sent[200:]
    assert 0 <= settled.min() <= settled.max() < 0.001


def test_a_system_that_restarts_begins_a_new_clock() -> None:
    clock = CaptureClock()
    assert clock.time(50.0, 100.0) == 100.0
    assert clock.time(1.0, 101.0) == 101.0
    assert clock.time(1.5, 101.6) == pytest.approx(101.5)


def test_frames_are_as_documented() -> None:
    frame = Frame({"cf1": (0, 0, 0, 0, 0, 0, 1)})
    assert math.isnan(frame.captured)
    assert math.isnan(frame.processing)
