"""How closely simulated Crazyflies move like real ones, flight by flight.

``python benchmarks/real_flights.py [FOLDER]`` reads recorded flights (``*.npz``) and, for each,

* replays the recorded setpoints in the simulator, from the recorded start on the ground to where
  the real drone landed or left its trajectory, and compares the paths at equal times, the lag
  behind the setpoints and the PWM; a second replay lets the estimate of the position trail by the
  latency that it has in the recordings, one constant for all flights; a third one adds the recorded
  errors of the on-board estimate, and so tests controller and body alone;
* predicts, from recorded states and PWM, the next sample and the state 0.5 s later, with the
  simulator's rigid body and motors and with those of drone-models, where that is installed
  (crazyflow simulates the same models).

`benchmarks/recorded_flights.py` describes the files. The flights behind the figures in
docs/simulator.md are those of NanoBench (Ullah and Baca, arXiv 2603.09908, 2026).
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import Any

os.environ.setdefault("SCIPY_ARRAY_API", "1")  # what drone-models requires before scipy comes

import numpy as np
from flight_models import Model, ours, predict, theirs
from recorded_flights import ESTIMATE_LATENCY, FOLDER, Flight, read, recorded, rms

from star_core import Agent, Array, Fence, Scene, World
from star_sim import discharge, ideal_world
from star_sim.airframe import CYCLE
from star_sim.cascade import EARLIER_HEIGHT_GAIN
from star_sim.drone import DEMAND, OFF, POSITION
from star_sim.transport import Simulator

TENTHS = np.linspace(0.0, 1.0, len(discharge.VOLTAGE_OF_CHARGE))


REPLAYS = {"true": "", "late": "late_", "recorded": "estimated_"}
"""Estimates that the simulated controller flies by, and prefixes of the figures' names."""


def replay(flight: Flight, controller: str, estimate: str) -> dict[str, Array]:
    """Fly the recorded setpoints in the simulator.

    Args:
        flight: A recorded one.
        controller: Name of a controller of the transport `sim`.
        estimate: What the simulated controller believes: the true state; the true state with a
            position in the plane that is `ESTIMATE_LATENCY` old; or with the recorded errors.

    Returns:
        ``position`` (T, 3) m, ``pwm`` (T, 4) and ``voltage`` (T,) V at the recorded times; NaN
        before the start.
    """
    data, began = flight.data, flight.began
    start = data["position"][began]
    x, y, z, w = data["attitude"][began]
    yaw = float(np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z)))
    world = World("recorded", Fence((-9.0, -9.0, 0.0), (9.0, 9.0, 9.0)))
    agent = Agent("cf1", (float(start[0]), float(start[1]), 0.0), yaw)
    simulator = Simulator(
        Scene((agent,), 0.05, world, seed=0), **ideal_world(noise=False, controller=controller)
    )
    simulator.connect()
    drone = simulator.drones[0]
    drone["origin"], drone["origin_yaw"] = 0.0, 0.0
    drone["believed_position"], drone["believed_yaw"] = (*start[:2], 0.0), yaw
    drone["slip"] = 1.0, 0.0
    rest = np.array(discharge.VOLTAGE_OF_CHARGE)
    drone["charge"] = np.interp(data["voltage"][: max(1, began - 30)].mean(), rest, TENTHS)
    if simulator.cascades is not None:
        simulator.cascades["height_integral_gain"] = EARLIER_HEIGHT_GAIN
    drone["feed_forward"] = 0.0  # the recorded setpoints were positions
    drone["setpoint_time"] = np.inf
    time = data["time"] - data["time"][began]
    flown: dict[str, Array] = {
        "position": np.full((len(time), 3), np.nan),
        "pwm": np.full((len(time), 4), np.nan),
        "voltage": np.full(len(time), np.nan),
    }
    for k in range(began, flight.counted.stop):
        setpoint = data["setpoint"][k]
        if np.any(setpoint != 0):
            drone["mode"], drone["axes"] = DEMAND, POSITION
            drone["reference_position"] = setpoint[:3] - (0.0, 0.0, flight.floor)
            drone["reference_yaw"] = np.radians(setpoint[3])
        else:
            drone["mode"] = OFF
        flown["position"][k] = drone["position"] + (0.0, 0.0, flight.floor)
        flown["voltage"][k] = drone["voltage"]
        if simulator.cascades is not None:
            flown["pwm"][k] = simulator.cascades["pwm"][0]
        simulator.wait(round(time[k + 1] / CYCLE) * CYCLE)
        if estimate == "late":
            drone["believed_position"][:2] -= ESTIMATE_LATENCY * drone["velocity"][:2]
        elif estimate == "recorded":
            for name in ("position", "velocity"):
                drone[f"believed_{name}"] += data[f"estimate_{name}"][k + 1] - data[name][k + 1]
    return flown


def lag(time: Array, path: Array, setpoint: Array) -> float:
    """Return the delay, s, at which delayed (T, 2) setpoints are nearest to a (T, 2) path."""
    delays = np.arange(0.0, 1.2, 0.005)
    errors = []
    for delay in delays:
        late = [np.interp(time - delay, time, column) for column in setpoint.T]
        inner = time > time[0] + delays[-1]
        errors.append(((np.stack(late, axis=1) - path)[inner] ** 2).sum(axis=1).mean())
    return float(delays[int(np.argmin(errors))])


