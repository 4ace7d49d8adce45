"""Writes the folder of a run: manifest, summary, trajectory, images and targets."""

from __future__ import annotations

import csv
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from star_core import Detections, Event, Flight, Frames, Image, Paths, Tick, hookimpl
from star_core.commands import event_record
from star_record.read_record import split_timing
from star_record.spool import Spool
from star_record.text_log import TextLog

log = logging.getLogger(__name__)


class Recorder:
    """Collects every tick and writes the tables at the end; the manifest is written at the start.

    `docs/record.md` describes the files.

    Args:
        lost: Extended by what cannot be recorded, with the reason.

    Attributes:
        log: The text log.
    """

    def __init__(self, flight: Flight, folder: Path, lost: list[str] | None = None) -> None:
        self._folder = folder
        self._lost = [] if lost is None else lost
        self._agents = flight.scene.names
        self._detections: list[Detections] = []
        self._planned = Paths.none()  # the latest
        self._save_frames = flight.save_frames
        self._unknown = {"truth_position", "truth_attitude", "signal"}  # in all ticks so far
        self._full = False  # whether a tick could not be stored
        with self._reporting():
            folder.mkdir(parents=True, exist_ok=True)
            self._trajectory, self._timing, self._paths = (
                Spool(folder / f"{name}.rows") for name in ("trajectory", "timing", "paths")
            )
            self._events = (folder / "events.jsonl").open("x", encoding="utf-8", buffering=1)
            self._write("manifest.json", flight.manifest)
            self.log = TextLog(folder / "log.txt")

    @hookimpl(specname="star_ticked")
    def add(self, tick: Tick) -> None:
        """Store one tick."""
        self.log.time = tick.time
        row: dict[str, Any] = {
            "time": tick.time,
            "estimate_position": tick.estimate.position,
            "estimate_velocity": tick.estimate.velocity,
            "estimate_yaw": tick.estimate.yaw,
            "estimate_valid": tick.estimate.valid,
            "estimate_position_std": np.sqrt(
                np.diagonal(tick.estimate.covariance, axis1=1, axis2=2)
            ),
            "goal_position": tick.goals.position,
            "goal_active": tick.goals.active,
            "setpoint_velocity": tick.sent.velocity,
            "setpoint_yaw": tick.sent.yaw,
            "setpoint_active": tick.sent.active,
            "phase": tick.health.phase,
            "battery": tick.health.battery,
        }
        truth, n = tick.truth, len(self._agents)
        for name, shape, value in (
            ("truth_position", (n, 3), None if truth is None else truth.position),
            ("truth_attitude", (n, 4), None if truth is None else truth.attitude),
            ("signal", (n,), tick.telemetry.signal),
        ):
            row[name] = np.full(shape, np.nan) if value is None else value
            if value is not None:
                self._unknown.discard(name)
        if len((detections := tick.detections).tag):
            self._detections.append(detections)
        if self._save_frames:
            self._save_images(tick.telemetry.frames)
        if not self._full:
            self._store(tick, row)

    def _store(self, tick: Tick, row: Mapping[str, Any]) -> None:
        """Store a tick and its row; after the first failure, store no more of them."""
        try:
            self._trajectory.add(row)
            self._timing.add({"time": tick.time, **tick.timing})
            self._store_paths(tick)
        except OSError as error:
            self._full = True
            self._lost.append(f"{self._folder}: trajectory from {tick.time:.2f} s on: {error}")
            log.warning("recording of the trajectory stopped: %s", error)

    def _store_paths(self, tick: Tick) -> None:
        """Store the planned paths that changed: their points, or one of NaN for none."""
        planned = tick.plan.paths.beyond(tick.estimate.position)
        for agent in planned.changed(self._planned).tolist():
            points = planned.of(agent)
            for point in points if len(points) else np.full((1, 3), np.nan):
                self._paths.add({"time": tick.time, "agent": agent, "point": point})
        self._planned = planned

    def _save_images(self, frames: Frames) -> None:
        """Write images; after the first failure, save no more of them."""
        for row, time, image in zip(frames.agent, frames.time, frames.image, strict=True):
            if time < 0:  # taken before the flight began
                continue
            path = self._folder / "frames" / self._agents[row] / f"{round(1000 * time):07d}.png"
            try:
                _write_image(path, image)
            except OSError as error:
                self._save_frames = False
                self._lost.append(f"{path.parent}: images from {time:.2f} s on: {error}")
                log.warning("saving of images stopped: %s", error)
                return

    @hookimpl
    def star_event(self, event: Event) -> None:
        self.log.write(event)
        with suppress(OSError):  # of a full disk, which the tables report
            self._events.write(json.dumps(event_record(event)) + "\n")

    @hookimpl(specname="star_mission_ended")
    def close(self, summary: Mapping[str, Any]) -> None:
        """Write the recorded data; the summary first, since the disk may be full.

        Raises:
            OSError: A file cannot be written, as after the folder was moved away or deleted.
        """
        with self._reporting():
            with suppress(OSError):  # of a full disk, which the tables report
                self._events.close()
            self.log.finish(summary)
            self._write_tables(summary)
            (self._folder / "events.jsonl").unlink(missing_ok=True)

    def _write_tables(self, summary: Mapping[str, Any]) -> None:
        for name, content in zip(("summary", "timing"), split_timing(summary), strict=True):
            self._write(f"{name}.json", content)
        if summary["targets"]["total"]:
            self._write_targets(summary["targets"]["list"])
        with self._trajectory as trajectory, self._timing as timing, self._paths as paths:
            columns = trajectory.columns()
            for name in self._unknown:
                columns.pop(name, None)
            path, agents = self._folder / "trajectory.npz", np.array(self._agents)
            np.savez_compressed(path, agents=agents, **columns)
            np.savez_compressed(self._folder / "timing.npz", **timing.columns())
            if planned := paths.columns():
                planned["agent"] = planned["agent"].astype(np.int64)
                np.savez_compressed(self._folder / "paths.npz", **planned)
        if self._detections:
            detections = Detections.merged(self._detections)
            arrays: dict[str, Any] = {
                field.name: getattr(detections, field.name) for field in fields(detections)
            }
            np.savez_compressed(self._folder / "detections.npz", **arrays)

    @contextmanager
    def _reporting(self) -> Iterator[None]:
        """Add files that cannot be written to what is lost."""
        try:
            yield
        except OSError as error:
            self._lost.append(f"{error.filename or self._folder}: {error.strerror or error}")
            raise

    def _write_targets(self, targets: Sequence[Mapping[str, Any]]) -> None:
        """Write ``targets.csv``: one line for each found target."""
        with (self._folder / "targets.csv").open("w", encoding="utf-8", newline="") as file:
            lines = csv.writer(file)
            lines.writerow(["target", "finder", "time_s", "x_m", "y_m", "z_m", "error_m"])
            for target in targets:
                position = [f"{value:.4f}" for value in (*target["position_m"], target["error_m"])]
                lines.writerow(
                    [target["name"], target["finder"], f"{target['time_s']:.3f}", *position]
                )

    def _write(self, name: str, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, indent=2, allow_nan=False)
        (self._folder / name).write_text(text + "\n", encoding="utf-8")


def _write_image(path: Path, image: Image) -> None:
    """Write an image as ``frames/AGENT/TIME.png``, with the mission time in milliseconds.

    Raises:
        OSError: It cannot be written.
    """
    import cv2

    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), image):
        raise OSError(f"{path} cannot be written")
