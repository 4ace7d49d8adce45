"""The installed plugins, whose outputs a trouble makes wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

import star_core as star
from star_core import Order, Registry, Status, Supervisor, TaskOutput
from star_core.plugin_support.registry import Found
from tests.end_to_end.any_trouble import Trouble

FLAT: Final = 3.0  # V
NAN: Final = float("nan")


class Endless(KeyboardInterrupt):
    """The flight goes on for longer than its time-outs allow; no plugin's error, so no excuse."""


class Troubled:
    """Gives the parts of one flight their troubles.

    Args:
        troubles: What goes wrong.
        allowed: Until when the flight may last, s; asked in every tick.
    """

    def __init__(self, troubles: Sequence[Trouble], allowed: Callable[[], float]) -> None:
        self._troubles = troubles
        self._allowed = allowed
        self._now = 0.0
        self._heard: star.Telemetry | None = None
        self._since = np.zeros(0)  # s, when each agent was last heard
        self._falls: set[Trouble] = set()  # those that have begun

    def registry(self) -> Registry:
        """The installed plugins."""
        registry = Registry()
        for kind, named in registry._plugins.items():
            for parts in named.values():
                parts[:] = [Found(self._spoilt(kind, part.offer), part.source) for part in parts]
        return registry

    def _spoilt(self, kind: str, offer: star.TaskSpec) -> star.TaskSpec:
        methods = {
            "transport": ("wait", "receive", "command", "send"),
            "localizer": ("locate",),
            "planner": ("plan",),
            "avoider": ("avoid",),
            "task": ("begin", "step"),
        }.get(kind, ())

        def make(*args: Any, **options: Any) -> Any:
            part = offer.make(*args, **options)
            for name in methods:
                setattr(part, name, self._wrong(kind, name, part, getattr(part, name)))
            return part

        return replace(offer, make=make) if methods else offer

    def _wrong(
        self, kind: str, name: str, part: Any, right: Callable[..., Any]
    ) -> Callable[..., Any]:
        own = getattr(self, f"_{name}", None)

        def answer(*args: Any) -> Any:
            if self._is(f"{kind} raises"):
                raise RuntimeError("a trouble of the test")
            if self._is(f"{kind} answers nonsense"):
                return "nonsense"
            said = own(part, right, *args) if own is not None else right(*args)
            return self._nan(said) if self._is(f"{kind} answers NaN") else said

        return answer

    def _is(self, kind: str) -> bool:
        return any(trouble.kind == kind and trouble.now(self._now) for trouble in self._troubles)

    def _rows(self, *kinds: str) -> list[int]:
        """Rows of those whom one of some kinds befalls now."""
        return sorted({o.row for o in self._troubles if o.kind in kinds and o.now(self._now)})

    def _nan(self, said: Any) -> Any:
        match said:
            case star.Estimate():
                return replace(said, position=said.position * NAN)
            case star.Plan():
                return replace(said, setpoint=self._nan(said.setpoint))
            case star.Setpoint():
                return replace(said, velocity=said.velocity * NAN)
            case TaskOutput(goals=star.Goals() as goals):
                return replace(said, goals=replace(goals, position=goals.position * NAN))
        return said

    # What each method does instead

    def _wait(self, part: Any, right: Callable[[float], float], until: float) -> float:
        if until > self._allowed():
            raise Endless(f"still flying at {until:.1f} s, {self._allowed():.1f} s were allowed")
        for trouble in self._troubles:
            if trouble.kind == "falls" and trouble.now(until) and trouble not in self._falls:
                self._falls.add(trouble)
                zero = np.zeros(1)
                stop = star.Command(
                    Order.STOP, np.array([trouble.row]), np.zeros((1, 3)), zero, zero
                )
                type(part).command(part, stop)
        self._now = right(until)
        return self._now

    def _receive(self, _part: Any, right: Callable[[], star.Telemetry]) -> star.Telemetry:
        now = right()
        if self._heard is None:
            self._heard, self._since = now, np.full(len(now.age), now.time)
        silent = np.zeros(len(now.age), np.bool_)
        silent[self._rows("silent")] = True
        self._since = np.where(silent, self._since, now.time)
        last: dict[str, Any] = {
            name: np.where(
                silent.reshape(-1, *[1] * (getattr(now, name).ndim - 1)),
                getattr(self._heard, name),
                getattr(now, name),
            )
            for name in ("position", "velocity", "attitude", "battery", "state")
        }
        self._heard = replace(now, **last)
        last["battery"][self._rows("flat")] = FLAT
        last["battery"][self._rows("voltless")] = NAN
        last["position"][self._rows("nowhere")] = NAN
        last["state"][self._rows("tumbled")] |= int(Supervisor.TUMBLED)
        odometry = now.odometry.of(~silent[now.odometry.agent])
        return replace(now, **last, age=now.time - self._since, odometry=odometry)

    def _command(self, _part: Any, right: Callable[..., None], command: star.Command) -> None:
        meant = ~np.isin(command.agent, self._rows("deaf", "disobedient"))
        if meant.any():
            names = ("agent", "position", "yaw", "duration")
            right(replace(command, **{name: getattr(command, name)[meant] for name in names}))

    def _send(
        self, _part: Any, right: Callable[..., star.Setpoint], setpoint: star.Setpoint
    ) -> star.Setpoint:
        active = setpoint.active.copy()
        active[self._rows("deaf")] = False
        right(replace(setpoint, active=active))
        return setpoint

    def _locate(
        self, _part: Any, right: Callable[..., star.Estimate], telemetry: star.Telemetry
    ) -> star.Estimate:
        estimate = right(telemetry)
        valid = estimate.valid.copy()
        valid[self._rows("unlocated")] = False
        return replace(estimate, valid=valid)

    def _plan(self, _part: Any, right: Callable[..., star.Plan], *args: Any) -> star.Plan:
        plan = right(*args)
        unreachable, active = plan.unreachable.copy(), plan.setpoint.active.copy()
        unreachable[self._rows("unreachable")] = True
        active[self._rows("unplanned")] = False
        return replace(
            plan, unreachable=unreachable, setpoint=replace(plan.setpoint, active=active)
        )

    def _avoid(self, _part: Any, right: Callable[..., star.Setpoint], *args: Any) -> star.Setpoint:
        safe = right(*args)
        active = safe.active.copy()
        active[self._rows("unavoided")] = False
        return replace(safe, active=active)

    def _begin(self, _part: Any, right: Callable[..., float], *args: Any) -> float:
        limit = right(*args)
        return float("inf") if self._is("task asks for all time") else limit

    def _step(self, _part: Any, right: Callable[..., TaskOutput], *args: Any) -> TaskOutput:
        step = right(*args)
        if self._is("task fails"):
            return replace(step, status=Status.FAILURE, reason="a trouble of the test")
        if self._is("task goes on"):
            return replace(step, status=Status.RUNNING)
        return step
