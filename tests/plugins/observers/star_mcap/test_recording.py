"""A flight as an MCAP file: what robotics tools read from it, and what an interruption leaves."""

from __future__ import annotations

import gc
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from rosbags.highlevel import AnyReader

import star_mcap
from star_core import Camera, read_run
from star_core.commands.main import main
from star_core.toolkit import Progress
from star_mcap import writer
from star_mcap.messages import FILE
from star_mcap.recovery import recover

pytestmark = pytest.mark.ideal_world


@pytest.fixture(scope="module", autouse=True)
def _loaded() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("STAR_BLOCK_PLUGINS")
        yield


def flown(folder: Path, mission: str, more: str = "", *options: str) -> Path:
    """Fly a mission in a room with more than its fence; return the folder of the run."""
    fence = "fence: {low: [-2, -2, 0], high: [2, 2, 2]}"
    (folder / "room.yaml").write_text(f"star: 1\nname: room\n{fence}\n{more}\n")
    text = f"star: 1\nname: hop\nworld: room.yaml\ntransport: sim\nplanner: straight\n{mission}"
    (folder / "hop.yaml").write_text(text)
    assert main(["run", str(folder / "hop.yaml"), "--out", str(folder / "run"), *options]) == 0
    return folder / "run"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a flight with two drones past an obstacle."""
    pillar = "{polygon: [[1, 1], [1.2, 1], [1.2, 1.2]], height: [0, 2]}"
    mission = (
        "seed: 7\nswarm: {cf1: {start: [-0.5, 0, 0]}, cf2: {start: [0.5, 0, 0]}}\n"
        "localizer: flow\navoider: orca\n"
        "mission:\n  - takeoff: {height: 0.4, speed: 0.5}\n"
        "  - goto: {agents: cf1, by: [0.4, 0.3, 0]}\n  - land: {speed: 0.5}\n"
    )
    folder = tmp_path_factory.mktemp("recorded")
    return flown(folder, mission, f"obstacles:\n  pillar: {pillar}")


def messages(run: Path, topic: str = "") -> dict[str, list[Any]]:
    """Return the messages of a recording by topic, or those of one topic."""
    received: dict[str, list[Any]] = {}
    with AnyReader([run / FILE]) as bag:
        connections = [c for c in bag.connections if topic in {c.topic, ""}]
        for connection, _time, data in bag.messages(connections=connections):
            message = bag.deserialize(data, connection.msgtype)
            received.setdefault(connection.topic, []).append(message)
    return received


@pytest.mark.extended
def test_ape_of_evo_is_the_position_error_of_the_summary(run: Path, tmp_path: Path) -> None:
    """evo is GPL-3: it is called as a program, and not imported."""
    evo = Path(sys.executable).with_name("evo_ape")
    topics = ["/cf1/ground_truth/in_flight", "/cf1/estimate"]
    ape = subprocess.run(
        [str(evo), "mcap", str(run / FILE), *topics],
        env={**os.environ, "HOME": str(tmp_path)},  # it writes its settings there
        capture_output=True,
        text=True,
        check=True,
    )
    summary = json.loads((run / "summary.json").read_text())
    rmse = float(re.findall(r"rmse\s+(\S+)", ape.stdout)[0])
    assert rmse == pytest.approx(
        math.sqrt(summary["position_mse_m2"]["per_agent"]["cf1"]), abs=1e-6
    )


def test_every_message_is_readable_as_ros_2(run: Path) -> None:
    count = Counter({topic: len(received) for topic, received in messages(run).items()})
    ticks = len(np.load(run / "trajectory.npz")["time"])
    for agent in ("cf1", "cf2"):
        assert count[f"/{agent}/estimate"] == count[f"/{agent}/ground_truth"] == ticks
        assert count[f"/{agent}/phase"] == 5
        assert count[f"/{agent}/battery"] > 1
    assert count["/tf"] == ticks
    assert count["/cf1/setpoint/planned"] >= count["/cf1/setpoint/sent"] > 0
    assert count["/world"] == count["/tf_static"] == 1
    assert count["/rosout"] == len(json.loads((run / "summary.json").read_text())["events"])


def test_recorded_estimates_have_covariance_and_body_velocity(run: Path) -> None:
    kept = np.load(run / "trajectory.npz")
    k = int(np.argmax(np.linalg.norm(kept["estimate_velocity"][:, 0], axis=1)))
    odometry = messages(run, "/cf1/estimate")["/cf1/estimate"][k]
    velocity = odometry.twist.twist.linear
    speed = np.linalg.norm([velocity.x, velocity.y, velocity.z])
    assert speed == pytest.approx(np.linalg.norm(kept["estimate_velocity"][k, 0]))
    assert odometry.pose.pose.position.x == kept["estimate_position"][k, 0, 0]
    assert odometry.pose.covariance[0] > 0
    assert odometry.header.frame_id == "map"


def test_planned_paths_lead_from_the_agent_to_its_goal(run: Path) -> None:
    plans = messages(run, "/cf1/plan")["/cf1/plan"]
    kept = read_run(run)
    ends = [kept.paths.points(k) for k in np.flatnonzero(kept.paths.agent == 0).tolist()]
    assert 1 < len(plans) <= len(ends)
    path = plans[0]
    assert (path.header.frame_id, len(path.poses)) == ("map", 2)
    moment = path.header.stamp.sec + 1e-9 * path.header.stamp.nanosec
    tick = int(np.argmin(np.abs(kept.arrays["time"] - moment)))
    line = [(at.x, at.y, at.z) for at in (pose.pose.position for pose in path.poses)]
    assert line == [tuple(kept.arrays["estimate_position"][tick, 0]), tuple(ends[0][0])]


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a flight of a drone that sees a tag, with its images."""
    mission = (
        "cameras: {eye: {rate: 15}}\nswarm: {cf1: {start: [0, 0, 0], camera: eye}}\n"
        "localizer: {use: apriltag, processes: 0}\navoider: none\n"
        "mission:\n  - takeoff: {height: 0.5, speed: 0.5}\n  - hold: {for: 0.6}\n"
    )
    mat = "landmarks: {mat: {tags: [3], at: [0.6, 0, 0]}}"
    return flown(tmp_path_factory.mktemp("images"), mission, mat, "--save-frames")


