# The public names of `star_core.commands` and their modules, listed once.

from star_core.commands.command_line import run_command as run_command
from star_core.commands.completion import completes as completes
from star_core.commands.completion import mission_names as mission_names
from star_core.commands.output import add_set_option as add_set_option
from star_core.commands.output import new_folder as new_folder
from star_core.commands.output import output_folder as output_folder
from star_core.commands.output import positive_integer as positive_integer
from star_core.commands.output import replace_file as replace_file
from star_core.commands.output import reserving as reserving
from star_core.commands.output import write_report as write_report
from star_core.commands.output import writing as writing
from star_core.commands.signals import land_on_signals as land_on_signals
from star_core.discovery import Source as Source
from star_core.discovery import blocked_hint as blocked_hint
from star_core.plugin_support.option_schema import PIPELINE_KINDS as PIPELINE_KINDS
from star_core.plugin_support.option_schema import SHARED as SHARED
from star_core.plugin_support.registry import Found as Found
from star_core.plugin_support.registry import guarded as guarded
from star_core.plugin_support.specs import CommandSpec as CommandSpec
from star_core.plugin_support.specs import RunOptionSpec as RunOptionSpec
from star_core.records.manifest import software as software
from star_core.records.summary import event_record as event_record

__all__: list[str]  # noqa: PYI035 -- of all names above
