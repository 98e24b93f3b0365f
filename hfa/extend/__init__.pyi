"""Names for a package that adds an aircraft format or a command."""

from controller.critic.reading import (
    CriticReader as CriticReader,
    Reading as Reading,
    Stated as Stated,
)
from hfa.entry_points import CommandEntry as CommandEntry
from hfa.options.aircraft import Aircraft as Aircraft
from hfa.options.argument_types import (
    input_file as input_file,
    one_of as one_of,
    positive as positive,
    whole as whole,
)
from hfa.options.output import Output as Output, ProgressLine as ProgressLine
from hfa.options.part import option as option, part as part
from hfa.options.request import Request as Request, command as command
from hfa.options.trim import Trim as Trim
from hfa_aircraft.about import (
    About as About,
    Domain as Domain,
    Source as Source,
    Trimming as Trimming,
)
from hfa_aircraft.loading import AircraftReader as AircraftReader
from hfa_support.reporting.checks import Check as Check
from hfa_support.reporting.report import Report as Report
from hfa_support.reporting.text import Table as Table
