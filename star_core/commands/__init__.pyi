# The public names of `star_core.commands` and their modules, listed once.

from star_core.commands.command_line import run_command as run_command
from star_core.commands.output import add_set_option as add_set_option
from star_core.commands.output import new_folder as new_folder
from star_core.commands.output import output_folder as output_folder
from star_core.commands.output import positive_integer as positive_integer
from star_core.commands.output import replace_file as replace_file
from star_core.commands.output import write_report as write_report
from star_core.commands.output import writing as writing
from star_core.metrics.records import split_timing as split_timing
from star_core.mission_file.fault_file import Fault as Fault
from star_core.mission_file.fault_file import faults_of as faults_of
from star_core.mission_file.fault_file import read_faults as read_faults
from star_core.mission_file.located import Value as Value
from star_core.mission_file.schema import read_as as read_as
from star_core.mission_file.yaml_reader import read_yaml as read_yaml
from star_core.plugin_support.specs import CommandSpec as CommandSpec
from star_core.plugin_support.specs import RunOptionSpec as RunOptionSpec

__all__: list[str]  # noqa: PYI035 -- of all names above
