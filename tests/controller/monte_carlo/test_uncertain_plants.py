"""The linear plant of a Monte Carlo."""

from __future__ import annotations

import numpy as np
from member_plans import PARAMETERS

from controller.flight.plants import LinearizedAircraft
from controller.monte_carlo.uncertain_plants import UncertainLinearization
from hfa_model import Aircraft
from hfa_model.variants import variant_named
from trim import OperatingPoint


def test_the_linear_plant_is_the_derivative_at_the_trim_of_the_design(point: OperatingPoint) -> None:
    wrong = PARAMETERS._replace(panel_mass=1.1 * PARAMETERS.panel_mass)
    plant = UncertainLinearization(variant_named("published"), point)
    for parameters in (PARAMETERS, wrong):
        matrix = plant.constants(np.array(parameters)).reshape(7, 14, order="F")
        model = LinearizedAircraft.at(Aircraft(parameters), point)
        whole = np.hstack([model.A, model.B, model.gust[:, None]])
        np.testing.assert_allclose(matrix[:, 1:], whole, rtol=1e-12, atol=1e-13)
        offset = Aircraft(parameters).rates(np.array(point.states), np.array(point.inputs))
        np.testing.assert_allclose(matrix[:, 0], offset, rtol=1e-9, atol=1e-12)
