"""Faults of what transports receive and send: reports, images, setpoints and commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np

from star_core import Array, Command, Mask, Odometry, Scene, Setpoint, Telemetry
from star_core.toolkit import Fault
from star_faults.tables import Passing, joined, kept

MAX_VOLTAGE: Final = 5.0  # V, of readings that are garbage
GARBAGE: Final = 10.0  # standard deviation of numbers that are garbage
MAX_GRAY: Final = 255

Late = list[tuple[float, Any]]
"""Rows that have yet to arrive, with the mission time at which they do, s."""


class ReportFaults:
    """What a transport receives, with a fault of telemetry, link, battery or camera."""

    def __init__(self, fault: Fault, random: np.random.Generator, scene: Scene) -> None:
        self._fault = fault
        self._random = random
        self._n = len(scene.agents)
        self._passing = Passing(fault, random, self._n)
        self._late: dict[str, Late] = {}
        self._last: dict[int, Any] = {}  # image by row, in mode stuck

    def report(self, telemetry: Telemetry, now: float) -> Telemetry:
        """Return the telemetry as the fault lets it arrive at a mission time, s."""
        active = self._passing.active(now)
        if not active.any() and self._fault.mode != "delayed" and not self._late:
            return telemetry
        match self._fault.component, self._fault.mode:
            case "battery", _:
                return replace(telemetry, battery=self._battery(telemetry, active, now))
            case "camera", _:
                return self._images(telemetry, active, now)
            case _, "garbage":
                return self._garbage(telemetry, active)
            case _, "wrong":
                moved = np.where(active[:, None], np.array(self._fault.values["offset"]), 0.0)
                odometry = telemetry.odometry
                height = odometry.height + moved[odometry.agent, 2]
                return replace(
                    telemetry,
                    position=telemetry.position + moved,
                    odometry=replace(odometry, height=height),
                )
        return self._old(telemetry, active, now)

    def _old(self, telemetry: Telemetry, active: Mask, now: float) -> Telemetry:
        """Return telemetry with the rows that pass, and old ones."""
        fresh = self._passing.fresh(now)
        old, elapsed = self._passing.shown(telemetry, now, fresh)
        shown: Telemetry = old
        if self._fault.mode == "stuck":
            samples = _stuck(telemetry.odometry, shown, active)
            return replace(shown, age=telemetry.age, odometry=samples)
        return replace(
            shown,
            age=shown.age + elapsed,
            odometry=self._arrived("odometry", telemetry.odometry, active, fresh, now),
            frames=self._arrived("frames", telemetry.frames, active, fresh, now),
            detections=self._arrived("detections", telemetry.detections, active, fresh, now),
            refusals=tuple(refusal for refusal in telemetry.refusals if fresh[refusal.agent]),
        )

    def _arrived(self, name: str, table: Any, active: Mask, fresh: Mask, now: float) -> Any:
        """Return the rows of a long table that arrive, those that are late among them."""
        if self._fault.mode != "delayed":
            return kept(table, fresh[table.agent])
        late = self._late.setdefault(name, [])
        delayed = active[table.agent]
        if delayed.any():
            late.append((now + self._fault.values["delay"], kept(table, delayed)))
        due = [rows for time, rows in late if time <= now]
        late[:] = [entry for entry in late if entry[0] > now]
        return joined([*due, kept(table, ~delayed)])

    def _garbage(self, telemetry: Telemetry, active: Mask) -> Telemetry:
        """Return telemetry with NaN or random numbers."""

        def spoil(values: Array, mask: Mask) -> Array:
            noise = GARBAGE * self._random.standard_normal(values.shape)
            noise[self._random.random(len(values)) < 0.5] = np.nan  # noqa: PLR2004 -- one in two
            return np.where(mask.reshape(-1, *[1] * (values.ndim - 1)), noise, values)

        samples = telemetry.odometry
        rows = active[samples.agent]
        samples = replace(
            samples,
            velocity=spoil(samples.velocity, rows),
            yaw_rate=spoil(samples.yaw_rate, rows),
            height=spoil(samples.height, rows),
        )
        force = telemetry.specific_force
        return replace(
            telemetry,
            position=spoil(telemetry.position, active),
            velocity=spoil(telemetry.velocity, active),
            attitude=spoil(telemetry.attitude, active),
            battery=spoil(telemetry.battery, active),
            odometry=samples,
            specific_force=None if force is None else spoil(force, active),
        )

    def _battery(self, telemetry: Telemetry, active: Mask, now: float) -> Array:
        """Return the reported voltages, (N,) V."""
        right = telemetry.battery
        match self._fault.mode:
            case "off":
                wrong: Any = np.nan
            case "stuck":
                shown, _ = self._passing.shown(telemetry, now, self._passing.fresh(now))
                wrong = shown.battery
            case "garbage":
                wrong = MAX_VOLTAGE * self._random.random(self._n)
            case _:
                wrong = (
                    right
                    if "charge" in self._fault.values
                    else self._fault.values["factor"] * right
                )
        return np.where(active, wrong, right)

    def _images(self, telemetry: Telemetry, active: Mask, now: float) -> Telemetry:
        """Return telemetry with the images and tags that a camera's fault lets arrive."""
        fresh = self._passing.fresh(now)
        if self._fault.mode in {"off", "slow", "delayed", "intermittent"}:
            return replace(
                telemetry,
                frames=self._arrived("frames", telemetry.frames, active, fresh, now),
                detections=self._arrived("detections", telemetry.detections, active, fresh, now),
            )
        frames, tags = telemetry.frames, telemetry.detections
        images = tuple(
            self._image(row, image) if active[row] else image
            for row, image in zip(frames.agent.tolist(), frames.image, strict=True)
        )
        if self._fault.mode == "garbage":
            noise = GARBAGE * self._random.standard_normal(tags.corners.shape)
            noise *= active[tags.agent][:, None, None]
            tags = replace(tags, corners=tags.corners + noise)
        return replace(telemetry, frames=replace(frames, image=images), detections=tags)

    def _image(self, row: int, image: Any) -> Any:
        if self._fault.mode == "stuck":
            return self._last.setdefault(row, image)
        if self._fault.mode == "wrong":
            bright = np.clip(self._fault.values["factor"] * image, 0, MAX_GRAY)
            return bright.astype(np.uint8)
        cut = image.copy()
        cut[int(self._random.integers(len(image))) :] = MAX_GRAY // 2
        return cut


