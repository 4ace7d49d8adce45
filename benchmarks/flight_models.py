"""Predictions of rigid-body models from recorded states and PWM."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from recorded_flights import Flight, body_axes, rms

from star_core import Array
from star_sim import airframe, powertrain
from star_sim.airframe import CYCLE

HORIZON = 50  # samples, 0.5 s
EVERY = 10  # samples between two predictions


@dataclass
class State:
    """States of S drones: (S, 3) position, velocity and rates, (S, 4) attitude and motors."""

    position: Array
    velocity: Array
    attitude: Array
    rates: Array
    motors: Array


# Returns the motors' next state and the linear and angular acceleration, (S, 3) each, from a state
# and motor voltages, (S, 4), for a step of some seconds.
Model = Callable[[State, Array, float], tuple[Array, Array, Array]]


def ours(state: State, voltage: Array, step: float) -> tuple[Array, Array, Array]:
    """The simulator's motors and rigid body; motors are thrusts, N."""
    a, target = airframe, powertrain.THRUST_PER_SQUARED_VOLTAGE * voltage**2
    share = 1 - np.exp(-step / powertrain.MOTOR_LAG)
    thrust = state.motors + share * (target - state.motors)
    first, second, third, fourth = thrust.T
    torque = np.stack(
        [
            a.ARM * (-first - second + third + fourth),
            a.ARM * (-first + second + third - fourth),
            a.TORQUE_PER_THRUST * (-first + second - third + fourth),
        ],
        axis=1,
    )
    inertia = np.array([a.INERTIA_XY, a.INERTIA_XY, a.INERTIA_Z])
    torque -= np.cross(state.rates, inertia * state.rates)
    axes = body_axes(state.attitude)
    along = np.einsum("sij,si->sj", axes, state.velocity)
    torque[:, 0] += powertrain.MOMENT * along[:, 1]
    torque[:, 1] -= powertrain.MOMENT * along[:, 0]
    force = -np.array([powertrain.DRAG, powertrain.DRAG, a.DRAG_Z]) * along
    force[:, 2] += thrust.sum(axis=1)
    push = np.einsum("sij,sj->si", axes, force) / a.MASS - [0, 0, a.GRAVITY]
    return thrust, push, torque / inertia


def theirs(drone: str) -> Model | None:
    """First-principles model of drone-models for an airframe; None where it is not installed."""
    try:
        from drone_models.core import load_params, parametrize
        from drone_models.first_principles import dynamics
    except ImportError:
        return None
    flow, table = parametrize(dynamics, drone), load_params("first_principles", drone)
    base, slope = np.asarray(table["vmotor2rpm"], float)

    def model(state: State, voltage: Array, step: float) -> tuple[Array, Array, Array]:
        command = base + slope * voltage
        _, _, push, turn, spin = flow(
            state.position, state.attitude, state.velocity, state.rates, command, state.motors
        )
        return state.motors + step * spin, push, turn

    return model


def advance(state: State, model: Model, voltage: Array, trim: Array, steps: int = 5) -> State:
    """Return the states 10 ms later under (S, 4) motor voltages.

    The (4,) trim is added to the accelerations: about the three axes, and along z.
    """
    for _ in range(steps):
        step = CYCLE / steps
        motors, push, turn = model(state, voltage, step)
        velocity = state.velocity + step * (push + trim[3] * body_axes(state.attitude)[:, :, 2])
        rates = state.rates + step * (turn + trim[:3])
        x, y, z, w = state.attitude.T
        p, q, r = rates.T
        change = [w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p]
        change.append(-x * p - y * q - z * r)
        attitude = state.attitude + 0.5 * step * np.stack(change, axis=1)
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
        state = State(state.position + step * velocity, velocity, attitude, rates, motors)
    return state


def predict(flight: Flight, model: Model) -> dict[str, float]:
    """Return RMS errors of a model's predictions over a flight.

    Motors are followed from their start. Constant accelerations about the body's axes and along its
    z axis, for which the mean errors over the flight are zero, stand for the weight and the unequal
    motors of the drone, for every model alike.
    """
    data = flight.data
    voltage = data["pwm"] / powertrain.FULL * data["voltage"][:, None]
    names = ("position", "velocity", "attitude", "gyro")
    spin = np.zeros((len(voltage), 4))
    still = State(np.zeros((1, 3)), np.zeros((1, 3)), np.eye(4)[3:], np.zeros((1, 3)), spin[:1])
    for k in range(flight.began, flight.counted.stop - 1):
        spin[k + 1] = still.motors = model(still, voltage[k : k + 1], CYCLE)[0]
    starts = np.arange(flight.counted.start, flight.counted.stop - HORIZON, EVERY)
    even = np.ptp(data["time"][starts[:, None] + np.arange(HORIZON + 1)], axis=1)
    starts = starts[np.abs(even - HORIZON * CYCLE) < CYCLE / 2]  # no sample is missing
    place, velocity, attitude, rates = (data[name][starts] for name in names)
    begin = State(place, velocity, attitude, rates, spin[starts])
    end = advance(begin, model, voltage[starts], np.zeros(4))
    missing = data["velocity"][starts + 1] - end.velocity
    up = body_axes(begin.attitude)[:, :, 2]
    trim = np.append(
        (data["gyro"][starts + 1] - end.rates).mean(axis=0), (missing * up).sum(axis=1).mean()
    )
    trim /= CYCLE
    end = advance(begin, model, voltage[starts], trim)
    state = begin
    for k in range(HORIZON):
        state = advance(state, model, voltage[starts + k], trim)
    after = starts + HORIZON
    up, flown_up = body_axes(state.attitude)[:, :, 2], body_axes(data["attitude"][after])[:, :, 2]
    return {
        "step_velocity": rms(end.velocity - data["velocity"][starts + 1]),
        "step_rates": rms(end.rates - data["gyro"][starts + 1]),
        "half_position": rms(state.position - data["position"][after]),
        "half_velocity": rms(state.velocity - data["velocity"][after]),
        "half_tilt": float(np.degrees(rms(up - flown_up))),
    }
