"""Error models of the Flow deck's sensors, and their random numbers.

Standard deviations are fitted to the drift of a real Crazyflie over three laps of a box, a circle
and a figure of eight; flow-sensor counts and ranger noise follow the firmware's measurement models
(``mm_flow.c``, ``zranger2.c``). `star_sim.error_profile` has those that depend on the profile.
"""

from __future__ import annotations

import math

import numpy as np

from star_core import Array
from star_core.toolkit import subroutine
from star_sim.airframe import CYCLE
from star_sim.drone import Drones, Record
from star_sim.error_profile import ErrorProfile

# Once per flight.
SCALE = 0.05
MISALIGNMENT = math.radians(1.0)
VELOCITY_BIAS = 0.004  # m/s, along each axis of the body
GYRO_BIAS = math.radians(0.20)  # rad/s, left over after the firmware's own calibration
START_OFFSET = 0.02  # m, along each axis
START_TURN = math.radians(1.0)
LEVEL_ERROR = math.radians(0.25)  # of roll and of pitch

# The floor.
TEXTURE = 0.045  # standard deviation of the flow sensor's scale over the floor
TEXTURE_LENGTH = 0.7  # m, correlation length
TEXTURE_PITCH = 0.2  # m between the points of its lattice
TEXTURE_POINTS = 128  # of its lattice along each axis, a power of two; then it repeats (25.6 m)

PIXELS = 35.0 / 0.71674  # per rad of the flow sensor's view
COUNTS = PIXELS * CYCLE / 0.1  # per (m/s)/m: a count is a tenth of a pixel
LEAST_HEIGHT = 0.1  # m
OUTLIER = 100  # counts

_TEXTURE_STREAM, _ERROR_STREAM, NOISE_STREAM = 7331, 7332, 7333
_BIAS_STREAM, _WANDER_STREAM = 7334, 7335
WANDERING = 7  # errors that change slowly: columns of `Wander.block`


def draw_texture(seed: int) -> Array:
    """Return the flow sensor's scale error over the floor, as a fraction: (M, M), x first.

    A Gaussian random field with standard deviation `TEXTURE` and correlation ``exp(-d²/2l²)`` over
    a distance d, with l = `TEXTURE_LENGTH`; periodic in x and y.
    """
    white = np.random.default_rng([seed, _TEXTURE_STREAM]).standard_normal((TEXTURE_POINTS,) * 2)
    step = np.fft.fftfreq(TEXTURE_POINTS, 1 / TEXTURE_POINTS) * TEXTURE_PITCH  # m, from the origin
    bell = np.exp(-((step / TEXTURE_LENGTH) ** 2))  # with itself it makes exp(-d²/2l²)
    kernel = np.outer(bell, bell)
    smooth = np.fft.ifft2(np.fft.fft2(white) * np.fft.fft2(kernel)).real
    return np.ascontiguousarray(TEXTURE * smooth / math.sqrt(float((kernel**2).sum())))