def _stuck(samples: Odometry, shown: Telemetry, active: Mask) -> Odometry:
    """Return samples that repeat the state of agents whose reports are stuck: at rest there."""
    rows = active[samples.agent]
    zero = np.zeros(len(rows))
    return replace(
        samples,
        velocity=np.where(rows[:, None], 0.0, samples.velocity),
        yaw_rate=np.where(rows, zero, samples.yaw_rate),
        height=np.where(rows, shown.position[samples.agent, 2], samples.height),
    )


class SendFaults:
    """What a transport sends, with a fault of the link.

    Setpoints are lost; commands are sent again until they arrive, as by a radio with
    acknowledgements, except while the link is off.
    """

    def __init__(self, fault: Fault, random: np.random.Generator, scene: Scene) -> None:
        self._fault = fault
        self._random = random
        self._passing = Passing(fault, random, len(scene.agents))
        self._now = 0.0
        self._waiting: list[tuple[float, Command]] = []
        self._command: Callable[[Command], None] = lambda _command: None

    def wrap(
        self, send: Callable[[Setpoint], Setpoint], command: Callable[[Command], None]
    ) -> tuple[Callable[[Setpoint], Setpoint], Callable[[Command], None]]:
        """Return ``send`` and ``command`` of a transport, with the fault."""
        self._command = command

        def sent(setpoint: Setpoint) -> Setpoint:
            fresh = self._passing.fresh(self._now)
            shown, _ = self._passing.shown(setpoint, self._now, fresh)
            send(replace(shown, active=shown.active & fresh))
            return setpoint

        def commanded(request: Command) -> None:
            affected = self._passing.active(self._now)[request.agent]
            if (~affected).any():
                command(kept_command(request, ~affected))
            if affected.any() and self._fault.mode != "off":
                self._waiting.append((self._now + self._delay(), kept_command(request, affected)))

        return sent, commanded

    def deliver(self, now: float) -> None:
        """Deliver the commands that arrive by a mission time, s."""
        self._now = now
        due = [command for time, command in self._waiting if time <= now]
        self._waiting = [entry for entry in self._waiting if entry[0] > now]
        for command in due:
            self._command(command)

    def _delay(self) -> float:
        """Return how late a command arrives, s."""
        values = self._fault.values
        match self._fault.mode:
            case "slow":
                return 1 / float(values["rate"])
            case "delayed":
                return float(values["delay"])
        tries = self._random.geometric(max(1e-3, 1 - values["loss"]))
        return RESEND_TIME * (float(tries) - 1)


RESEND_TIME: Final = 0.02  # s, after which a radio sends a packet again


def kept_command(command: Command, mask: Mask) -> Command:
    """Return a command for some of its agents."""
    names = ("agent", "position", "yaw", "duration")
    return replace(command, **{name: getattr(command, name)[mask] for name in names})
