"""Agents that are followed in processes of their own."""

from __future__ import annotations

import logging
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np
import pytest

from star_apriltag import worker_pool
from star_apriltag.agent_group import TickInput
from star_apriltag.localizer import AprilTag, camera_reports
from star_apriltag.worker_pool import RemoteWorker, WorkerPool, default_processes
from star_core import Agent, Estimate, Frames, Scene, Telemetry
from tests.plugins.localizers.apriltag.conftest import (
    SETTINGS,
    TARGET,
    TICK,
    Circle,
    blank,
    flown,
    marked,
    off,
    room,
    sheets,
    telemetry,
    ticks,
)
from tests.plugins.localizers.apriltag.conftest import localizer as unclosed

TAGS = [*sheets(4), *sheets(4, centre=(6.0, 0.0), first=20)]
CIRCLES = [Circle(10, seed=1), Circle(10, centre=(6.0, 0.0), seed=2)]
ALL = np.ones(1, np.bool_)


@contextmanager
def localizer(scene: Scene, processes: int, **changes: Any) -> Iterator[AprilTag]:
    """A localizer that is closed in the end."""
    made = unclosed(scene, processes=processes, **changes)
    try:
        yield made
    finally:
        made.close()


def processes(made: AprilTag) -> list[int]:
    """The numbers of its processes, as the system has them."""
    return [w._process.pid for w in made._pool._workers if isinstance(w, RemoteWorker)]


def with_image(heard: Telemetry) -> Telemetry:
    """With an image of an unknown tag, at about a tick in ten."""
    if round(heard.time / TICK) % 10:
        return heard
    now = np.array([heard.time])
    image = Frames(np.zeros(1, np.int64), now - 0.01, now, (marked(77),))
    return replace(heard, frames=image)


def flight(workers: int) -> list[Estimate]:
    with localizer(room(CIRCLES, TAGS), workers) as made:
        return flown(made, CIRCLES, 2.0, [*TAGS, TARGET], change=with_image)


def test_a_flight_is_the_same_however_many_processes_there_are() -> None:
    alone, two = flight(0), flight(2)
    assert any(len(estimate.sightings.tag) for estimate in alone)
    for name in ("position", "covariance", "yaw", "velocity", "valid"):
        assert all(
            np.array_equal(getattr(a, name), getattr(b, name))
            for a, b in zip(alone, two, strict=True)
        )
    assert [e.sightings.tag.tolist() for e in alone] == [e.sightings.tag.tolist() for e in two]
    times = [e.detections.taken.tolist() for e in alone]
    assert list(chain(*times)) == pytest.approx(np.arange(10, 40, 10) * TICK - 0.01)
    assert times == [e.detections.taken.tolist() for e in two]


def test_a_tick_does_not_wait_for_a_process_in_real_time() -> None:
    circle = Circle(10, scale=1.1)
    with localizer(replace(room([circle], TAGS), realtime=True), 1) as made:
        (process,) = processes(made)
        os.kill(process, signal.SIGSTOP)
        heard = list(ticks([circle], 8.0, TAGS))
        late = [made.locate(report) for report in heard[:100]]  # rather than wait forever
        os.kill(process, signal.SIGCONT)
        for report in heard[100:]:
            time.sleep(0.02)
            estimate = made.locate(report)
    assert off(late, circle)[-1] > 0.1  # odometry only
    assert off([estimate], circle)[0] < 0.05


def test_only_agents_of_a_dead_process_are_unlocated(caplog: pytest.LogCaptureFixture) -> None:
    with localizer(room(CIRCLES, TAGS), 2) as made:
        heard = list(ticks(CIRCLES, 2.0, TAGS))
        for report in heard[:10]:
            made.locate(report)
        os.kill(processes(made)[1], signal.SIGKILL)
        estimates = [made.locate(report) for report in heard[10:]]
    assert estimates[-1].valid.tolist() == [True, False]
    assert np.isfinite(estimates[-1].position).all()
    (message,) = [r.getMessage() for r in caplog.records if r.levelno == logging.ERROR]
    assert message == "the process that estimates cf1 has ended with SIGKILL"


def test_an_error_in_a_process_is_raised() -> None:
    scene = room([Circle(1)], TAGS)
    settings = SETTINGS._replace(mounting_std=None)  # type: ignore[arg-type]
    made = WorkerPool(scene, settings, 1)
    try:
        heard = telemetry([Circle(1)], TICK)
        with pytest.raises(RuntimeError, match=r"(?s)estimating cf0 failed:\nTraceback"):
            made.update(TickInput(heard.time, heard.odometry, (), ALL))
    finally:
        made.close()


def test_log_messages_of_a_process_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    zero = np.zeros(1)
    image = Frames(np.zeros(1, np.int64), zero + 0.9, zero + 1.0, (blank(height=10),))
    with localizer(room([Circle(2)], TAGS), 1) as made:
        made.locate(replace(telemetry([Circle(2)], 1.0), frames=image))
        made.locate(telemetry([Circle(2)], 1.05))
    assert "an image of cf0 is ignored: image is (10, 324)" in caplog.text
    assert {record.name for record in caplog.records} == {"star_apriltag.agent_group"}


def test_processes_end_when_the_localizer_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_pool, "EXIT_TIMEOUT", 60.0)  # they may still be importing
    with localizer(room(CIRCLES, TAGS), 2) as made:
        workers = [w for w in made._pool._workers if isinstance(w, RemoteWorker)]
    assert [worker._process.returncode for worker in workers] == [0, 0]


def test_a_process_that_does_not_end_is_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_pool, "EXIT_TIMEOUT", 0.2)
    with localizer(room([Circle(1)], TAGS), 1) as made:
        (worker,) = (w for w in made._pool._workers if isinstance(w, RemoteWorker))
        made.locate(telemetry([Circle(1)], TICK))
        os.kill(worker._process.pid, signal.SIGSTOP)
    assert worker._process.returncode == -signal.SIGKILL


def test_a_late_process_gets_no_old_images_but_all_odometry() -> None:
    circle = Circle(3)
    worker = RemoteWorker(replace(room([circle], TAGS), realtime=True), [0], SETTINGS)
    try:
        for heard in ticks([circle], 3.0, TAGS):
            worker.send(
                TickInput(heard.time, heard.odometry, tuple(camera_reports(heard, 0.15)), ALL)
            )
        pending = worker._pending
    finally:
        worker.close()
    assert sum(len(tick.odometry.time) for tick in pending) == 300
    with_images = [tick.time for tick in pending if tick.images]
    assert with_images
    assert min(with_images) >= pending[-1].time - worker_pool.MAX_IMAGE_AGE


@pytest.mark.parametrize(
    ("cores", "threads", "realtime", "expected"),
    [
        (4, None, False, 2),
        (1, None, False, 0),
        (1, None, True, 1),
        (4, "1", False, 0),
        (2, "many", False, 1),
        (64, None, True, 2),
    ],
)
def test_default_processes_are_limited_by_cameras_and_cores(
    monkeypatch: pytest.MonkeyPatch,
    *,
    cores: int,
    threads: str | None,
    realtime: bool,
    expected: int,
) -> None:
    monkeypatch.setattr(worker_pool, "_cores", lambda: cores)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if threads is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
    scene = room(CIRCLES, TAGS)
    blind = Agent("cf2", (9.0, 0.0, 0.0))
    scene = replace(scene, agents=(*scene.agents, blind), realtime=realtime)
    assert default_processes(scene) == expected