def draw_errors(drones: Drones, profile: ErrorProfile, seed: int) -> None:
    """Draw each drone's constant sensor errors and the offset of its start position."""
    drones["flow_noise"], drones["gyro_noise"] = profile.flow_noise, profile.gyro_noise
    constant, draws = (
        np.stack([each.standard_normal(count) for each in streams(seed, stream, len(drones))])
        for stream, count in ((_BIAS_STREAM, 4), (_ERROR_STREAM, 10))
    )
    drones["accelerometer_bias"] = profile.accelerometer_bias * constant[:, :3]
    drones["ranger_bias"] = profile.ranger_bias * constant[:, 3]
    drones["scale"] = SCALE * draws[:, 0]
    turn = MISALIGNMENT * draws[:, 1]
    drones["misalignment"] = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    drones["velocity_bias"] = VELOCITY_BIAS * draws[:, 2:4]
    drones["gyro_bias"] = GYRO_BIAS * draws[:, 4]
    drones["level_error"] = LEVEL_ERROR * draws[:, 8:10]
    for name in ("position", "seen_position", "origin"):
        drones[name][:, :2] += START_OFFSET * draws[:, 5:7]
    yaw = drones["origin_yaw"] + START_TURN * draws[:, 7]
    drones["seen_yaw"] = drones["origin_yaw"] = yaw
    drones["attitude"][:, 2:] = np.stack([np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
    drones["slip"] = np.stack([np.cos(yaw), -np.sin(yaw)], axis=1)


def streams(seed: int, number: int, agents: int) -> list[np.random.Generator]:
    """Return a random stream of each agent, so that what it draws depends on no other agent.

    Args:
        seed: Of the flight.
        number: Of what is drawn.
        agents: Number of agents.
    """
    return [np.random.default_rng([seed, number, row]) for row in range(agents)]


def gauss_markov(drive: Array, keep: float | Array, last: Array) -> Array:
    """Return the (cycles, ...) states ``keep * last + drive`` of processes, each from the last one.

    It is the filter of ``scipy.signal.lfilter``, which takes half a second to import.

    Args:
        drive: (cycles, ...) white noise.
        keep: Share of a state that is left after a cycle.
        last: (...) states before.

    Example:
        >>> gauss_markov(np.array([1.0, 0.0]), 0.5, np.array(4.0))
        array([3. , 1.5])
    """
    states = np.empty_like(drive)
    for cycle, noise in enumerate(drive):
        last = states[cycle] = keep * last + noise
    return states


class Wander:
    """Sensor errors of all drones that change in flight, for the estimators with an IMU.

    A slowly changing error is a first-order Gauss-Markov process, in its steady state from the
    start. Each drone has its own random stream.
    """

    def __init__(self, profile: ErrorProfile, seed: int, agents: int) -> None:
        self._streams = streams(seed, _WANDER_STREAM, agents)
        gyro, acceleration = profile.gyro_wander, profile.accelerometer_wander
        self._std = np.array([profile.flow_scale_wander, *[gyro] * 3, *[acceleration] * 3])
        self._white = np.array([0.0, *[profile.gyro_noise] * 3, *[profile.accelerometer_noise] * 3])
        times = [profile.flow_scale_time]
        times += [profile.gyro_time] * 3 + [profile.accelerometer_time] * 3
        self._keep = np.exp(-CYCLE / np.array(times))
        draws = [stream.standard_normal(WANDERING) for stream in self._streams]
        self._state = self._std * np.stack(draws)  # (N, WANDERING)

    def block(self, cycles: int) -> Array:
        """Return the errors of the next cycles, (cycles, N, WANDERING).

        Columns: scale of the flow sensor, as a fraction; rates about x, y, z, rad/s; accelerations
        along x, y, z of the body, m/s².
        """
        draws = [stream.standard_normal((2, cycles, WANDERING)) for stream in self._streams]
        drive, white = np.stack(draws, axis=2)
        drive *= self._std * np.sqrt(1 - self._keep**2)
        wandered = gauss_markov(drive, self._keep, self._state)
        self._state = wandered[-1].copy()
        errors: Array = wandered + self._white * white
        return errors


@subroutine
def flow(
    drone: Record,
    normal: Record,
    texture: Record,
    heading: tuple[float, float],
    height: float,
    upright: float,
    wander: float,
) -> tuple[float, float]:
    """Return the forward and lateral velocity measured by the flow sensor over one cycle, m/s.

    The sensor counts tenths of a pixel, ``dt * 35 / 0.71674 * v * R22 / z``, carries fractions of a
    count over to the next sample, and is converted back with the estimated height. Its scale has a
    constant error, one that varies over the floor, and one that varies in time. The caller
    compensates the body's rotation with the gyro.

    Args:
        drone: The drone; moved by one cycle since `seen_position`.
        normal: (4,) standard normal numbers, of which the first two are used.
        texture: (M, M) scale error over the floor.
        heading: Cosine and sine of the believed yaw.
        height: Estimated height over the surface below, m.
        upright: z component of the body's z axis.
        wander: Error of the scale that varies in time, as a fraction.
    """
    east = (drone.position[0] - drone.seen_position[0]) / CYCLE
    north = (drone.position[1] - drone.seen_position[1]) / CYCLE
    cos, sin = drone.slip[0], drone.slip[1]
    east, north = cos * east - sin * north, sin * east + cos * north
    ahead, aside = heading[0] * east + heading[1] * north, heading[0] * north - heading[1] * east
    cos, sin = drone.misalignment[0], drone.misalignment[1]
    scale = 1 + drone.scale + _texture_at(texture, drone.position[0], drone.position[1]) + wander
    scale *= COUNTS * upright / max(drone.position[2] - drone.surface, LEAST_HEIGHT)
    first = _count(drone, 0, scale * (cos * ahead - sin * aside) + drone.flow_noise * normal[0])
    second = _count(drone, 1, scale * (sin * ahead + cos * aside) + drone.flow_noise * normal[1])
    back = max(height, LEAST_HEIGHT) / (COUNTS * max(upright, LEAST_HEIGHT))
    return first * back + drone.velocity_bias[0], second * back + drone.velocity_bias[1]


@subroutine
def ranged(height: float, normal: float) -> float:
    """Return the height measured by the VL53L1x, m, to 1 mm; its noise grows from 2.5 m on."""
    deviation = 0.0025 * (1 + math.exp(2.92 * (height - 2.5)))
    return math.floor((height + deviation * normal) * 1000 + 0.5) / 1000


@subroutine
def _count(drone: Record, axis: int, flow: float) -> float:
    """Return the integer counts of a flow, clipped to the sensor's outlier limit."""
    flow += drone.flow_rest[axis]
    whole = math.floor(flow + 0.5)
    drone.flow_rest[axis] = flow - whole
    return min(max(whole, -OUTLIER), OUTLIER)


@subroutine
def _texture_at(texture: Record, x: float, y: float) -> float:
    """Return the scale error at a point of the map, interpolated linearly on the lattice."""
    x, y = x / TEXTURE_PITCH, y / TEXTURE_PITCH
    i, j = math.floor(x), math.floor(y)
    u, v = x - i, y - j
    last = TEXTURE_POINTS - 1  # all ones: a power of two less one
    k, m = (int(i) + 1) & last, (int(j) + 1) & last
    i, j = int(i) & last, int(j) & last
    near = (1 - v) * texture[i, j] + v * texture[i, m]
    far = (1 - v) * texture[k, j] + v * texture[k, m]
    return float((1 - u) * near + u * far)
