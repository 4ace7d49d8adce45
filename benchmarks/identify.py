"""The constants of `star_sim.powertrain`, from recorded flights of a Crazyflie.

``python benchmarks/identify.py [FOLDER]`` reads the files of ``benchmarks/recorded_flights.py``. It
uses the circles, helices and stars that the PID controller flew; all other flights test the
constants. For each constant it prints the median over flights, its quartiles, and the value that
the simulator has. Nothing is fitted to the paths: every constant is a regression of measured
accelerations, rates or voltages on measured PWM, voltages and velocities.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from recorded_flights import ESTIMATE_LATENCY, FOLDER, Flight, body_axes, read, recorded

from star_core import Array
from star_sim import airframe, battery, discharge, powertrain
from star_sim.airframe import CYCLE, GRAVITY, MASS

USED = ("circle", "helix", "star")  # in the names of the flights that identify
SECOND = 100  # samples
EDGE = 40  # samples at both ends that smoothing spoils
ACCELEROMETER_DELAY = 0.0075  # s: Butterworth of order 2 at 30 Hz (``sensors_bmi088_bmp3xx.c``)
MOVING = 0.1  # m/s
LAGS = np.arange(0.02, 0.15, 0.0025)  # s


def main() -> None:
    """Print the constants."""
    options = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    options.add_argument("folder", nargs="?", type=Path, default=FOLDER)
    folder = options.parse_args().folder
    flights = [
        flight
        for flight in map(read, recorded(folder))
        if flight.name.startswith(USED) and flight.controller == "pid"
    ]
    if not flights:
        options.error(f"no flights that identify in {folder}")
    thrust = [thrust_per_squared_voltage(flight) for flight in flights]
    lag = [motor_lag(flight) for flight in flights]
    print(f"{len(flights)} flights: {', '.join(flight.name for flight in flights)}")
    print("constant                        median   quartiles           simulator")
    show("THRUST_PER_SQUARED_VOLTAGE", thrust, powertrain.THRUST_PER_SQUARED_VOLTAGE)
    show("MOTOR_LAG", lag, powertrain.MOTOR_LAG)
    show("RESISTANCE", [resistance(flight) for flight in flights], discharge.CASCADE_RESISTANCE)
    show("DRAG", [drag(flight) for flight in flights], powertrain.DRAG)
    show("MOMENT", [moment(flight) for flight in flights], powertrain.MOMENT)
    print("of the recordings, for benchmarks/real_flights.py:")
    show("ESTIMATE_LATENCY", [estimate_latency(flight) for flight in flights], ESTIMATE_LATENCY)


def show(name: str, values: list[float], used: float) -> None:
    """Print one constant."""
    low, median, high = np.quantile(values, [0.25, 0.5, 0.75])
    print(f"{name:28} {median:9.3g}   {low:8.3g} {high:8.3g}   {used:9.3g}")


def motor_voltages(flight: Flight) -> Array:
    """Return the (T, 4) mean voltages of the motors, V."""
    voltages: Array = flight.data["pwm"] / powertrain.FULL * flight.data["voltage"][:, None]
    return voltages


def thrust_per_squared_voltage(flight: Flight) -> float:
    """Return the thrust of a motor over the square of its voltage, N/V²."""
    force = MASS * GRAVITY * flight.data["accelerometer"][flight.counted, 2].mean()
    return float(force / (motor_voltages(flight) ** 2).sum(axis=1)[flight.counted].mean())


def motor_lag(flight: Flight) -> float:
    """Return the lag at which squared voltages follow the accelerometer best, s.

    What changes within a second counts; the delay of the accelerometer's filter is subtracted.
    """
    squared_voltage = (motor_voltages(flight) ** 2).sum(axis=1)
    felt = _quick(flight.data["accelerometer"][:, 2])[flight.counted][SECOND:-SECOND]
    residuals = []
    for lag in LAGS:
        thrust = _quick(lagged(squared_voltage, lag))[flight.counted][SECOND:-SECOND]
        residuals.append(1 - np.corrcoef(thrust, felt)[0, 1] ** 2)
    return float(LAGS[int(np.argmin(residuals))]) - ACCELEROMETER_DELAY


def resistance(flight: Flight) -> float:
    """Return the resistance of cell and leads, ohm.

    A regression of the voltage on the current that the simulator's battery gives for the thrust,
    on the charge that has flowed, and on a constant; from before the start.
    """
    thrust = lagged(
        powertrain.THRUST_PER_SQUARED_VOLTAGE * motor_voltages(flight) ** 2, powertrain.MOTOR_LAG
    )
    power = (thrust**1.5).sum(axis=1)
    current = battery.ELECTRONICS_CURRENT + battery.CURRENT_PER_POWER * power
    part = slice(max(0, flight.began - SECOND), flight.counted.stop)
    charge = np.cumsum(current) * CYCLE
    table = np.stack([np.ones_like(charge), current, charge], axis=1)
    return -float(np.linalg.lstsq(table[part], flight.data["voltage"][part], rcond=None)[0][1])


def drag(flight: Flight) -> float:
    """Return the drag along the body's x and y axes over the velocity, N s/m."""
    along = _along(flight)
    slopes = [
        np.polyfit(along[:, axis], flight.data["accelerometer"][flight.counted, axis], 1)[0]
        for axis in (0, 1)
    ]
    return -float(np.mean(slopes)) * GRAVITY * MASS


