"""The planner ``orbit`` of the verb ``external``: agents fly around a circle, evenly spaced."""

from math import cos, sin, tau

from star_external.planner import Done, Goal

RADIUS, HEIGHT, SPEED = 0.6, 1.0, 0.3  # m, m, m/s


class Orbit:
    # before take-off; again in flight if the step repeats, or begins with other agents
    def __init__(self, scene, rows):
        self._names = scene.names
        self._begun = None

    def plan(self, estimate, health, rows):  # every tick, or at the step's `rate`
        if self._begun is None:
            self._begun = estimate.time
        flown = SPEED * (estimate.time - self._begun) / RADIUS  # rad
        if flown > tau:
            return Done()
        goals = {}
        for i, row in enumerate(rows):
            angle = flown + tau * i / len(rows)
            position = (RADIUS * cos(angle), RADIUS * sin(angle), HEIGHT)
            goals[self._names[row]] = Goal(position)
        return goals
