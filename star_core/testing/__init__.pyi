# The public names of `star_core.testing` and their modules, listed once.

from star_core.testing.calls import Times as Times
from star_core.testing.calls import reports as reports
from star_core.testing.inputs import estimate as estimate
from star_core.testing.inputs import health as health
from star_core.testing.inputs import scene as scene
from star_core.testing.mission_steps import MissionSteps as MissionSteps
from star_core.testing.point_masses import PointMasses as PointMasses
from star_core.testing.point_masses import straight_velocity as straight_velocity
from star_core.testing.steering import check_avoider as check_avoider
from star_core.testing.steering import check_localizer as check_localizer
from star_core.testing.steering import check_planner as check_planner
from star_core.testing.task import check_task as check_task
from star_core.testing.transport import check_transport as check_transport

__all__: list[str]  # noqa: PYI035 -- of all names above
