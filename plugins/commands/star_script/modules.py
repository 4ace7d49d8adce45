"""The modules that a script imports, for as long as it runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from star_script import uav_trajectory
from star_script.script_flight import ScriptFlight
from star_script.swarm import Crazyflie, CrazyflieServer, Crazyswarm, OldCrazyflie, TimeHelper


def _mission_time(flight: ScriptFlight, folder: Path) -> ModuleType:
    """Return a module ``time`` that is mission time to files in a folder, and real to others."""

    def is_own() -> bool:
        return Path(sys._getframe(2).f_code.co_filename).parent == folder  # noqa: SLF001

    begin = int(time.time())  # whole seconds, so that differences are the same in each flight

    def sleep(seconds: float) -> None:
        if is_own():
            flight.sleep(flight.time + seconds)
        else:
            time.sleep(seconds)

    def now() -> float:
        if not is_own():
            return time.time()
        flight.poll()
        return begin + flight.time

    def monotonic() -> float:
        if not is_own():
            return time.monotonic()
        flight.poll()
        return flight.time

    module = ModuleType("time", time.__doc__)
    vars(module).update(vars(time), sleep=sleep, time=now, monotonic=monotonic)
    return module


@contextmanager
def provided(flight: ScriptFlight, button_delay: float, folder: Path) -> Iterator[None]:
    """Provide ``crazyflie_py`` and ``pycrazyswarm``, in place of those that may be installed.

    In lock-step the script, and the modules beside it in a folder, get a ``time`` too.
    """
    modules = {} if flight.realtime else {"time": _mission_time(flight, folder)}
    for package, drone in (("crazyflie_py", Crazyflie), ("pycrazyswarm", OldCrazyflie)):
        names = {"flight": flight, "drone_class": drone, "button_delay": button_delay}
        swarm = type("Crazyswarm", (Crazyswarm,), names)
        top = modules[package] = ModuleType(package)
        top.__path__ = []
        top.__all__ = ["Crazyswarm"]  # type: ignore[attr-defined]
        content = {
            "crazyswarm_py": {"Crazyswarm": swarm},
            "crazyswarm": {"Crazyswarm": swarm},
            "crazyflie": {
                "Crazyflie": drone, "CrazyflieServer": CrazyflieServer, "TimeHelper": TimeHelper,
            },
            "uav_trajectory": {
                name: getattr(uav_trajectory, name)
                for name in ("Polynomial", "Polynomial4D", "Trajectory", "TrajectoryOutput")
            },
        }  # fmt: skip
        top.Crazyswarm = swarm  # type: ignore[attr-defined]
        for name, values in content.items():
            module = modules[f"{package}.{name}"] = ModuleType(f"{package}.{name}")
            vars(module).update(values)
            setattr(top, name, module)
    hidden = {name: sys.modules.get(name) for name in modules}
    # Crazyswarm's scripts may import it by its bare name: it is beside them
    hidden["uav_trajectory"] = sys.modules.get("uav_trajectory")
    sys.modules.update(modules)
    sys.modules["uav_trajectory"] = modules["pycrazyswarm.uav_trajectory"]
    try:
        yield
    finally:
        for name, before in hidden.items():
            sys.modules.pop(name, None)
            if before is not None:
                sys.modules[name] = before
