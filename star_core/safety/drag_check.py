"""Finds agents that fly faster than they report, by the drag that their accelerometers measure."""

from __future__ import annotations

from typing import Final

import numpy as np

from star_core.messages.arrays import Array, Mask
from star_core.messages.telemetry import Telemetry

DRAG: Final = 0.40
"""Deceleration by the air per speed, 1/s: 0.36 to 0.42 in 21 recorded flights of Crazyflies."""

EXCESS: Final = 0.43
"""Share of a reported velocity that is missing from it if the flow sensor measures 0.7 times the
flow: 1 / 0.7 - 1."""

TOLERATED: Final = 0.08
"""Share that is missing without a fault: scales of sensors and floors differ by 0.07 (standard
deviation)."""

NOISE: Final = 0.0005
"""Density of the noise of measured drag, (m/s²)² s. In the recorded flights, means over 1 s err by
0.023 m/s² below 0.8 m/s, and by 0.032 m/s² at 1 m/s: accelerometer, air, and attitude."""

NOISE_OF_SPEED: Final = 2.0  # s²/m², increase of that density with the square of the speed

BIAS_TIME: Final = 10.0  # s, in which a constant error of the accelerometer is learnt
LEARNING_TIME: Final = 1.0  # s in the air before evidence counts, and again until it counts in full

MIN_EVIDENCE: Final = 10.0
"""Logarithm of the likelihood ratio from which on a flow sensor is taken for wrong."""

MIN_TIME: Final = 0.5  # s in which the evidence can reach `MIN_EVIDENCE`: a bump is no flow sensor

SWAY_TIME: Final = 1.0  # s, over which unexplained drag is averaged in order to measure its noise
SWAY_SHARE: Final = 0.5  # of the noise measured so, that is at least assumed: gusts have more

MAX_GAP: Final = 0.2  # s between two reports


