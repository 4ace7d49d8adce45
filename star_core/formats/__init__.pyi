# The public names of `star_core.formats` and their modules, listed once.

from star_core.conditions import Condition as Condition
from star_core.conditions import ConditionContext as ConditionContext
from star_core.errors import MAX_LISTED as MAX_LISTED
from star_core.errors import SourceFile as SourceFile
from star_core.errors import code_of as code_of
from star_core.errors import coded as coded
from star_core.errors import printable as printable
from star_core.formats.loading import STDIN as STDIN
from star_core.formats.loading import check_file as check_file
from star_core.formats.loading import format_function as format_function
from star_core.formats.loading import read_as as read_as
from star_core.formats.loading import recognized_as as recognized_as
from star_core.formats.located import Data as Data
from star_core.formats.located import Mark as Mark
from star_core.formats.located import Value as Value
from star_core.formats.located import shown as shown
from star_core.mission import PluginChoice as PluginChoice
from star_core.mission import nodes as nodes
from star_core.plugin_support.option_schema import JOIN as JOIN
from star_core.plugin_support.option_schema import LEAVE as LEAVE
from star_core.plugin_support.option_schema import references as references
from star_core.plugin_support.specs import FileKindSpec as FileKindSpec
from star_core.plugin_support.specs import FormatSpec as FormatSpec
from star_core.plugin_support.specs import MissionSpec as MissionSpec
from star_core.world.outlines import box as box
from star_core.world.outlines import wall as wall
from star_core.world.quaternions import Point as Point
from star_core.world.quaternions import moved as moved
from star_core.world.quaternions import turned as turned
from star_core.world.scene import inside as inside
from star_core.world.world import Corner as Corner

__all__: list[str]  # noqa: PYI035 -- of all names above
