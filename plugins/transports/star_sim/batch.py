"""Layout of the data of eight drones while the body is stepped.

Numbers of the same kind of eight drones are adjacent, so that the compiler can step four drones
with each SIMD instruction. A constant is the index of that number of the first drone.
"""

from __future__ import annotations

LANES = 8

# The rigid body and its motors: position, velocity, attitude, rates, thrust of each motor.
X, Y, Z, VX, VY, VZ, QX, QY, QZ, QW, P, Q, R, F1, F2, F3, F4 = (LANES * k for k in range(17))
VOLTAGE = LANES * 17

# Input of the ideal controller: commanded force, its reciprocal norm, yaw rate, limit of a motor.
PX, PY, PZ, SHARE, YAW_RATE, CEILING = (LANES * k for k in range(18, 24))

# The firmware's controllers: commanded angles and thrust, believed ones, and how rates change them.
TARGET_ROLL, TARGET_PITCH, TARGET_THRUST = (LANES * k for k in range(24, 27))
ROLL, PITCH, YAW_ERROR, ROLL_SIN, ROLL_COS, PITCH_TAN = (LANES * k for k in range(27, 33))
INTEGRAL = LANES * 33  # of roll, pitch and yaw, then of their three rates
LAST_RATE = LANES * 39  # of the three rates, in the step before
PWM = LANES * 42  # of each motor
GAIN = LANES * 46  # see `star_sim.stabilizer.GAINS`

ON = LANES * 57  # of each motor: its share of the thrust, 0 while it is off

BATCH_SIZE = LANES * 61  # numbers, of eight drones
