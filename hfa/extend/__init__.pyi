"""Names for a package that adds an aircraft format or a command."""

from controller.critic.reading import CriticFile as CriticFile, Reading as Reading
from hfa.entry_points import CommandEntry as CommandEntry
from hfa.options.advice import trimmed as trimmed
from hfa.options.argument_types import (
    input_file as input_file,
    one_of as one_of,
    positive as positive,
    whole as whole,
)
from hfa.options.command import (
    Outcome as Outcome,
    ProgressLine as ProgressLine,
    Request as Request,
    command as command,
)
from hfa.options.parser import option as option
from hfa.options.plants import AircraftOptions as AircraftOptions, loaded_model as loaded_model
from hfa.options.trims import TrimOptions as TrimOptions, given_trim as given_trim
from hfa_aircraft.about import (
    About as About,
    Domain as Domain,
    Source as Source,
    Trimming as Trimming,
)
from hfa_aircraft.loading import AircraftReader as AircraftReader
from hfa_support.arrays.columns import Column as Column, matched as matched
from hfa_support.arrays.tables import read_source as read_source
from hfa_support.reporting.report import Check as Check, Report as Report
from hfa_support.reporting.text import Table as Table