def compare(flight: Flight, controller: str) -> dict[str, float]:
    """Return the figures of one replayed flight."""
    data, part = flight.data, flight.counted
    time, real, setpoint = data["time"][part], data["position"][part], data["setpoint"][part]
    flights = {estimate: replay(flight, controller, estimate) for estimate in REPLAYS}
    flown = flights["true"]
    figures = {}
    for estimate, prefix in REPLAYS.items():
        path = flights[estimate]["position"][part]
        figures[f"{prefix}lag_sim"] = lag(time, path[:, :2], setpoint[:, :2])
        figures[f"{prefix}rms_xy"] = rms((path - real)[:, :2])
        figures[f"{prefix}rms_z"] = rms((path - real)[:, 2:])
        figures[f"{prefix}rms"] = rms(path - real)
    return figures | {
        "seconds": float(time[-1] - time[0]),
        "speed": flight.speed,
        "lag_real": lag(time, real[:, :2], setpoint[:, :2]),
        "pwm_real": float(data["pwm"][part].mean()),
        "pwm_sim": float(flown["pwm"][part].mean()),
        "voltage_real": float(data["voltage"][part].mean()),
        "voltage_sim": float(flown["voltage"][part].mean()),
    }


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    parser.add_argument("--controller", choices=["ideal", "pid", "mellinger"])
    parser.add_argument("--json", action="store_true", help="print one JSON object, only")
    options = parser.parse_args()
    models: dict[str, Model] = {"simulator": ours}
    for drone in ("cf2x_L250", "cf2x_P250"):
        peer = theirs(drone)
        if peer is not None:
            models[f"drone-models {drone}"] = peer
    figures: dict[str, Any] = {}
    for path in recorded(options.folder):
        flight = read(path)
        row: dict[str, Any] = {"controller": options.controller or flight.controller}
        row |= compare(flight, row["controller"])
        row["predictions"] = {name: predict(flight, model) for name, model in models.items()}
        figures[flight.name] = row
        if not options.json:
            print_row(flight.name, row, header=len(figures) == 1)
    if options.json:
        print(json.dumps(figures))
    else:
        print_summary(figures)


COLUMNS = (  # title, key, format
    ("s", "seconds", "5.1f"),
    ("m/s", "speed", "5.2f"),
    ("lag s, real", "lag_real", "6.2f"),
    ("sim", "lag_sim", "6.2f"),
    ("RMS m, xy", "rms_xy", "6.3f"),
    ("z", "rms_z", "6.3f"),
    ("late: lag", "late_lag_sim", "6.2f"),
    ("xy", "late_rms_xy", "6.3f"),
    ("recorded: lag", "estimated_lag_sim", "6.2f"),
    ("xy", "estimated_rms_xy", "6.3f"),
    ("z", "estimated_rms_z", "6.3f"),
    ("PWM, real", "pwm_real", "6.0f"),
    ("sim", "pwm_sim", "6.0f"),
    ("V, real", "voltage_real", "5.2f"),
    ("sim", "voltage_sim", "5.2f"),
)


def print_row(name: str, row: dict[str, Any], *, header: bool) -> None:
    """Print one flight of the table."""
    widths = [max(len(title), int(form[0])) for title, _, form in COLUMNS]
    if header:
        titles = "  ".join(
            f"{title:>{w}}" for (title, _, _), w in zip(COLUMNS, widths, strict=True)
        )
        print(f"{'flight':16} {'controller':10}  {titles}")
    numbers = "  ".join(
        f"{format(row[key], form):>{w}}" for (_, key, form), w in zip(COLUMNS, widths, strict=True)
    )
    print(f"{name:16} {row['controller']:10}  {numbers}")


def print_summary(figures: dict[str, Any]) -> None:
    """Print medians and extremes over the flights at each speed, and the errors of predictions."""
    rows = list(figures.values())
    print("\nmedian (worst)                estimate    lag, sim - real s   RMS xy m")
    for low, high in ((0.0, 0.6), (0.6, 0.85), (0.85, 9.9)):
        some = [row for row in rows if low <= row["speed"] < high]
        for estimate, prefix in REPLAYS.items() if some else ():
            late = np.array([row[f"{prefix}lag_sim"] - row["lag_real"] for row in some])
            apart = np.array([row[f"{prefix}rms_xy"] for row in some])
            speed = np.median([row["speed"] for row in some])
            print(
                f"{speed:4.2f} m/s, {len(some):2} flights        {estimate:8}   "
                f"{np.median(late):6.3f} ({late[np.argmax(np.abs(late))]:6.3f})     "
                f"{np.median(apart):6.3f} ({apart.max():.3f})"
            )
    share = [row["pwm_sim"] / row["pwm_real"] - 1 for row in rows]
    print(f"PWM, sim over real: median {np.median(share):+.1%}, worst {max(share, key=abs):+.1%}")
    print("\nmedians of the predictions' RMS errors: after 10 ms velocity m/s, rates rad/s;")
    print("after 0.5 s position m, velocity m/s, tilt °")
    for model in rows[0]["predictions"]:
        columns = [list(row["predictions"][model].values()) for row in rows]
        median = np.median(columns, axis=0)
        print(f"{model:24}" + "".join(f"{value:9.3f}" for value in median))


if __name__ == "__main__":
    main()
