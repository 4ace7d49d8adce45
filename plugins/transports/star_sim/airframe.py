"""The airframe: a Crazyflie 2.1 with its legacy propellers and 250 mAh battery, as published.

Mass, inertia, arm, torque and drag are the set ``cf2x_L250`` that was identified in flight by
utiasDSL's drone-models 0.1.0 (``data/params.toml``); the thrust of a motor over its voltage and its
limits are those of the firmware's ``platform_defaults_cf2.h``. Body axes: x forward, y left, z up.
"""

from __future__ import annotations

import math

GRAVITY = 9.81  # m/s²
MASS = 0.0319  # kg
INERTIA_XY = 16.8e-6  # kg m², about the body's x and its y axis
INERTIA_Z = 29.8e-6  # kg m²
ARM = 0.03253  # m, of each motor along the body's x and along its y axis
TORQUE_PER_THRUST = 0.00735  # N m / N, of a propeller about its axis
DRAG_XY = 0.0147  # N s/m, along the body's x and its y axis
DRAG_Z = 0.0128  # N s/m

THRUST_MIN = 0.0128  # N, of a motor that is on
THRUST_MAX = 0.12  # N, of one motor
THRUST_OF_VOLTAGE = (-0.024765, 0.065238, -0.026793, 0.0067768)  # N, N/V, N/V², N/V³: one motor

# From an earlier version of drone-models, which describes the value for this set as not yet fitted.
MOTOR_LAG = 0.03  # s

# Propellers of two drones touch when their centres are 0.12 m apart: that is a collision. They
# yield; the frames bounce, whose motor mounts extend 4 mm beyond the motor axes.
FRAME_RADIUS = 0.05  # m
HEIGHT = 0.029  # m from the foot, where its position is counted, to the top

STEP = 0.002  # s, of the rigid body and of the attitude loop
NEVER = 1 << 62  # number of a step that does not come
STEPS_PER_CYCLE = 5  # the position loop, the commander and the estimator run once per cycle
CYCLE = STEP * STEPS_PER_CYCLE  # s
MOTOR_STEP = 1.0 - math.exp(-STEP / MOTOR_LAG)  # of the way to the commanded thrust, in one step
HOVER_THRUST = MASS * GRAVITY / 4  # N, of one motor
