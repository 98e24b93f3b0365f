"""Operating points, exact linear models, modes, sweeps, and the aircraft's identification."""

import sys
from typing import TYPE_CHECKING

try:
    from hfa_model.support.door import open_door
except ModuleNotFoundError:  # hfa_model is some other file or folder
    path = getattr(sys.modules.get("hfa_model"), "__file__", None)
    raise ImportError(f"{path or 'a folder'} hides the package 'hfa_model' of hfa-toolchain: rename it") from None

if TYPE_CHECKING:
    from trim.identification.evidence import run_identification as run_identification
    from trim.identification.identification_result import Fit as Fit, Identification as Identification
    from trim.identification.identify import fit as fit, identify as identify
    from trim.linear.bands import Bands as Bands
    from trim.linear.compare import compare as compare, printed_at as printed_at, regenerate as regenerate
    from trim.linear.entry_bands import entry_bands as entry_bands
    from trim.linear.linear_model import (
        LinearModel as LinearModel,
        level_model as level_model,
        linear_model_report as linear_model_report,
        linearize as linearize,
    )
    from trim.linear.modes import Mode as Mode, modes_of as modes_of, track_modes as track_modes
    from trim.point.condition import (
        CONTROL_LIMITS as CONTROL_LIMITS,
        STATE_LIMITS as STATE_LIMITS,
        TrimCondition as TrimCondition,
        level_flight as level_flight,
        release as release,
    )
    from trim.point.named_condition import NamedCondition as NamedCondition, load_condition as load_condition
    from trim.point.operating_point import (
        OperatingPoint as OperatingPoint,
        Status as Status,
        load_operating_point as load_operating_point,
        save_operating_point as save_operating_point,
    )
    from trim.point.performance import Performance as Performance, performance as performance
    from trim.point.solve import TrimError as TrimError, find_operating_point as find_operating_point
    from trim.point.trim_figure import trim_figure as trim_figure
    from trim.point.trim_report import trim_report as trim_report
    from trim.sweeps.level_flights import (
        level_conditions as level_conditions,
        solve_level_flights as solve_level_flights,
    )
    from trim.sweeps.stored_sweep import stream_sweep as stream_sweep
    from trim.sweeps.sweep import sweep as sweep
    from trim.sweeps.sweep_plan import Steps as Steps, SweepPlan as SweepPlan
    from trim.sweeps.sweep_result import Sweep as Sweep

__getattr__, __dir__, __all__ = open_door(__name__)