def moment(flight: Flight) -> float:
    """Return the moment of the air over the velocity, N m / (m/s).

    A regression of the motors' torque on velocity, angular acceleration and a constant, for roll
    and pitch, smoothed over 0.3 s.
    """
    thrust = lagged(
        powertrain.THRUST_PER_SQUARED_VOLTAGE * motor_voltages(flight) ** 2, powertrain.MOTOR_LAG
    )
    along, inner = _along(flight), slice(EDGE, -EDGE)
    slopes = []
    for axis, mix, side, sign in ((0, (-1, -1, 1, 1), 1, -1), (1, (-1, 1, 1, -1), 0, 1)):
        torque = _smooth(airframe.ARM * thrust @ np.array(mix, float))[flight.counted]
        spin = _smooth(np.gradient(flight.data["gyro"][:, axis], CYCLE))[flight.counted]
        table = np.stack([_smooth(along[:, side]), spin, np.ones_like(spin)], axis=1)
        slopes.append(sign * np.linalg.lstsq(table[inner], torque[inner], rcond=None)[0][0])
    return float(np.mean(slopes))


def estimate_latency(flight: Flight) -> float:
    """Return by how much the on-board estimate of the position trails the measured one, s."""
    data, part = flight.data, flight.counted
    moving = np.linalg.norm(data["velocity"][part, :2], axis=1) > MOVING
    error = (data["estimate_position"] - data["position"])[part, :2][moving]
    velocity = data["velocity"][part, :2][moving]
    error, velocity = error - error.mean(axis=0), velocity - velocity.mean(axis=0)
    return float(-(error * velocity).sum() / (velocity**2).sum())


def lagged(values: Array, lag: float) -> Array:
    """Return (T, ...) values after a first-order lag, s."""
    answer = np.array(values)
    share = 1 - np.exp(-CYCLE / lag)
    for k in range(1, len(values)):
        answer[k] = answer[k - 1] + share * (values[k - 1] - answer[k - 1])
    return answer


def _along(flight: Flight) -> Array:
    """Return the (T, 3) velocity in the body, of what counts."""
    axes = body_axes(flight.data["attitude"][flight.counted])
    along: Array = np.einsum("sij,si->sj", axes, flight.data["velocity"][flight.counted])
    return along


def _smooth(values: Array, samples: int = 31) -> Array:
    window = np.hanning(samples + 2)[1:-1]
    return np.convolve(values, window / window.sum(), "same")


def _quick(values: Array) -> Array:
    """Return values less their mean over a second."""
    return values - np.convolve(values, np.ones(SECOND + 1) / (SECOND + 1), "same")


if __name__ == "__main__":
    main()