def test_recorded_tags_have_the_timestamps_of_their_images(images: Path) -> None:
    tags = read_run(images).detections
    assert set(tags.tag.tolist()) == {3}
    assert len(tags.tag) > 2
    recorded = [
        (message.header.stamp, message.detections[0])
        for message in messages(images, "/cf1/camera/detections")["/cf1/camera/detections"]
    ]
    stamps = [stamp.sec + 1e-9 * stamp.nanosec for stamp, _ in recorded]
    assert stamps == pytest.approx(tags.time)
    assert [(c.x, c.y) for c in recorded[0][1].corners] == pytest.approx(tags.corners[0])
    assert {int(path.stem) for path in images.glob("frames/cf1/*.png")} >= {
        round(1000 * moment) for moment in tags.time
    }


def test_images_are_kept_at_five_per_second_with_the_intrinsics(images: Path) -> None:
    received = messages(images)
    kept, infos = (received[f"/cf1/camera/{name}"] for name in ("image/compressed", "camera_info"))
    stamps = [image.header.stamp.sec + 1e-9 * image.header.stamp.nanosec for image in kept]
    assert len(stamps) > 5
    assert np.diff(stamps).min() >= 0.2 - 1e-6
    pixels = cv2.imdecode(kept[0].data, cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    assert pixels.shape == (infos[0].height, infos[0].width)
    assert len(infos) == len(kept)
    assert infos[0].header.frame_id == "cf1/camera"
    assert infos[0].k[[0, 2, 4, 5]].tolist() == pytest.approx(list(_matrix()))


def _matrix() -> tuple[float, ...]:
    fx, fy, cx, cy = Camera().matrix
    return fx, cx, fy, cy


@pytest.mark.extended
def test_no_index_of_a_chunk_stays_in_memory_until_the_end(tmp_path: Path) -> None:
    chunks, channels = 20, 50
    with (tmp_path / FILE).open("wb") as stream:
        recording = writer.begin(stream)
        numbers = [recording.register_channel(f"/{i}", "cdr", 0) for i in range(channels)]
        for chunk in range(chunks):
            for number in numbers:
                recording.add_message(number, chunk, b"x", chunk)
            recording.flush()  # type: ignore[no-untyped-call]
        gc.collect()
        assert not [item for item in gc.get_objects() if type(item) is ChunkIndex]
        recording.finish()  # type: ignore[no-untyped-call]
    with (tmp_path / FILE).open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert len(summary.chunk_indexes) == chunks
        assert all(len(i.message_index_offsets) == channels for i in summary.chunk_indexes)
        assert sum(1 for _ in reader.iter_messages(topics="/7")) == chunks


def test_a_recording_that_breaks_off_is_completed(run: Path, tmp_path: Path) -> None:
    whole = (run / FILE).read_bytes()
    broken = tmp_path / FILE
    broken.write_bytes(whole[: len(whole) * 2 // 3])
    messages, seconds, lost = recover(broken)
    with broken.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == messages > 100
    assert seconds > 1
    assert lost == 0
    assert recover(broken)[0] == messages  # a complete one stays as it is


def test_a_damaged_chunk_costs_its_own_messages_only(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "CHUNK", 64 * 1024)
    whole = (run / FILE).read_bytes()
    broken = tmp_path / FILE
    broken.write_bytes(whole)
    before = recover(broken)
    first, second, *_ = (match.start() for match in re.finditer(rb"zstd", broken.read_bytes()))
    content = bytearray(broken.read_bytes())
    content[(first + second) // 2] ^= 1
    broken.write_bytes(content)
    after = recover(broken)
    assert 0 < after.messages < before.messages
    assert after.lost > 0
    with broken.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert sum(1 for _ in reader.iter_messages()) == after.messages


@pytest.mark.parametrize("size", [1 << 40, (1 << 64) - 1])
def test_a_chunk_that_claims_to_be_huge_is_not_unpacked(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    monkeypatch.setattr(writer, "CHUNK", 64 * 1024)
    broken = tmp_path / FILE
    broken.write_bytes((run / FILE).read_bytes())
    before = recover(broken)
    content = bytearray(broken.read_bytes())
    at = content.index(b"zstd") - 16  # of its size, before a checksum and the length of the name
    content[at : at + 8] = size.to_bytes(8, "little")
    broken.write_bytes(content)
    after = recover(broken)
    assert 0 < after.messages < before.messages
    assert after.lost > 0


def test_corrupt_chunk_lengths_keep_the_messages_before_them(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer, "CHUNK", 64 * 1024)
    broken = tmp_path / FILE
    broken.write_bytes((run / FILE).read_bytes())
    before = recover(broken)
    content = bytearray(broken.read_bytes())
    _first, second, *_ = (match.end() for match in re.finditer(rb"zstd", content))
    content[second : second + 8] = b"\xff" * 8  # length of the chunk's data
    broken.write_bytes(content)
    assert 0 < recover(broken).messages < before.messages


def test_a_recording_of_which_nothing_can_be_read_is_kept(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = (run / FILE).read_bytes()[:200]
    (tmp_path / FILE).write_bytes(content)
    assert main(["recover", str(tmp_path)]) == 2
    assert "none of its messages can be read [unreadable-file]" in capsys.readouterr().err
    assert (tmp_path / FILE).read_bytes() == content


def test_what_is_no_recording_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("star_mcap.recovery.Progress", partial(Progress, announced=True))
    (tmp_path / FILE).write_text("no recording")
    assert main(["recover", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "cannot be recovered" in error
    assert f"recovering {tmp_path / FILE}" in error
    assert (tmp_path / FILE).read_text() == "no recording"
    assert main(["recover", str(tmp_path / "missing")]) == 2


@pytest.mark.extended
def test_a_killed_flight_leaves_a_complete_recording(run: Path, tmp_path: Path) -> None:
    mission = run.parent / "hop.yaml"
    star = Path(sys.executable).with_name("star")
    options = ["--speed", "1", "--out", str(tmp_path / "run")]
    command = [str(star), "run", str(mission), *options]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as flight:
        assert flight.stderr is not None
        line = next(line for line in flight.stderr if b" takeoff cf1, cf2 done" in line)
        os.kill(flight.pid, signal.SIGKILL)
    path = tmp_path / "run" / FILE
    deadline = time.monotonic() + 20
    while True:
        summary = None
        try:
            with path.open("rb") as stream:
                summary = make_reader(stream).get_summary()
        except Exception:  # noqa: BLE001 -- not complete yet
            assert time.monotonic() < deadline
        if summary is not None:
            break
        time.sleep(0.05)
    assert summary.statistics is not None
    takeoff = float(line.split()[0])
    assert summary.statistics.message_end_time / 1e9 >= takeoff - 1.0


def test_a_failing_recording_is_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "run" / FILE).mkdir(parents=True)  # cannot be written
    mission = run.parent / "hop.yaml"
    assert main(["run", str(mission), "--out", str(tmp_path / "run")]) == 1
    printed = capsys.readouterr()
    assert "mcap is dropped" in caplog.text  # in flight or, if that is short, at its end
    assert "IsADirectoryError" in caplog.text
    last = f"not recorded: {tmp_path / 'run'}: the recording failed: IsADirectoryError"
    assert printed.out.splitlines()[-1].startswith(last)


def test_without_the_packages_recover_names_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(star_mcap, "PACKAGES", ("mcap", "no_such_package"))
    assert main(["recover", str(tmp_path)]) == 2
    assert "[missing-package]" in capsys.readouterr().err