class DragCheck:
    """Compares the drag of the air with the velocities that agents report.

    Propellers push along the body's z axis, so an accelerometer along x and y measures the drag of
    the air, which is proportional to the velocity (Leishman, Macdonald, Beard and McLain,
    "Quadrotors and Accelerometers", IEEE Control Systems 34, 2014). It knows nothing of the flow
    sensor: if that sees 0.7 times the motion, the agent flies 1.43 times as fast as it reports, and
    the drag shows it for as long as it flies, while the corrections that `MotionCheck` adds up end
    within a second.

    A constant error of the accelerometer is learnt in `BIAS_TIME`. What is left of drag and
    reported velocity has the mean ``-DRAG EXCESS v`` with a wrong flow sensor, and zero without.
    The logarithm of the likelihood ratio adds up while it is positive (Page, Biometrika 41, 1954).
    An agent that was found stays so until it takes off again. Moving air looks like a wrong
    velocity: what is constant in the body is learnt, and gusts raise the noise that is assumed.

    Args:
        n: Number of agents.

    Attributes:
        evidence: (N,) logarithm of the likelihood ratio of a wrong flow sensor.
        missing: (N,) true less reported velocity by the drag, in odometry frames, x + iy, m/s; NaN
            where it is not known.
    """

    def __init__(self, n: int) -> None:
        self._time = np.full(n, np.nan)  # s, of the newest report
        self._bias = np.zeros(n, np.complex128)  # m/s², ahead + i left
        self._learnt = np.zeros(n)  # s
        self._sway = np.zeros(n, np.complex128)  # m/s², unexplained drag, averaged
        self._variance = np.zeros(n)  # (m/s²)², of that along one axis
        self.evidence = np.zeros(n)
        self.missing = np.full(n, np.nan, np.complex128)
        self._missing = np.zeros((2, n), np.complex128)  # m/s and m since the evidence was zero
        self._contradicted = np.zeros(n, np.bool_)
        self._airborne = np.zeros(n, np.bool_)  # in the last check

    def check(self, telemetry: Telemetry, airborne: Mask, contradicted: Mask | None = None) -> Mask:
        """Return the agents that fly faster than they report: (N,).

        Args:
            telemetry: Of the tick, in odometry frames.
            airborne: (N,) which agents are in the air.
            contradicted: (N,) agents whose reported velocities are known to be wrong: what their
                accelerometers measure is not taken for an error of these.
        """
        if telemetry.specific_force is None:
            return self._contradicted
        time = telemetry.time - telemetry.age
        passed = time - self._time
        force = telemetry.specific_force[:, 0] + 1j * telemetry.specific_force[:, 1]
        reported = telemetry.velocity[:, 0] + 1j * telemetry.velocity[:, 1]
        with np.errstate(invalid="ignore", over="ignore"):
            velocity = reported * np.exp(-1j * telemetry.heading)
            unexplained = force + DRAG * velocity
        usable = airborne & (passed > 0) & (passed <= MAX_GAP) & np.isfinite(unexplained)
        dt = np.where(usable, passed, 0.0)
        velocity = np.where(usable, velocity, 0.0)
        error = np.where(usable, unexplained - self._bias, 0.0)
        known = usable & (self._learnt > LEARNING_TIME)
        with np.errstate(invalid="ignore"):
            self.missing = np.where(known, -error / DRAG * np.exp(1j * telemetry.heading), np.nan)
        square = np.abs(velocity) ** 2
        self._sway += -np.expm1(-dt / SWAY_TIME) * (error - self._sway)
        measured = np.abs(self._sway) ** 2 / 2 - self._variance
        self._variance += -np.expm1(-dt / BIAS_TIME) * measured
        noise = NOISE * (1 + NOISE_OF_SPEED * square)
        noise = np.maximum(noise, SWAY_SHARE * 2 * SWAY_TIME * self._variance)
        difference, middle = DRAG * (EXCESS - TOLERATED), DRAG * (EXCESS + TOLERATED) / 2
        rate = -difference * ((error * velocity.conj()).real + middle * square) / noise
        trust = np.clip(self._learnt / LEARNING_TIME - 1, 0.0, 1.0)
        self.evidence = np.maximum(
            self.evidence + dt * trust * np.minimum(rate, MIN_EVIDENCE / MIN_TIME), 0.0
        )
        gain = -np.expm1(-dt / np.clip(self._learnt, dt + 1e-9, BIAS_TIME))
        wrong = self._contradicted if contradicted is None else self._contradicted | contradicted
        self._bias += np.where(wrong, 0.0, gain * error)
        self._learnt += dt
        self._note_missing(dt, np.where(usable, EXCESS * reported, 0.0), airborne)
        self._time = np.where(passed <= 0, self._time, time)
        self._contradicted |= self.evidence > MIN_EVIDENCE
        return self._contradicted

    def errors(self) -> tuple[Array, Array]:
        """Return by how much the motion of agents that were found differs from what they report.

        Returns:
            (N, 3) differences of the positions, m, and (N, 3) of the velocities, m/s, in the
            odometry frames; zero for other agents.
        """
        velocity, position = np.where(self._contradicted, self._missing, 0.0)
        level = np.zeros(len(self._learnt))
        return (
            np.stack([position.real, position.imag, level], axis=1),
            np.stack([velocity.real, velocity.imag, level], axis=1),
        )

    def _note_missing(self, dt: Array, velocity: Array, airborne: Mask) -> None:
        """Add up what the agents miss, and forget it where the evidence is zero or they landed."""
        self._missing[0] = np.where(dt > 0, velocity, self._missing[0])
        self._missing[1] += dt * velocity
        self._contradicted = self._contradicted & (~airborne | self._airborne)
        self._airborne = airborne
        for values in (self._bias, self._learnt, self._sway, self._variance, self.evidence):
            values[~airborne] = 0.0
        self._missing[:, (self.evidence == 0) & ~self._contradicted] = 0.0
