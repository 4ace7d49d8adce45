"""STAR's own monitors."""

from __future__ import annotations

from collections.abc import Iterator

from star_core import deferred, hookimpl
from star_core.toolkit import MonitorSpec


@hookimpl
def star_monitors() -> Iterator[MonitorSpec]:
    yield MonitorSpec(
        name="flow",
        summary="Brakes agents that fly faster than they report, by their tilt or the air's drag.",
        make=deferred("star_monitors.flow_monitor:FlowMonitor"),
    )
    yield MonitorSpec(
        name="setpoints",
        summary="Leads agents away from the fence; finds planners and avoiders that are stuck.",
        make=deferred("star_monitors.setpoint_monitor:SetpointMonitor"),
    )
    yield MonitorSpec(
        name="uncertainty",
        summary="Stops agents whose uncertain positions leave no room to obstacles or others.",
        make=deferred("star_monitors.uncertain_agents:UncertainAgents"),
    )
