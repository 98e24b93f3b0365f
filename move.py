# ruff: noqa
"""Moves the source files into their folders, group after group: python move.py 1 ... 7.

A move renames files and rewrites imports and names of modules in strings. It rewrites no code.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

GROUPS = {
    1: {
        "hfa/commands/daveml.py": ["extensions/daveml/hfa_daveml/commands/daveml.py"],
        "hfa_aircraft/control_systems.py": ["extensions/flight/hfa_flight/control_systems.py"],
        "hfa_aircraft/layout.py": ["hfa_aircraft/layout.py", "hfa_aircraft/broken_equations.py"],
        "hfa_aircraft/limits.py": ["trim/limits.py"],
        "hfa_aircraft/march/cost.py": ["extensions/flight/hfa_flight/flight_cost.py"],
        "hfa_aircraft/matrices.py": [
            "hfa_aircraft/matrices.py",
            "extensions/derivatives/hfa_derivatives/matrices.py",
        ],
        "hfa_aircraft/model.py": ["hfa_aircraft/model.py", "hfa_aircraft/usual_modes.py"],
        "hfa_aircraft/names.py": ["hfa_aircraft/names.py", "controller/game/names.py"],
        "hfa_aircraft/readers/daveml/check_cases.py": [
            "extensions/daveml/hfa_daveml/check_cases.py"
        ],
        "hfa_aircraft/readers/daveml/document.py": ["extensions/daveml/hfa_daveml/document.py"],
        "hfa_aircraft/readers/daveml/functions.py": ["extensions/daveml/hfa_daveml/functions.py"],
        "hfa_aircraft/readers/daveml/mathml.py": ["extensions/daveml/hfa_daveml/mathml.py"],
        "hfa_aircraft/readers/daveml/names.py": ["extensions/daveml/hfa_daveml/names.py"],
        "hfa_aircraft/readers/daveml/read.py": ["extensions/daveml/hfa_daveml/aircraft.py"],
        "hfa_aircraft/readers/daveml/tables.py": ["extensions/daveml/hfa_daveml/tables.py"],
        "hfa_aircraft/readers/derivatives/changed.py": [
            "extensions/derivatives/hfa_derivatives/changed.py"
        ],
        "hfa_aircraft/readers/derivatives/names.py": [
            "extensions/derivatives/hfa_derivatives/names.py"
        ],
        "hfa_aircraft/readers/derivatives/read.py": [
            "extensions/derivatives/hfa_derivatives/aircraft.py"
        ],
        "hfa_aircraft/readers/derivatives/table.py": [
            "extensions/derivatives/hfa_derivatives/table.py"
        ],
        "hfa_aircraft/readers/matrices_file.py": [
            "controller/game/file_entries.py",
            "extensions/policy/hfa_policy/linear_plant.py",
        ],
        "hfa_aircraft/rigid/aircraft.py": ["extensions/rigid/hfa_rigid/aircraft.py"],
        "hfa_aircraft/rigid/atmosphere.py": ["extensions/rigid/hfa_rigid/atmosphere.py"],
        "hfa_aircraft/rigid/motion.py": ["extensions/rigid/hfa_rigid/motion.py"],
        "hfa_aircraft/rigid/tables.py": ["extensions/rigid/hfa_rigid/tables.py"],
        "hfa_aircraft/signals.py": ["hfa_aircraft/signals.py", "hfa_aircraft/states_and_inputs.py"],
        "hfa_aircraft/source.py": ["hfa_aircraft/extras.py"],
        "hfa_aircraft/uncertain.py": [
            "extensions/identify/hfa_identify/draws/parameters.py",
            "extensions/identify/hfa_identify/parameter_spread.py",
            "extensions/identify/hfa_identify/draws/samples.py",
        ],
        "hfa_aircraft/units.py": ["hfa_aircraft/units.py", "hfa_aircraft/native_units.py"],
        "hfa_model/parameters.py": [
            "hfa_model/parameters.py",
            "hfa_model/parameter_files.py",
            "hfa_model/parameter_samples.py",
        ],
        "hfa_model/published.py": ["hfa_model/printed_matrices.py", "hfa_model/published_data.py"],
        "hfa_model/unsteady.py": ["extensions/air/hfa_air/unsteady.py"],
        "hfa_support/arrays/_loadmat.py": ["controller/game/_loadmat.py"],
        "hfa_support/arrays/csv_file.py": ["controller/game/csv_file.py"],
        "hfa_support/arrays/mat_file.py": ["controller/game/mat_file.py"],
        "hfa_support/arrays/one_matrix.py": ["controller/game/one_matrix_files.py"],
        "hfa_support/arrays/read.py": ["controller/game/array_file.py"],
        "hfa_support/errors.py": ["hfa_support/errors.py", "hfa_support/user_warning.py"],
        "hfa_support/native/c_code.py": ["extensions/flight/hfa_flight/export/c_code.py"],
        "hfa_support/native/row_code.py": ["extensions/policy/hfa_policy/row_code.py"],
        "hfa_support/reporting/data_files.py": [
            "hfa_support/reporting/data_files.py",
            "hfa_support/jsonable.py",
        ],
        "hfa_support/reporting/json_schema.py": ["extensions/formats/hfa_formats/schemas.py"],
        "hfa_support/reporting/named.py": [
            "hfa_support/reporting/named_array.py",
            "hfa_support/reporting/by_name.py",
        ],
        "hfa_support/reporting/report.py": ["hfa_support/reporting/report.py"],
        "hfa_support/reporting/results.py": [
            "hfa_support/reporting/results.py",
            "hfa_support/reporting/by_value.py",
        ],
        "hfa_support/reporting/text.py": [
            "hfa_support/reporting/text.py",
            "hfa_support/reporting/rows_made.py",
        ],
        "hfa_support/rows/store.py": ["extensions/stores/hfa_stores/zarr_store.py"],
        "hfa_support/rows/workers.py": ["extensions/stores/hfa_stores/workers.py"],
    },
    2: {
        "trim/hfa/front_view.py": ["extensions/page/hfa_page/front_view.py"],
        "trim/linear/along.py": ["extensions/flight/hfa_flight/along.py"],
        "trim/linear/linear_model.py": [
            "trim/linear/linear_model.py",
            "trim/linear/linear_report.py",
            "trim/linear/exchange.py",
        ],
        "trim/linear/modes.py": ["trim/linear/modes.py", "trim/linear/mode.py"],
        "trim/linear/reduction.py": ["trim/linear/reduction.py", "trim/linear/positions.py"],
        "trim/linear/responses.py": [
            "trim/linear/responses.py",
            "extensions/servo/hfa_servo/notebook/responses.py",
        ],
        "trim/point/diagnosis.py": ["trim/point/diagnosis.py", "trim/point/reasons.py"],
        "trim/point/halving.py": ["trim/point/halving.py", "trim/point/newton.py"],
        "trim/point/operating_point.py": [
            "trim/point/operating_point.py",
            "trim/point/saved_point.py",
        ],
        "trim/point/solve.py": ["trim/point/solve.py", "trim/point/level_model.py"],
        "trim/point/trim_report.py": [
            "trim/point/trim_report.py",
            "trim/point/point_figure.py",
            "trim/point/point_records.py",
        ],
        "trim/sweeps/interpolated.py": ["extensions/flight/hfa_flight/export/interpolated.py"],
        "trim/sweeps/store.py": ["extensions/stores/hfa_stores/sweep_store.py"],
        "trim/sweeps/sweep.py": ["trim/sweeps/sweep.py", "trim/sweeps/sweep_points.py"],
        "trim/tables.py": [
            "trim/tables.py",
            "extensions/servo/hfa_servo/notebook/frames.py",
            "extensions/stores/hfa_stores/datasets.py",
            "extensions/stores/hfa_stores/sweep_arrays.py",
        ],
    },
    3: {
        "controller/critic/critic.py": [
            "controller/critic/critic.py",
            "controller/critic/weights.py",
            "controller/critic/expressions.py",
        ],
        "controller/critic/network/activations.py": [
            "extensions/networks/hfa_networks/files/activations.py"
        ],
        "controller/critic/network/critic.py": [
            "extensions/networks/hfa_networks/files/network.py"
        ],
        "controller/critic/network/network_file.py": [
            "extensions/networks/hfa_networks/files/network_file.py"
        ],
        "controller/critic/network/onnx_graph.py": [
            "extensions/networks/hfa_networks/files/onnx_graph.py"
        ],
        "controller/critic/network/products.py": [
            "extensions/networks/hfa_networks/files/products.py"
        ],
        "controller/critic/network/q_function.py": [
            "extensions/networks/hfa_networks/files/q_function.py"
        ],
        "controller/critic/network/row_network.py": [
            "extensions/networks/hfa_networks/files/row_network.py"
        ],
        "controller/critic/network/state_dict.py": [
            "extensions/networks/hfa_networks/files/state_dict.py"
        ],
        "controller/critic/network/tensors.py": [
            "extensions/networks/hfa_networks/files/tensors.py"
        ],
        "controller/critic/network/torch_module.py": [
            "extensions/networks/hfa_networks/files/torch_module.py"
        ],
        "controller/critic/training_run.py": [
            "controller/game/training_run.py",
            "controller/game/settling.py",
        ],
        "controller/discrete/critic_file.py": ["extensions/discrete/hfa_discrete/critic_file.py"],
        "controller/discrete/feedthrough.py": ["extensions/discrete/hfa_discrete/feedthrough.py"],
        "controller/discrete/implied_policy.py": [
            "extensions/discrete/hfa_discrete/implied_policy.py"
        ],
        "controller/discrete/report.py": ["extensions/discrete/hfa_discrete/report.py"],
        "controller/discrete/solution.py": ["extensions/discrete/hfa_discrete/solution.py"],
        "controller/discrete/step_form.py": ["extensions/discrete/hfa_discrete/step_form.py"],
        "controller/discrete/step_model.py": ["extensions/discrete/hfa_discrete/step_model.py"],
        "controller/game/discrete_game.py": ["extensions/discrete/hfa_discrete/discrete_game.py"],
        "controller/game/game_file.py": ["controller/game/user_files.py"],
        "controller/game/zero_sum.py": [
            "controller/game/zero_sum.py",
            "controller/game/game_report.py",
        ],
        "controller/learning/q_learning.py": ["extensions/discrete/hfa_discrete/q_learning.py"],
        "controller/plant/generalized_plant.py": [
            "extensions/servo/hfa_servo/generalized_plant.py"
        ],
        "controller/plant/plant_axes.py": ["extensions/servo/hfa_servo/plant_axes.py"],
        "controller/plant/plant_report.py": ["extensions/servo/hfa_servo/plant_report.py"],
        "controller/plant/plant_side.py": ["extensions/servo/hfa_servo/plant_side.py"],
        "controller/plant/value_error.py": ["extensions/servo/hfa_servo/value_error.py"],
        "controller/riccati/normal_form.py": [
            "controller/riccati/normal_form.py",
            "controller/riccati/schur.py",
        ],
        "controller/schedule/gain_schedule.py": ["extensions/flight/hfa_flight/gain_schedule.py"],
        "controller/schedule/scheduled_controller.py": [
            "extensions/servo/hfa_servo/scheduled_controller.py"
        ],
    },
    4: {
        "hfa/commands/printed.py": ["extensions/printed/hfa_printed/commands/printed.py"],
        "verification/critic/critic_check.py": [
            "verification/critic/critic_check.py",
            "verification/critic/given.py",
        ],
        "verification/critic/discrete.py": ["extensions/discrete/hfa_discrete/critic_check.py"],
        "verification/critic_errors.py": ["verification/critic/critic_errors.py"],
        "verification/drawn.py": ["extensions/identify/hfa_identify/draws/spread.py"],
        "verification/enclosure/affine_rows.py": [
            "extensions/networks/hfa_networks/judge/affine_rows.py"
        ],
        "verification/enclosure/ball_function.py": [
            "extensions/proof/hfa_proof/arithmetic/ball_function.py"
        ],
        "verification/enclosure/balls.py": ["extensions/proof/hfa_proof/arithmetic/balls.py"],
        "verification/enclosure/elementary.py": [
            "extensions/boxes/hfa_boxes/enclosure/elementary.py"
        ],
        "verification/enclosure/lines.py": ["extensions/boxes/hfa_boxes/enclosure/functions.py"],
        "verification/enclosure/polynomial.py": [
            "extensions/region/hfa_region/check/polynomial.py"
        ],
        "verification/enclosure/precision.py": [
            "extensions/proof/hfa_proof/arithmetic/__init__.py"
        ],
        "verification/enclosure/program.py": [
            "extensions/boxes/hfa_boxes/enclosure/program.py",
            "extensions/proof/hfa_proof/arithmetic/operations.py",
        ],
        "verification/enclosure/relaxation.py": [
            "extensions/networks/hfa_networks/judge/relaxation.py"
        ],
        "verification/enclosure/series.py": [
            "extensions/proof/hfa_proof/arithmetic/taylor_model.py",
            "extensions/region/hfa_region/check/taylor.py",
        ],
        "verification/enclosure/slopes.py": ["extensions/boxes/hfa_boxes/enclosure/slopes.py"],
        "verification/enclosure/taylor.py": ["extensions/boxes/hfa_boxes/enclosure/taylor.py"],
        "verification/error_table.py": ["verification/critic/error_table.py"],
        "verification/figures.py": ["verification/critic/figures.py"],
        "verification/network/bound.py": [
            "extensions/networks/hfa_networks/judge/network_bound.py"
        ],
        "verification/network/flights.py": [
            "extensions/networks/hfa_networks/judge/network_flights.py"
        ],
        "verification/network/search.py": [
            "extensions/networks/hfa_networks/judge/network_search.py",
            "extensions/networks/hfa_networks/judge/judges.py",
        ],
        "verification/printed/changed_entry.py": [
            "extensions/printed/hfa_printed/changed_entry.py"
        ],
        "verification/printed/classes.py": ["extensions/printed/hfa_printed/classes.py"],
        "verification/printed/comparison.py": ["extensions/printed/hfa_printed/comparison.py"],
        "verification/printed/exact_answer.py": ["extensions/printed/hfa_printed/exact_answer.py"],
        "verification/printed/printed_file.py": ["extensions/printed/hfa_printed/printed_file.py"],
        "verification/printed/verdict.py": ["extensions/printed/hfa_printed/printed_verdict.py"],
        "verification/reasons/diagnosis.py": ["extensions/reasons/hfa_reasons/diagnosis.py"],
        "verification/reasons/hypotheses.py": ["extensions/reasons/hfa_reasons/hypotheses.py"],
        "verification/reasons/other_games.py": ["extensions/reasons/hfa_reasons/other_games.py"],
        "verification/scope.py": [
            "verification/critic/scope.py",
            "verification/critic/about_trim.py",
        ],
        "verification/verdict.py": [
            "verification/critic/verdict.py",
            "verification/critic/several.py",
            "verification/critic/proved.py",
        ],
    },
    5: {
        "hfa/commands/discrete.py": ["extensions/discrete/hfa_discrete/commands.py"],
        "hfa/commands/game.py": ["hfa/commands/game.py"],
        "hfa/completion.py": ["extensions/formats/hfa_formats/completion.py"],
        "hfa/formats.py": [
            "extensions/formats/hfa_formats/formats.py",
            "extensions/formats/hfa_formats/__main__.py",
        ],
        "hfa/options/draws.py": [
            "hfa/options/draws.py",
            "extensions/identify/hfa_identify/draws/report.py",
        ],
        "hfa/options/output.py": ["hfa/output.py"],
        "hfa/options/parser.py": ["hfa/options/parser.py", "hfa/options/help_text.py"],
        "hfa/options/request.py": ["hfa/options/request.py", "hfa/options/command.py"],
        "hfa/options/trims.py": ["hfa/options/trims.py", "hfa/options/no_trim.py"],
        "hfa/page/claims.py": ["extensions/page/hfa_page/claims.py"],
        "hfa/page/command.py": ["extensions/page/hfa_page/commands/report.py"],
        "hfa/page/compared_with_print.py": ["extensions/page/hfa_page/compared_with_print.py"],
        "hfa/page/flights.py": ["extensions/page/hfa_page/flights.py"],
        "hfa/page/job_report.py": ["extensions/page/hfa_page/job_report.py"],
        "hfa/page/main_job.py": ["extensions/page/hfa_page/main_job.py"],
        "hfa/page/plots.py": ["extensions/page/hfa_page/plots.py"],
        "hfa/page/results.py": ["extensions/page/hfa_page/results.py"],
    },
    6: {
        "extensions/flight/hfa_flight/air/gust_equations.py": [
            "extensions/flight/hfa_flight/gust_equations.py"
        ],
        "extensions/flight/hfa_flight/air/gusts.py": ["extensions/flight/hfa_flight/gusts.py"],
        "extensions/flight/hfa_flight/air/names.py": ["extensions/flight/hfa_flight/air.py"],
        "extensions/flight/hfa_flight/air/turbulence.py": [
            "extensions/flight/hfa_flight/turbulence.py"
        ],
        "extensions/flight/hfa_flight/export/controller_c.py": [
            "extensions/servo/hfa_servo/controller_c.py"
        ],
        "extensions/flight/hfa_flight/export/deployment_c.py": [
            "extensions/policy/hfa_policy/exported.py"
        ],
        "extensions/flight/hfa_flight/flight.py": [
            "extensions/flight/hfa_flight/nonlinear_flight.py"
        ],
        "extensions/flight/hfa_flight/flight_report.py": [
            "extensions/flight/hfa_flight/flight_figure.py",
            "extensions/flight/hfa_flight/flight_tables.py",
        ],
        "extensions/flight/hfa_flight/held_step.py": ["extensions/policy/hfa_policy/held_step.py"],
        "extensions/flight/hfa_flight/history.py": [
            "extensions/flight/hfa_flight/flight_history.py"
        ],
        "extensions/flight/hfa_flight/policies/controller.py": [
            "extensions/servo/hfa_servo/servo_policy.py",
            "extensions/servo/hfa_servo/measured_outputs.py",
            "extensions/servo/hfa_servo/tracked.py",
        ],
        "extensions/flight/hfa_flight/policies/deployment/actor.py": [
            "extensions/policy/hfa_policy/actor.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/deployed.py": [
            "extensions/policy/hfa_policy/deployed.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/deployment.py": [
            "extensions/policy/hfa_policy/deployment.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/equilibrium.py": [
            "extensions/policy/hfa_policy/equilibrium.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/formulas.py": [
            "extensions/policy/hfa_policy/formulas.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/inert_pickle.py": [
            "extensions/policy/hfa_policy/inert_pickle.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/normalizer.py": [
            "extensions/policy/hfa_policy/normalizer.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/notes.py": [
            "extensions/policy/hfa_policy/file_notes.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/policy.py": [
            "extensions/policy/hfa_policy/flown.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/sampled_loop.py": [
            "extensions/policy/hfa_policy/sampled_loop.py"
        ],
        "extensions/flight/hfa_flight/policies/deployment/stable_baselines.py": [
            "extensions/policy/hfa_policy/stable_baselines.py"
        ],
        "extensions/flight/hfa_flight/policies/given.py": [
            "extensions/flight/hfa_flight/flown_policy.py"
        ],
        "extensions/flight/hfa_flight/policies/policy.py": [
            "extensions/flight/hfa_flight/policies.py"
        ],
        "extensions/flight/hfa_flight/policies/scheduled_gains.py": [
            "extensions/flight/hfa_flight/scheduled_gains.py"
        ],
        "extensions/flight/hfa_flight/policies/tables.py": [
            "extensions/flight/hfa_flight/table_expression.py"
        ],
        "extensions/flight/hfa_flight/problem.py": ["extensions/optimal/hfa_optimal/problem.py"],
        "extensions/flight/hfa_flight/samples/drawn_aircraft.py": [
            "extensions/flight/hfa_flight/drawn_aircraft.py"
        ],
        "extensions/flight/hfa_flight/samples/monte_carlo.py": [
            "extensions/flight/hfa_flight/monte_carlo.py",
            "extensions/flight/hfa_flight/per_thread.py",
        ],
        "extensions/flight/hfa_flight/samples/report.py": [
            "extensions/flight/hfa_flight/monte_carlo_report.py"
        ],
        "extensions/flight/hfa_flight/samples/store.py": [
            "extensions/flight/hfa_flight/monte_carlo_store.py"
        ],
        "extensions/identify/hfa_identify/identified.py": [
            "extensions/identify/hfa_identify/identified.py",
            "extensions/identify/hfa_identify/identified_figure.py",
        ],
        "extensions/optimal/hfa_optimal/bracket.py": ["extensions/policy/hfa_policy/best_costs.py"],
        "extensions/policy/hfa_policy/assessment_report.py": [
            "extensions/policy/hfa_policy/assessment_report.py",
            "extensions/policy/hfa_policy/assessment_figure.py",
        ],
        "extensions/policy/hfa_policy/best.py": ["extensions/optimal/hfa_optimal/assessed.py"],
        "extensions/policy/hfa_policy/environment.py": [
            "extensions/policy/hfa_policy/environment.py",
            "extensions/policy/hfa_policy/episode_figure.py",
        ],
        "extensions/policy/hfa_policy/outcomes.py": [
            "extensions/policy/hfa_policy/outcomes.py",
            "extensions/policy/hfa_policy/departures.py",
        ],
        "extensions/policy/hfa_policy/variations.py": [
            "extensions/policy/hfa_policy/variations.py",
            "extensions/policy/hfa_policy/drawn_aircraft.py",
        ],
    },
    7: {
        "extensions/design/hfa_design/commands/design.py": [
            "extensions/servo/hfa_servo/commands/design.py"
        ],
        "extensions/design/hfa_design/controllers.py": [
            "extensions/servo/hfa_servo/controllers.py"
        ],
        "extensions/design/hfa_design/design.py": ["extensions/servo/hfa_servo/design.py"],
        "extensions/design/hfa_design/design_model.py": [
            "extensions/servo/hfa_servo/design_model.py"
        ],
        "extensions/design/hfa_design/designed_game.py": [
            "extensions/servo/hfa_servo/designed_game.py"
        ],
        "extensions/design/hfa_design/flown.py": ["extensions/servo/hfa_servo/flown.py"],
        "extensions/design/hfa_design/loop_shaping.py": [
            "extensions/servo/hfa_servo/loop_shaping.py"
        ],
        "extensions/design/hfa_design/results.py": ["extensions/servo/hfa_servo/results.py"],
        "extensions/design/hfa_design/servo_loop.py": ["extensions/servo/hfa_servo/servo_loop.py"],
        "extensions/prove/hfa_prove/bound.py": ["extensions/optimal/hfa_optimal/bound.py"],
        "extensions/prove/hfa_prove/certificate.py": [
            "extensions/proof/hfa_proof/checker/sealed.py"
        ],
        "extensions/prove/hfa_prove/check/cost.py": [
            "extensions/boxes/hfa_boxes/check/cost.py",
            "extensions/boxes/hfa_boxes/check/cost_checker.py",
        ],
        "extensions/prove/hfa_prove/check/cover.py": [
            "extensions/boxes/hfa_boxes/check/cover.py",
            "extensions/proof/hfa_proof/checker/covering.py",
        ],
        "extensions/prove/hfa_prove/check/equilibrium.py": [
            "extensions/boxes/hfa_boxes/check/equilibrium.py",
            "extensions/proof/hfa_proof/checker/roots.py",
        ],
        "extensions/prove/hfa_prove/check/game.py": [
            "extensions/proof/hfa_proof/checker/riccati.py"
        ],
        "extensions/prove/hfa_prove/check/loop.py": ["extensions/proof/hfa_proof/checker/loop.py"],
        "extensions/prove/hfa_prove/check/loop_boxes.py": [
            "extensions/boxes/hfa_boxes/check/loop.py"
        ],
        "extensions/prove/hfa_prove/check/loop_squares.py": [
            "extensions/region/hfa_region/check/loop.py"
        ],
        "extensions/prove/hfa_prove/check/modes.py": [
            "extensions/proof/hfa_proof/checker/modes.py"
        ],
        "extensions/prove/hfa_prove/check/piece.py": ["extensions/boxes/hfa_boxes/check/piece.py"],
        "extensions/prove/hfa_prove/check/positivity.py": [
            "extensions/region/hfa_region/check/positivity.py"
        ],
        "extensions/prove/hfa_prove/check/region_boxes.py": [
            "extensions/boxes/hfa_boxes/check/checker.py"
        ],
        "extensions/prove/hfa_prove/check/region_squares.py": [
            "extensions/region/hfa_region/check/checker.py",
            "extensions/region/hfa_region/check/certificate.py",
            "extensions/region/hfa_region/check/extents.py",
        ],
        "extensions/prove/hfa_prove/check/schedule.py": [
            "extensions/proof/hfa_proof/checker/checker.py"
        ],
        "extensions/prove/hfa_prove/check/trims.py": [
            "extensions/proof/hfa_proof/checker/trims.py",
            "extensions/proof/hfa_proof/arithmetic/steady_flight.py",
        ],
        "extensions/prove/hfa_prove/commands/check.py": [
            "extensions/proof/hfa_proof/commands/check.py"
        ],
        "extensions/prove/hfa_prove/commands/cost.py": [
            "extensions/optimal/hfa_optimal/commands/cost.py"
        ],
        "extensions/prove/hfa_prove/commands/games.py": [
            "extensions/proof/hfa_proof/commands/games.py"
        ],
        "extensions/prove/hfa_prove/commands/given.py": [
            "extensions/proof/hfa_proof/commands/given.py"
        ],
        "extensions/prove/hfa_prove/commands/given_region.py": [
            "extensions/region/hfa_region/commands/given.py",
            "extensions/region/hfa_region/commands/policy.py",
        ],
        "extensions/prove/hfa_prove/commands/models.py": [
            "extensions/proof/hfa_proof/commands/models.py"
        ],
        "extensions/prove/hfa_prove/commands/options.py": ["extensions/proof/hfa_proof/options.py"],
        "extensions/prove/hfa_prove/commands/region.py": [
            "extensions/region/hfa_region/commands/region.py"
        ],
        "extensions/prove/hfa_prove/commands/region_boxes.py": [
            "extensions/boxes/hfa_boxes/commands/region.py",
            "extensions/region/hfa_region/commands/on_boxes.py",
        ],
        "extensions/prove/hfa_prove/commands/schedule.py": [
            "extensions/proof/hfa_proof/commands/schedule.py"
        ],
        "extensions/prove/hfa_prove/commands/section.py": [
            "extensions/region/hfa_region/commands/section.py"
        ],
        "extensions/prove/hfa_prove/fields.py": [
            "extensions/proof/hfa_proof/fields.py",
            "extensions/proof/hfa_proof/checker/reading.py",
        ],
        "extensions/prove/hfa_prove/fields_boxes.py": ["extensions/boxes/hfa_boxes/fields.py"],
        "extensions/prove/hfa_prove/fields_squares.py": ["extensions/region/hfa_region/fields.py"],
        "extensions/prove/hfa_prove/hfa.py": ["extensions/proof/hfa_proof/flexible_aircraft.py"],
        "extensions/prove/hfa_prove/picture.py": ["extensions/region/hfa_region/picture.py"],
        "extensions/prove/hfa_prove/prove_region.py": [
            "extensions/region/hfa_region/prove_region.py"
        ],
        "extensions/prove/hfa_prove/report.py": [
            "extensions/proof/hfa_proof/search/report.py",
            "extensions/proof/hfa_proof/search/checked_report.py",
        ],
        "extensions/prove/hfa_prove/report_boxes.py": ["extensions/boxes/hfa_boxes/report.py"],
        "extensions/prove/hfa_prove/report_cost.py": ["extensions/boxes/hfa_boxes/cost_report.py"],
        "extensions/prove/hfa_prove/report_squares.py": ["extensions/region/hfa_region/report.py"],
        "extensions/prove/hfa_prove/results.py": [
            "extensions/proof/hfa_proof/search/results.py",
            "extensions/region/hfa_region/results.py",
            "extensions/boxes/hfa_boxes/results.py",
            "extensions/boxes/hfa_boxes/cost_results.py",
        ],
        "extensions/prove/hfa_prove/search/cost.py": [
            "extensions/boxes/hfa_boxes/search/cost.py",
            "extensions/optimal/hfa_optimal/bound_search.py",
        ],
        "extensions/prove/hfa_prove/search/cost_fit.py": [
            "extensions/boxes/hfa_boxes/search/cost_fit.py"
        ],
        "extensions/prove/hfa_prove/search/family.py": [
            "extensions/proof/hfa_proof/search/family.py"
        ],
        "extensions/prove/hfa_prove/search/flights.py": [
            "extensions/boxes/hfa_boxes/search/cost_flights.py"
        ],
        "extensions/prove/hfa_prove/search/game.py": [
            "extensions/proof/hfa_proof/search/solution_proof.py"
        ],
        "extensions/prove/hfa_prove/search/interruption.py": [
            "extensions/boxes/hfa_boxes/interruption.py",
            "extensions/boxes/hfa_boxes/search/out_of_time.py",
        ],
        "extensions/prove/hfa_prove/search/invariant.py": [
            "extensions/region/hfa_region/search/invariant.py"
        ],
        "extensions/prove/hfa_prove/search/kinks.py": [
            "extensions/boxes/hfa_boxes/search/kinks.py"
        ],
        "extensions/prove/hfa_prove/search/level.py": [
            "extensions/region/hfa_region/search/level.py"
        ],
        "extensions/prove/hfa_prove/search/lines.py": [
            "extensions/proof/hfa_proof/search/lines.py"
        ],
        "extensions/prove/hfa_prove/search/loops.py": [
            "extensions/proof/hfa_proof/search/loops.py"
        ],
        "extensions/prove/hfa_prove/search/models.py": [
            "extensions/proof/hfa_proof/search/models_grid.py"
        ],
        "extensions/prove/hfa_prove/search/monomials.py": [
            "extensions/boxes/hfa_boxes/search/monomials.py",
            "extensions/region/hfa_region/search/function.py",
            "extensions/boxes/hfa_boxes/search/doubles.py",
        ],
        "extensions/prove/hfa_prove/search/plant.py": [
            "extensions/region/hfa_region/search/plant.py",
            "extensions/boxes/hfa_boxes/search/hurwitz.py",
        ],
        "extensions/prove/hfa_prove/search/proof.py": [
            "extensions/proof/hfa_proof/search/certificate.py"
        ],
        "extensions/prove/hfa_prove/search/region_boxes.py": [
            "extensions/boxes/hfa_boxes/search/region.py"
        ],
        "extensions/prove/hfa_prove/search/region_squares.py": [
            "extensions/region/hfa_region/search/region.py"
        ],
        "extensions/prove/hfa_prove/search/schedule.py": [
            "extensions/proof/hfa_proof/search/schedule_proof.py"
        ],
        "extensions/prove/hfa_prove/search/shape_boxes.py": [
            "extensions/boxes/hfa_boxes/search/shape.py"
        ],
        "extensions/prove/hfa_prove/search/shape_squares.py": [
            "extensions/region/hfa_region/search/shape.py"
        ],
        "extensions/prove/hfa_prove/search/squares.py": [
            "extensions/region/hfa_region/search/squares.py",
            "extensions/region/hfa_region/search/interior.py",
            "extensions/region/hfa_region/search/products.py",
        ],
        "extensions/prove/hfa_prove/search/uncertain_loop.py": [
            "extensions/proof/hfa_proof/search/uncertain_loop.py"
        ],
        "extensions/prove/hfa_prove/statements/cost.py": [
            "extensions/boxes/hfa_boxes/check/cost_statement.py"
        ],
        "extensions/prove/hfa_prove/statements/plant.py": [
            "extensions/boxes/hfa_boxes/check/plant.py",
            "extensions/proof/hfa_proof/checker/aircraft.py",
        ],
        "extensions/prove/hfa_prove/statements/region_boxes.py": [
            "extensions/boxes/hfa_boxes/check/statement.py"
        ],
        "extensions/prove/hfa_prove/statements/region_squares.py": [
            "extensions/region/hfa_region/check/statement.py",
            "extensions/region/hfa_region/check/witness.py",
        ],
        "extensions/prove/hfa_prove/statements/schedule.py": [
            "extensions/proof/hfa_proof/checker/statement.py",
            "extensions/proof/hfa_proof/checker/witness.py",
        ],
        "extensions/prove/hfa_prove/subject.py": ["extensions/proof/hfa_proof/subject.py"],
        "extensions/prove/hfa_prove/words.py": [
            "extensions/boxes/hfa_boxes/words.py",
            "extensions/proof/hfa_proof/results.py",
            "extensions/proof/hfa_proof/outward.py",
        ],
    },
}

SPLITS = {
    1: {
        "extensions/servo/hfa_servo/design.py": {
            "hfa_aircraft/units.py": ["signal_unit", "_ENDS"],
        },
        "controller/game/names.py": {
            "controller/game/linear_game.py": ["names_of_linear"],
        },
        "controller/game/zero_sum.py": {
            "hfa_support/matrices.py": ["checked_matrix", "shape_text", "LARGEST"],
        },
        "controller/game/user_files.py": {
            "hfa_aircraft/readers/matrices_file.py": [
                "entries_of",
                "is_discrete",
                "one_number",
                "has_all",
                "_OF_CONTROL",
            ],
        },
        "extensions/derivatives/hfa_derivatives/matrices.py": {
            "trim/linear/linear_model.py": ["completed"],
        },
        "hfa_support/reporting/report.py": {
            "hfa_support/reporting/parts.py": ["Picture"],
        },
        "controller/game/file_entries.py": {
            "hfa_support/arrays/read.py": ["UNKNOWN"],
        },
    },
    2: {
        "trim/point/operating_point.py": {
            "trim/point/status.py": ["Status", "BALANCE"],
        },
    },
    3: {
        "extensions/servo/hfa_servo/results.py": {
            "controller/schedule/scheduled_controller.py": [
                "ControllerTable",
                "ControllerData",
                "ControllerFile",
            ],
        },
        "controller/critic/critic_file.py": {
            "controller/critic/reading.py": [
                "Reading",
                "DIMENSIONS",
                "in_plant_units",
                "CriticReader",
            ],
        },
    },
    4: {
        "extensions/networks/hfa_networks/judge/network_flights.py": {
            "verification/axis.py": [
                "TimeAxis",
                "InTime",
                "InSteps",
                "Loop",
                "DECAY",
                "_MOST_STEPS",
                "_cost_of",
                "newton_equilibrium",
                "_radius",
                "_FlowLoop",
                "_StepLoop",
                "STEPS",
                "RETURNED",
                "Expression",
                "_NEWTON_STEPS",
                "_FARTHEST_REST",
            ],
        },
    },
    5: {},
    6: {
        "extensions/servo/hfa_servo/design.py": {
            "extensions/flight/hfa_flight/actuators.py": ["Actuator"],
        },
        "extensions/servo/hfa_servo/design_model.py": {
            "extensions/flight/hfa_flight/policies/controller.py": ["watched_outputs"],
        },
        "extensions/policy/hfa_policy/outcomes.py": {
            "extensions/flight/hfa_flight/initial_box.py": ["start_box"],
        },
        "extensions/optimal/hfa_optimal/initial_conditions.py": {
            "extensions/flight/hfa_flight/initial_box.py": [
                "usual_box",
                "drawn_starts",
                "_inside",
                "_INSIDE",
            ],
        },
        "extensions/policy/hfa_policy/flown.py": {
            "extensions/flight/hfa_flight/export/deployment_c.py": [
                "exported_loop",
                "exported_texts",
            ],
        },
    },
    7: {
        "extensions/optimal/hfa_optimal/bound.py": {
            "extensions/prove/hfa_prove/problem.py": [
                "plant_of",
                "unknowns_of",
                "given_of",
                "_CONDITION",
                "_not_narrower",
            ],
        },
        "extensions/boxes/hfa_boxes/check/loop.py": {
            "extensions/prove/hfa_prove/statements/loop.py": ["Loop"],
        },
        "extensions/region/hfa_region/check/statement.py": {
            "extensions/prove/hfa_prove/statements/loop.py": ["SaturatedLoop"],
        },
        "extensions/region/hfa_region/check/loop.py": {
            "extensions/prove/hfa_prove/statements/loop.py": ["FREE", "LOWEST", "HIGHEST"],
        },
        "extensions/proof/hfa_proof/commands/check.py": {
            "extensions/prove/hfa_prove/commands/request.py": ["CheckRequest"],
        },
        "extensions/boxes/hfa_boxes/check/piece.py": {
            "extensions/prove/hfa_prove/statements/piece.py": [
                "Polynomial",
                "Piece",
                "lowered",
                "is_exact",
                "HIGHEST",
            ],
        },
        "extensions/region/hfa_region/check/positivity.py": {
            "extensions/prove/hfa_prove/statements/evidence.py": [
                "Square",
                "Evidence",
                "_HIGHEST",
                "_degrees",
            ],
        },
        "extensions/proof/hfa_proof/search/report.py": {
            "extensions/prove/hfa_prove/results.py": [
                "breakpoint_data",
                "gaps",
                "joined",
                "schedule_data",
                "SCHEMA",
                "Content",
                "Found",
                "_not_covered",
            ],
        },
        "extensions/proof/hfa_proof/subject.py": {
            "extensions/prove/hfa_prove/fields.py": ["Field", "FieldTable"],
        },
    },
}
# --- entry points of dissolved packages, in the group that dissolves them
GROUPS[1]["hfa/entry_points.py"] = [
    "hfa/entry_points.py",
    "extensions/daveml/hfa_daveml/entry_points.py",
]

#: Tests and data: old path -> new path.
DATA = {
    1: {
        "extensions/air/tests/support/unsteady_energy.py": "tests/support/unsteady_energy.py",
        "extensions/air/tests/test_commands.py": "tests/hfa_model/test_unsteady_commands.py",
        "extensions/air/tests/test_unsteady.py": "tests/hfa_model/test_unsteady.py",
        "extensions/daveml/tests/test_daveml.py": "tests/hfa_aircraft/readers/test_daveml.py",
        "extensions/derivatives/tests/test_derivatives.py": "tests/hfa_aircraft/readers/test_derivatives.py",
        "extensions/derivatives/tests/test_matrices.py": "tests/hfa_aircraft/test_matrices.py",
        "extensions/rigid/tests/test_motion.py": "tests/hfa_aircraft/rigid/test_motion.py",
        "extensions/rigid/tests/test_tables.py": "tests/hfa_aircraft/rigid/test_tables.py",
        "extensions/formats/tests/test_schemas.py": "tests/hfa_support/reporting/test_json_schema.py",
        "extensions/stores/tests/test_workers.py": "tests/hfa_support/rows/test_workers.py",
        "extensions/stores/tests/test_zarr_store.py": "tests/hfa_support/rows/test_zarr_store.py",
        "extensions/flight/tests/test_control_systems.py": "tests/hfa_aircraft/test_control_systems.py",
        "extensions/flight/tests/test_flight_cost.py": "tests/hfa_aircraft/march/test_cost.py",
        "extensions/policy/tests/test_row_code.py": "tests/hfa_support/native/test_row_code.py",
        "extensions/identify/tests/test_parameter_samples.py": "tests/hfa_model/test_parameter_samples.py",
        "tests/controller/game/test_array_file.py": "tests/hfa_support/arrays/test_read.py",
        "tests/trim/test_limits.py": "tests/hfa_aircraft/test_limits.py",
    },
    2: {
        "extensions/stores/tests/test_datasets.py": "tests/trim/sweeps/test_datasets.py",
        "extensions/stores/tests/test_faults.py": "tests/trim/sweeps/test_store_faults.py",
        "extensions/stores/tests/test_process_ends.py": "tests/trim/sweeps/test_store_ends.py",
        "extensions/stores/tests/test_units.py": "tests/trim/sweeps/test_store_units.py",
        "extensions/flight/tests/test_along.py": "tests/trim/linear/test_along.py",
        "extensions/flight/tests/export/test_interpolated.py": "tests/trim/sweeps/test_interpolated.py",
        "extensions/page/tests/test_front_view.py": "tests/trim/hfa/test_front_view.py",
    },
    3: {
        "extensions/networks/tests/support/network_files.py": "tests/support/network_files.py",
        "extensions/networks/tests/test_activations.py": "tests/controller/critic/network/test_activations.py",
        "extensions/networks/tests/test_network_file.py": "tests/controller/critic/network/test_network_file.py",
        "extensions/networks/tests/test_networks.py": "tests/controller/critic/network/test_networks.py",
        "extensions/networks/tests/test_onnx_graph.py": "tests/controller/critic/network/test_onnx_graph.py",
        "extensions/networks/tests/test_q_function.py": "tests/controller/critic/network/test_q_function.py",
        "extensions/networks/tests/test_state_dicts.py": "tests/controller/critic/network/test_state_dict.py",
        "extensions/networks/tests/test_torch_module.py": "tests/controller/critic/network/test_torch_module.py",
        "extensions/networks/tests/gops.json": "tests/controller/critic/network/gops.json",
        "extensions/networks/tests/torch_2_13.json": "tests/controller/critic/network/torch_2_13.json",
        "extensions/networks/tests/torch_2_13.pt": "tests/controller/critic/network/torch_2_13.pt",
        "extensions/networks/tests/torch_2_13_q.onnx": "tests/controller/critic/network/torch_2_13_q.onnx",
        "extensions/discrete/tests/support/reference_steps.py": "tests/support/reference_steps.py",
        "extensions/discrete/tests/test_discrete.py": "tests/controller/discrete/test_discrete.py",
        "extensions/discrete/tests/test_discrete_copies.py": "tests/controller/discrete/test_discrete_copies.py",
        "extensions/discrete/tests/test_q_learning.py": "tests/controller/learning/test_q_learning.py",
        "extensions/servo/tests/support/plant_references.py": "tests/support/plant_references.py",
        "extensions/servo/tests/test_generalized_plant.py": "tests/controller/plant/test_generalized_plant.py",
        "extensions/servo/tests/test_plant_copies.py": "tests/controller/plant/test_plant_copies.py",
        "extensions/servo/tests/test_value_error.py": "tests/controller/plant/test_value_error.py",
        "tests/controller/game/test_user_files.py": "tests/controller/game/test_game_file.py",
    },
    4: {
        "extensions/networks/tests/test_discrete_networks.py": "tests/verification/network/test_discrete_networks.py",
        "extensions/networks/tests/test_network_bound.py": "tests/verification/network/test_bound.py",
        "extensions/networks/tests/test_network_search.py": "tests/verification/network/test_search.py",
        "extensions/networks/tests/trained/V.npz": "tests/verification/network/trained/V.npz",
        "extensions/networks/tests/trained/at_8_deg.npz": "tests/verification/network/trained/at_8_deg.npz",
        "extensions/networks/tests/trained/gamma_120.npz": "tests/verification/network/trained/gamma_120.npz",
        "extensions/networks/tests/trained/gradient.npz": "tests/verification/network/trained/gradient.npz",
        "extensions/networks/tests/trained/policy.npz": "tests/verification/network/trained/policy.npz",
        "extensions/networks/tests/trained/steps_of_0.1_s.npz": "tests/verification/network/trained/steps_of_0.1_s.npz",
        "extensions/printed/tests/support/printed_samples.py": "tests/support/printed_samples.py",
        "extensions/printed/tests/test_changed_entry.py": "tests/verification/printed/test_changed_entry.py",
        "extensions/printed/tests/test_printed_command.py": "tests/verification/printed/test_printed_command.py",
        "extensions/printed/tests/test_printed_verdict.py": "tests/verification/printed/test_verdict.py",
        "extensions/reasons/tests/support/planted_mistakes.py": "tests/support/planted_mistakes.py",
        "extensions/reasons/tests/test_diagnosis.py": "tests/verification/reasons/test_diagnosis.py",
        "extensions/reasons/tests/test_reasons.py": "tests/verification/reasons/test_reasons.py",
        "extensions/discrete/tests/test_discounted_critics.py": "tests/verification/critic/test_discounted_critics.py",
        "extensions/identify/tests/test_draws.py": "tests/verification/test_drawn.py",
        "extensions/proof/tests/arithmetic/test_ball_function.py": "tests/verification/enclosure/test_ball_function.py",
        "extensions/proof/tests/arithmetic/test_balls.py": "tests/verification/enclosure/test_balls.py",
        "extensions/boxes/tests/test_enclosure.py": "tests/verification/enclosure/test_enclosure.py",
    },
    5: {
        "extensions/formats/tests/test_completion.py": "tests/hfa/test_completion.py",
        "extensions/formats/tests/test_published_formats.py": "tests/hfa/test_published_formats.py",
        "extensions/page/tests/test_compared_with_print.py": "tests/hfa/page/test_compared_with_print.py",
        "extensions/page/tests/test_page.py": "tests/hfa/page/test_page.py",
        "extensions/page/tests/test_report_command.py": "tests/hfa/page/test_report_command.py",
        "extensions/page/hfa_page/glosses.toml": "hfa/page/glosses.toml",
        "extensions/page/hfa_page/page.css": "hfa/page/page.css",
        "extensions/page/hfa_page/page.js": "hfa/page/page.js",
    },
    6: {
        "extensions/policy/hfa_policy/deployed_policy.c.in": "extensions/flight/hfa_flight/export/deployed_policy.c.in",
        "extensions/policy/hfa_policy/deployed_policy.h.in": "extensions/flight/hfa_flight/export/deployed_policy.h.in",
        "extensions/servo/hfa_servo/controller_100hz.c.in": "extensions/flight/hfa_flight/export/controller_100hz.c.in",
        "extensions/servo/hfa_servo/hfa_controller.c.in": "extensions/flight/hfa_flight/export/hfa_controller.c.in",
        "extensions/servo/hfa_servo/hfa_controller.h.in": "extensions/flight/hfa_flight/export/hfa_controller.h.in",
    },
    7: {
        "extensions/servo/hfa_servo/paper.toml": "extensions/design/hfa_design/paper.toml",
        "extensions/servo/hfa_servo/servo.toml": "extensions/design/hfa_design/servo.toml",
        "extensions/servo/hfa_servo/py.typed": "extensions/design/hfa_design/py.typed",
        "extensions/boxes/hfa_boxes/py.typed": "extensions/prove/hfa_prove/py.typed",
        "extensions/optimal/tests/test_prove_cost.py": "extensions/prove/tests/test_prove_cost.py",
    },
}


def tests_of(folder: str) -> list[str]:
    import subprocess

    listed = subprocess.run(["git", "ls-files", folder], capture_output=True, text=True, check=True)
    return listed.stdout.split()


for _path in tests_of("extensions/servo/tests"):
    _taken = {old for group in DATA.values() for old in group}
    if _path not in _taken:
        DATA[7][_path] = _path.replace("extensions/servo/", "extensions/design/")
for _package in ("boxes", "proof", "region"):
    for _path in tests_of(f"extensions/{_package}/tests"):
        _taken = {old for group in DATA.values() for old in group}
        if _path in _taken:
            continue
        _rest = _path.removeprefix(f"extensions/{_package}/tests/")
        if not _rest.startswith(("support/", "certificates/")):
            _kind = {"boxes": "boxes", "proof": "schedules", "region": "squares"}[_package]
            _rest = f"{_kind}/{_rest}"
        DATA[7][_path] = f"extensions/prove/tests/{_rest}"

HOMES = {
    "air": (1, "tests/hfa_model"),
    "daveml": (1, "tests/hfa_aircraft/readers"),
    "derivatives": (1, "tests/hfa_aircraft/readers"),
    "rigid": (1, "tests/hfa_aircraft/rigid"),
    "stores": (2, "tests/trim/sweeps"),
    "networks": (4, "tests/verification/network"),
    "printed": (4, "tests/verification/printed"),
    "reasons": (4, "tests/verification/reasons"),
    "discrete": (5, "tests/controller/discrete"),
    "page": (5, "tests/hfa/page"),
    "formats": (5, "tests/hfa"),
}
for _package, (_group, _home) in HOMES.items():
    _taken = {old for group in DATA.values() for old in group}
    for _path in tests_of(f"extensions/{_package}/tests"):
        if _path not in _taken:
            _rest = _path.removeprefix(f"extensions/{_package}/tests/")
            DATA[_group][_path] = (
                f"tests/{_rest}" if _rest.startswith("support/") else f"{_home}/{_rest}"
            )
            print("  test without a plan:", _path, "->", DATA[_group][_path])

PUBLIC = """
from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
"""
#: New files: path -> text.
INITS = {
    1: {
        "hfa_support/arrays/__init__.py": '"""Readers of files with arrays."""\n',
        "hfa_support/rows/__init__.py": '"""Results of many rows: Zarr stores, and the processes that fill them."""\n',
        "hfa_aircraft/march/__init__.py": '"""Simulation of closed loops, and the cost of their flights."""\n',
        "hfa_aircraft/readers/__init__.py": '"""Readers of aircraft files."""\n',
        "hfa_aircraft/readers/daveml/__init__.py": '''"""Flight-dynamics models in DAVE-ML, the exchange format of ANSI/AIAA S-119.

- `document.py` reads a file.
- `mathml.py` and `functions.py` convert formulas and tables to CasADi expressions.
- `check_cases.py` computes the check cases of a file.
- `read.py` makes a `Model` of files with aerodynamics, mass properties and propulsion.
"""
''',
        "hfa_aircraft/readers/derivatives/__init__.py": '''"""Six-degree-of-freedom aircraft from a table of stability derivatives.

- `names.py` lists the entries of a table.
- `table.py` reads the entries and their units.
- `read.py` creates the `Model`.
- `changed.py` reads a file that changes parameters of another aircraft.
"""
''',
        "hfa_aircraft/rigid/__init__.py": '''"""Rigid aircraft in standard air over a flat Earth, used by readers of aircraft files.

- `motion.py` contains the equations of motion.
- `atmosphere.py` contains the standard atmosphere.
- `tables.py` interpolates in tables.
- `aircraft.py` creates the `Model` from forces, moments and masses.
"""
''',
        "hfa_aircraft/__init__.py": '"""Declaration, loading and unit conversion of aircraft models, used by all packages."""\n'
        + PUBLIC,
        "hfa_aircraft/__init__.pyi": '''"""Declaration, loading and conversion of aircraft models."""

''',
    },
    2: {},
    3: {
        "controller/critic/network/__init__.py": '"""Files of networks that represent the policy or the value of a critic."""\n',
        "controller/discrete/__init__.py": '"""Discrete-time games: normal form, exact solution and implied policy."""\n',
        "controller/plant/__init__.py": '"""Certified H-infinity control of a generalized plant."""\n',
        "controller/schedule/__init__.py": '"""Gains and controllers scheduled on a measured variable, and their files."""\n',
    },
    4: {
        "verification/enclosure/__init__.py": '"""Enclosures of functions: over many boxes in doubles with rounding errors, and in balls."""\n',
        "verification/network/__init__.py": '"""Errors of networks over a box of states: found by a search, and bounded by a proof."""\n',
        "verification/printed/__init__.py": '"""Printed answers: numbers in a paper or manual, compared with their plant\'s exact solution."""\n',
        "verification/reasons/__init__.py": '''"""Search for the reason why a critic is wrong.

The reason is a mistake, or another game of which the critic is the solution.
"""
''',
    },
    5: {
        "hfa/page/__init__.py": '"""`hfa report`: trims, linear models, games and the paper\'s claims on one HTML page."""\n'
    },
    6: {
        "extensions/flight/hfa_flight/air/__init__.py": '"""Moving air: gusts and turbulence."""\n',
        "extensions/flight/hfa_flight/policies/__init__.py": '"""Policies that fly: gains, schedules, controllers and deployments."""\n',
        "extensions/flight/hfa_flight/policies/deployment/__init__.py": '"""Policies as they are deployed: observations, network, actions and timing."""\n',
        "extensions/flight/hfa_flight/samples/__init__.py": '"""Many flights with random differences."""\n',
    },
    7: {
        "extensions/prove/hfa_prove/__init__.py": '"""Proofs about loops of an aircraft: schedules, games, regions of attraction, bounds of cost."""\n'
        + PUBLIC,
        "extensions/prove/hfa_prove/__init__.pyi": '"""Proofs and their checkers."""\n',
        "extensions/prove/hfa_prove/check/__init__.py": '''"""Checkers of certificates.

The checkers repeat the proof and trust no result of the search.
"""
''',
        "extensions/prove/hfa_prove/statements/__init__.py": '"""Statements of certificates and the data of their proofs."""\n',
        "extensions/prove/hfa_prove/search/__init__.py": '"""Search for what the checkers prove."""\n',
        "extensions/prove/hfa_prove/commands/__init__.py": '"""The commands `hfa prove`."""\n',
        "extensions/design/hfa_design/__init__.py": '"""Design of controllers with actuators, integrated outputs and weights."""\n'
        + PUBLIC,
        "extensions/design/hfa_design/__init__.pyi": '"""Design of a controller."""\n',
        "extensions/design/hfa_design/commands/__init__.py": '"""Commands of this extension."""\n',
    },
}


def leftovers(package: str) -> list[str]:
    folder = f"extensions/{package}/hfa_{package}"
    names = ("__init__.py", "__init__.pyi", "py.typed", "commands/__init__.py", "draws/__init__.py")
    return [f"{folder}/{name}" for name in names]


DELETED = {
    1: [*leftovers("air"), *leftovers("daveml"), *leftovers("derivatives"), *leftovers("rigid")],
    2: [*leftovers("stores"), "trim/hfa/front_view.py"],
    3: ["extensions/networks/hfa_networks/files/__init__.py"],
    4: [
        *leftovers("networks"),
        "extensions/networks/hfa_networks/judge/__init__.py",
        *leftovers("printed"),
        *leftovers("reasons"),
    ],
    5: [
        *leftovers("page"),
        *leftovers("formats"),
        *leftovers("discrete"),
        "extensions/identify/hfa_identify/draws/__init__.py",
    ],
    6: [],
    7: [
        *leftovers("boxes"),
        *leftovers("proof"),
        *leftovers("region"),
        *leftovers("servo"),
        "extensions/servo/hfa_servo/notebook/__init__.py",
        *(f"extensions/boxes/hfa_boxes/{n}/__init__.py" for n in ("check", "search", "enclosure")),
        *(f"extensions/proof/hfa_proof/{n}/__init__.py" for n in ("checker", "search")),
        *(f"extensions/region/hfa_region/{n}/__init__.py" for n in ("check", "search")),
    ],
}
#: Packages that end with a group, and those that begin.
GONE = {
    1: ["air", "daveml", "derivatives", "rigid"],
    2: ["stores"],
    3: [],
    4: ["networks", "printed", "reasons"],
    5: ["page", "formats", "discrete"],
    6: [],
    7: ["boxes", "proof", "region", "servo"],
}
NEW = {7: ["design", "prove"]}
SUPPORT_GONE = {1: ["air"], 3: ["discrete", "networks"], 4: ["printed", "reasons"]}

DOCSTRINGS: dict[str, str] = {
    "hfa_support/matrices.py": "Checks of matrices given by users.",
    "hfa_support/reporting/parts.py": "Parts of reports.",
    "verification/axis.py": "Loops of a critic in continuous and in discrete time.",
    "trim/point/status.py": "Status of an operating point.",
    "controller/critic/reading.py": "Settings for reading critics from files.",
    "extensions/flight/hfa_flight/initial_box.py": "Boxes of initial conditions, and draws from them.",
    "extensions/prove/hfa_prove/check/verified.py": "Result of a check.",
    "extensions/prove/hfa_prove/commands/request.py": "Requests of the commands `hfa prove`.",
    "extensions/prove/hfa_prove/problem.py": "Statement of a cost bound for a problem of flights.",
    "extensions/prove/hfa_prove/statements/evidence.py": "Sums of squares as evidence of positivity.",
    "extensions/prove/hfa_prove/statements/loop.py": "Loops of statements.",
    "extensions/prove/hfa_prove/statements/piece.py": "Polynomial pieces of a set.",
}
RENAMES: dict[tuple[str, str], str] = {
    ("extensions/identify/hfa_identify/draws/report.py", "with_draws"): "with_section_on_draws",
}
LAZY: dict[str, tuple[str, ...]] = {
    "trim/point/operating_point.py": ("trim.point.trim_report",),
}
TYPES_ONLY: dict[str, tuple[str, ...]] = {}
AS_MODULE: dict[tuple[str, str], str] = {}
#: Further words: group -> old -> new.
TEXT: dict[int, dict[str, str]] = {}


def contracts(group: int, final: str) -> str:
    """Import contracts after a group from 5 on, from those after the last."""
    if group >= 7:
        return final
    above = '    "hfa_policy",\n    "hfa_optimal",\n    "hfa_prove",\n    "hfa_design | hfa_identify",\n    "hfa_flight",\n'
    order = {
        5: (
            "hfa_optimal",
            "hfa_region",
            "hfa_policy",
            "hfa_boxes",
            "hfa_proof",
            "hfa_servo",
            "hfa_flight",
            "hfa_identify",
        ),
        6: (
            "hfa_policy",
            "hfa_optimal",
            "hfa_region",
            "hfa_boxes",
            "hfa_proof",
            "hfa_servo | hfa_identify",
            "hfa_flight",
        ),
    }[group]
    assert above in final
    text = final.replace(above, "".join(f'    "{name}",\n' for name in order))
    begin = text.index('[[tool.importlinter.contracts]]\nname = "Checkers and statements')
    end = text.index("[[tool.importlinter.contracts]]", begin + 5)
    checkers = """[[tool.importlinter.contracts]]
name = "The checkers take nothing of the search"
type = "imports_nothing_but"
modules = ["hfa_proof.checker", "hfa_boxes.check", "hfa_region.check"]
allowed = [
    "hfa_support", "hfa_aircraft", "hfa_model", "verification.enclosure", "hfa_proof.checker", "hfa_proof.flexible_aircraft",
    "hfa_boxes.check", "hfa_region.check",
]

"""
    text = text[:begin] + checkers + text[end:]
    return text.replace("hfa_design", "hfa_servo").replace(
        "hfa_prove.hfa", "hfa_proof.flexible_aircraft"
    )


#: Corrections of pyproject.toml after the words are replaced: group -> (old, new).
SETTINGS_TEXT = {
    1: [('"trim.linear", "hfa_aircraft.limits"]', '"trim.linear"]')],
    3: [
        ('"controller.learning", "controller.learning.q_learning"', '"controller.learning"'),
        (' "controller.learning.q_learning",', ""),
        ('"controller.game", "hfa_networks.files"]', '"controller.game"]'),
    ],
    4: [(' "verification.critic.discrete",', "")],
}


def pyproject(group: int, text: str) -> str:
    """pyproject.toml without the packages that end, and with those that begin."""
    import re

    def drop(entry: str, text: str) -> str:
        return re.sub(rf'"{re.escape(entry)}",? ?', "", text)

    for name in GONE[group]:
        text = drop(f"extensions/{name}", text)
        text = drop(f"hfa_{name}", text)
        text = re.sub(rf'(?<=["| ])hfa_{name} \| ', "", text)
        text = re.sub(rf' \| hfa_{name}(?=[" ])', "", text)
        text = re.sub(rf"^hfa_{name} = \[.*\]\n", "", text, flags=re.M)
    for name in {*SUPPORT_GONE.get(group, ()), *GONE[group]}:
        text = drop(f"extensions/{name}/tests/support", text)
    for name in NEW.get(group, ()):
        text = text.replace('"extensions/flight",', f'"extensions/{name}", "extensions/flight",')
        text = text.replace('"hfa_flight", ', f'"hfa_{name}", "hfa_flight", ')
        text = text.replace(
            '"extensions/flight/tests/support",',
            f'"extensions/{name}/tests/support", "extensions/flight/tests/support",',
        )
    text = re.sub(r"^ +\n", "", text, flags=re.M)
    return re.sub(r" +$", "", text, flags=re.M)


def after_words(group: int, text: str) -> str:
    """pyproject.toml after the words are replaced: contracts and data of packages."""
    import re

    for old, new in SETTINGS_TEXT.get(group, ()):
        if old not in text:
            print("  pyproject.toml has no", old)
        text = text.replace(old, new)
    if group >= 5:
        text = text[: text.index("[[tool.importlinter.contracts]]")] + contracts(group, CONTRACTS)
    for old, new in PACKAGE_DATA.get(group, ()):
        if old not in text:
            print("  pyproject.toml has no", old)
        text = text.replace(old, new)
    text = re.sub(r"^ +\n", "", text, flags=re.M)
    return re.sub(r" +$", "", text, flags=re.M)


GROUPS[2]["hfa/entry_points.py"] = [
    "hfa/entry_points.py",
    "extensions/stores/hfa_stores/entry_points.py",
]
GROUPS[4]["hfa/entry_points.py"] = [
    "hfa/entry_points.py",
    "extensions/printed/hfa_printed/entry_points.py",
]
GROUPS[5]["hfa/entry_points.py"] = [
    "hfa/entry_points.py",
    *(
        f"extensions/{n}/hfa_{n}/entry_points.py"
        for n in ("page", "flight", "policy", "optimal", "identify", "proof", "region", "servo")
    ),
]

PACKAGE_DATA = {
    5: [('hfa = ["*.toml"]', 'hfa = ["*.toml"]\n"hfa.page" = ["*.css", "*.js", "*.toml"]')],
    6: [
        ('hfa_policy = ["*.in"]\n', ""),
        ('hfa_servo = ["*.toml", "*.in"]', 'hfa_servo = ["*.toml"]'),
    ],
    7: [('"hfa_flight.export"', 'hfa_design = ["*.toml"]\n"hfa_flight.export"')],
}
TEXT[1] = {
    "hfa_air": "hfa_model",
    "hfa_daveml": "hfa_aircraft",
    "hfa_derivatives": "hfa_aircraft",
    "hfa_rigid": "hfa_aircraft",
}
TEXT[4] = {
    "hfa_networks.judge": "verification.network",
    "extensions/networks/tests/trained": "tests/verification/network/trained",
    "extensions/proof/hfa_proof/arithmetic": "verification/enclosure",
    "hfa_networks": "verification",
}
TEXT[5] = {"hfa_page": "hfa.page", "hfa_formats": "hfa.formats", "hfa_discrete": "controller"}
TEXT[7] = {
    "hfa_servo": "hfa_design",
    "hfa_proof": "hfa_prove",
    "hfa_boxes": "hfa_prove",
    "hfa_region": "hfa_prove",
    "hfa_region/check": "hfa_prove/check",
    "extensions/servo/hfa_servo": "extensions/design/hfa_design",
}

CONTRACTS = """[[tool.importlinter.contracts]]
name = "Packages import only those below them; beside the command, only the extensions stand above the core"
type = "layers"
layers = [
    "studies",
    "hfa.main : hfa.entry : hfa.entry_points : hfa.commands : hfa.page : hfa.formats : hfa.completion : hfa.overview : hfa.extend : hfa.paper",
    "hfa_policy",
    "hfa_optimal",
    "hfa_prove",
    "hfa_design | hfa_identify",
    "hfa_flight",
    "hfa.options",
    "verification",
    "controller",
    "trim",
    "hfa_model",
    "hfa_aircraft",
    "hfa_support",
]

[[tool.importlinter.contracts]]
name = "The core imports no extension"
type = "imports_nothing_but"
modules = ["hfa_support", "hfa_aircraft", "hfa_model", "trim", "controller", "verification", "hfa.options"]
allowed = ["hfa_support", "hfa_aircraft", "hfa_model", "trim", "controller", "verification", "hfa.options"]

[[tool.importlinter.contracts]]
name = "JSBSim is a door: it imports what an aircraft is, and nothing imports it"
type = "imports_nothing_but"
modules = ["hfa_jsbsim"]
allowed = ["hfa_jsbsim", "hfa_aircraft", "hfa_support"]

[[tool.importlinter.contracts]]
name = "Nothing imports JSBSim's reader"
type = "protected"
protected_modules = ["hfa_jsbsim"]
allowed_importers = ["studies"]

[[tool.importlinter.contracts]]
name = "Trims: sweeps know points, points and linear models know tables, none of them the flexible aircraft"
type = "layers"
layers = ["trim.hfa", "trim.sweeps", "trim.point : trim.linear", "trim.tables"]

[[tool.importlinter.contracts]]
name = "Aircraft: readers know models, models no readers"
type = "layers"
layers = [
    "hfa_aircraft.loading : hfa_aircraft.readers",
    "hfa_aircraft.rigid : hfa_aircraft.matrices",
    "hfa_aircraft.march : hfa_aircraft.model",
]

[[tool.importlinter.contracts]]
name = "Games: plants know exact solutions, these know games"
type = "layers"
layers = ["controller.plant", "controller.discrete", "controller.riccati", "controller.game"]

[[tool.importlinter.contracts]]
name = "Learning and critics know games, games neither"
type = "layers"
layers = ["controller.learning", "controller.critic", "controller.game"]

[[tool.importlinter.contracts]]
name = "Exact solutions and schedules know games, games no schedules"
type = "layers"
layers = ["controller.schedule", "controller.game"]

[[tool.importlinter.contracts]]
name = "Verdicts: checks know their networks and reasons, these the figures and errors"
type = "layers"
layers = [
    "verification.printed",
    "verification.critic",
    "verification.network | verification.reasons",
    "verification.axis : verification.verdict : verification.error_table",
    "verification.scope",
    "verification.critic_errors",
]

[[tool.importlinter.contracts]]
name = "Enclosures are arithmetic"
type = "imports_nothing_but"
modules = ["verification.enclosure"]
allowed = ["hfa_support", "verification.enclosure"]

[[tool.importlinter.contracts]]
name = "What learns never imports the exact solver"
type = "forbidden"
source_modules = ["controller.learning"]
forbidden_modules = ["controller.riccati", "controller.discrete.solution", "verification"]

[[tool.importlinter.contracts]]
name = "Only the commands that learn import what learns: nothing that judges, whatever its package"
type = "protected"
protected_modules = ["controller.learning"]
allowed_importers = ["hfa.options.games", "hfa.commands", "hfa.page", "hfa_flight.options", "studies"]

[[tool.importlinter.contracts]]
name = "Only commands reach what learns through others: nothing that judges, whatever its package"
type = "imported_by_nothing_but"
modules = ["controller.learning"]
allowed = ["*.commands", "hfa.options.games", "hfa_flight.options", "hfa.page", "studies", "hfa_design.designed_game"]

[[tool.importlinter.contracts]]
name = "A critic is what was learned; it knows no solution"
type = "forbidden"
source_modules = ["controller.critic", "controller.game"]
forbidden_modules = ["controller.riccati", "controller.discrete.solution", "controller.learning", "verification"]

[[tool.importlinter.contracts]]
name = "What judges critics imports, not even by others, nothing that flies"
type = "forbidden"
source_modules = ["controller.riccati", "controller.critic", "verification"]
forbidden_modules = ["hfa_flight", "hfa_policy", "hfa_optimal", "hfa_design"]

[[tool.importlinter.contracts]]
name = "Checkers and statements take nothing of the search"
type = "imports_nothing_but"
modules = ["hfa_prove.check", "hfa_prove.statements"]
allowed = [
    "hfa_support", "hfa_aircraft", "hfa_model", "verification.enclosure", "hfa_prove.certificate", "hfa_prove.fields",
    "hfa_prove.hfa", "hfa_prove.check", "hfa_prove.statements",
]

[[tool.importlinter.contracts]]
name = "Only these import the flexible aircraft; every other package is for any aircraft"
type = "protected"
protected_modules = ["hfa_model"]
allowed_importers = [
    "trim.hfa", "controller.hfa_files", "controller.hfa_game", "verification.hfa_box", "verification.regeneration",
    "hfa", "hfa_prove.hfa", "studies",
]
"""

#: Commands after a group.
FIXES = {
    1: "python3 - <<'P'\nimport re\np='docs/names_page.py'; s=open(p).read()\ns=re.sub(r'    \"hfa_(air|model)\": \"its unsteady dynamics\",\\n','    \"hfa_aircraft\": \"models of aircraft\",\\n',s); open(p,'w').write(s)\np='docs/index.md'; s=open(p).read(); s=s.replace('generated/hfa_air\\n','generated/hfa_aircraft\\n'); s=s.replace('generated/hfa_model\\ngenerated/trim','generated/hfa_model\\ngenerated/trim'); open(p,'w').write(s)\nP\nsed -i 's/^import hfa, hfa_flight, hfa_model$/import hfa, hfa_aircraft, hfa_model/' docs/exchange.md\n",
    4: "sed -i '0,/^from verification.enclosure\\|^from hfa_support/s//from verification.enclosure import precision  # noqa: F401  # sets the precision of balls\\n&/' verification/enclosure/balls.py\n.venv/bin/ruff check -q --fix --select I verification/enclosure/balls.py\n",
    5: "python3 - <<'P'\nimport re\np='tests/project/test_contracts.py'; s=open(p).read()\na=s.index('    core = contract(\"The core imports nothing but\")'); b=s.index('\\n\\n\\n',a)\ns=s[:a]+'''    core = contract(\"The core imports no extension\")\n    in_core = PACKAGES - EXTENSIONS - {\"studies\", \"hfa\"} | {\"hfa.options\"}\n    assert set(core[\"modules\"]) == set(core[\"allowed\"]) == in_core\n    layers = contract(\"Packages import only those below them\")[\"layers\"]\n    named = {name.strip().partition(\".\")[0] for layer in layers for name in re.split(\"[|:]\", layer)}\n    assert named == PACKAGES - {\"hfa_jsbsim\"}\n    door = contract(\"JSBSim is a door\")\n    assert door[\"modules\"] == [\"hfa_jsbsim\"]'''+s[b:]\na=s.index('def test_ignored_imports'); b=s.index('@pytest.mark.slow',a)\ns=s[:a]+'''def test_no_import_is_ignored() -> None:\n    \"\"\"No contract has an exception, for type checkers or in functions.\"\"\"\n    assert [line for each in CONTRACTS for line in each.get(\"ignore_imports\", [])] == []\n\n\n'''+s[b:]\ns=s.replace('import os\\nimport shutil','import os\\nimport re\\nimport shutil').replace('import ast\\n','')\nopen(p,'w').write(s)\nP\npython3 - <<'P'\nimport re\np='docs/names_page.py'; s=open(p).read()\ns=re.sub(r'    \"(hfa_discrete|controller)\": \"games in discrete time\",\\n','',s); open(p,'w').write(s)\np='docs/index.md'; s=open(p).read(); s=s.replace('generated/hfa_discrete\\n',''); s=re.sub(r'generated/controller\\n(?=generated/hfa_aircraft)','',s); open(p,'w').write(s)\nP\n",
    6: "python3 - <<'P'\np='extensions/flight/hfa_flight/commands/export.py'; s=open(p).read()\nold='    policies = part(PARTS, \"policies\", \"--policy\")\\n'\nassert 'policies.exported_texts(' in s and s.count(old)==1\ns=s.replace('policies.exported_texts(','exported_texts(').replace(old,'    from hfa_flight.export.deployment_c import exported_texts\\n\\n'+old)\nopen(p,'w').write(s)\np='docs/parts_page.py'; s=open(p).read(); s=s.replace('        \"exported_texts\",\\n',''); open(p,'w').write(s)\nP\n.venv/bin/ruff format -q extensions/flight/hfa_flight/commands/export.py docs/parts_page.py\n",
    7: "sed -i 's/^CIRCLES = [0-9]*/CIRCLES = 2/' tests/project/test_circles.py\npython3 - <<'P'\nimport re\np='docs/names_page.py'; s=open(p).read()\ns=s.replace('\"hfa_servo\"','\"hfa_design\"').replace('\"hfa_proof\"','\"hfa_prove\"'); open(p,'w').write(s)\np='docs/index.md'; s=open(p).read(); s=s.replace('generated/hfa_servo','generated/hfa_design').replace('generated/hfa_proof','generated/hfa_prove'); open(p,'w').write(s)\nP\n",
}

BUILTIN_LINE = 100
NOTES: list[str] = []


def note(text: str) -> None:
    NOTES.append(text)
    print("  " + text)


def module_of(path: str) -> str:
    """Dotted name of a source file."""
    parts = path.split("/")
    if parts[0] == "extensions":
        parts = parts[2:]
    name = ".".join(parts)
    name = re.sub(r"\.pyi?$", "", name)
    return name.removesuffix(".__init__")


def is_source(path: str) -> bool:
    """Whether a file belongs to a package, not to tests."""
    return path.endswith((".py", ".pyi")) and "/tests/" not in "/" + path


# ---------------------------------------------------------------- names in a source


def bound_by(statement: ast.stmt) -> list[str]:
    """Names that a top-level statement defines."""
    if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return [statement.name]
    if isinstance(statement, ast.Assign):
        return [
            n.id
            for t in statement.targets
            for n in ast.walk(t)
            if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
        ]
    if isinstance(statement, (ast.AnnAssign, ast.AugAssign)) and isinstance(
        statement.target, ast.Name
    ):
        return [statement.target.id]
    if isinstance(statement, (ast.If, ast.Try, ast.With, ast.For)):
        return [
            n
            for s in ast.iter_child_nodes(statement)
            if isinstance(s, ast.stmt)
            for n in bound_by(s)
        ]
    return []


def is_checkers(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.If)
        and isinstance(statement.test, ast.Name)
        and statement.test.id == "TYPE_CHECKING"
        and all(isinstance(s, (ast.Import, ast.ImportFrom)) for s in statement.body)
        and not statement.orelse
    )


def first_line(statement: ast.stmt) -> int:
    lines = [statement.lineno]
    lines += [d.lineno for d in getattr(statement, "decorator_list", [])]
    return min(lines)


@dataclass
class Segment:
    names: list[str]
    text: str
    node: ast.stmt


@dataclass
class Source:
    """A file in parts: docstring, imports, and statements with the comments above them."""

    docstring: str = ""
    future: bool = False
    imports: list[str] = field(default_factory=list)  # statements
    checkers: list[str] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    tail: str = ""


def parsed(text: str) -> Source:
    tree = ast.parse(text)
    lines = text.splitlines(keepends=True)
    found = Source()
    end = 0  # line index after the previous statement
    for number, statement in enumerate(tree.body):
        start, stop = first_line(statement) - 1, statement.end_lineno
        above = "".join(lines[end:start])
        code = "".join(lines[start:stop])
        is_doc = (
            number == 0
            and isinstance(statement, ast.Expr)
            and isinstance(statement.value, ast.Constant)
            and isinstance(statement.value.value, str)
        )
        if is_doc:
            found.docstring = code
        elif isinstance(statement, ast.ImportFrom) and statement.module == "__future__":
            found.future = True
        elif isinstance(statement, (ast.Import, ast.ImportFrom)):
            found.imports.append((above.strip("\n") + "\n" if above.strip() else "") + code)
        elif is_checkers(statement):
            for inner in statement.body:
                inner_code = "".join(lines[inner.lineno - 1 : inner.end_lineno])
                found.checkers.append(inner_code)
        else:
            found.segments.append(
                Segment(
                    bound_by(statement),
                    (above.strip("\n") + "\n" if above.strip() else "") + code,
                    statement,
                )
            )
        end = stop
    found.tail = "".join(lines[end:]).strip("\n")
    return found


def written(source: Source) -> str:
    out = []
    if source.docstring:
        out.append(source.docstring.rstrip("\n") + "\n\n")
    if source.future:
        out.append("from __future__ import annotations\n\n")
    if source.imports:
        out.append("".join(each.rstrip("\n") + "\n" for each in source.imports) + "\n")
    if source.checkers:
        out.append(
            "if TYPE_CHECKING:\n"
            + "".join(
                "    " + each.strip().replace("\n", "\n    ") + "\n" for each in source.checkers
            )
            + "\n"
        )
    for segment in source.segments:
        gap = (
            "\n\n"
            if isinstance(segment.node, (ast.FunctionDef, ast.ClassDef, ast.AsyncFunctionDef))
            else ""
        )
        out.append(gap + segment.text.rstrip("\n") + "\n" + gap)
    if source.tail:
        out.append("\n\n" + source.tail + "\n")
    return "".join(out)


def loaded_names(node: ast.AST) -> set[str]:
    """Names that code reads, also in annotations in quotes."""
    names = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
    for n in ast.walk(node):
        if (
            isinstance(n, ast.Constant)
            and isinstance(n.value, str)
            and re.fullmatch(r"[\w.\[\], |]+", n.value)
        ):
            names |= (
                set(re.findall(r"[A-Za-z_]\w*", n.value))
                if n.value[:1].isupper() or n.value[:1] == "_"
                else set()
            )
    return names


# ---------------------------------------------------------------- edits by position


class Edits:
    """Replacements of parts of a text, by offset."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.starts = [0]
        for line in text.splitlines(keepends=True):
            self.starts.append(self.starts[-1] + len(line))
        self.lines = text.splitlines(keepends=True)
        self.edits: list[tuple[int, int, str]] = []

    def offset(self, line: int, column_bytes: int) -> int:
        raw = self.lines[line - 1].encode()[:column_bytes].decode()
        return self.starts[line - 1] + len(raw)

    def offset_chars(self, line: int, column: int) -> int:
        return self.starts[line - 1] + column

    def replace(self, start: int, end: int, new: str) -> None:
        self.edits.append((start, end, new))

    def node(self, node: ast.AST, new: str) -> None:
        self.replace(
            self.offset(node.lineno, node.col_offset),
            self.offset(node.end_lineno, node.end_col_offset),
            new,
        )

    def done(self) -> str:
        out, last = [], len(self.text)
        seen: set[tuple[int, int]] = set()
        for start, end, new in sorted(self.edits, reverse=True):
            if (start, end) in seen:
                continue
            seen.add((start, end))
            if end > last:
                raise ValueError(f"edits overlap: {self.text[start:end]!r}")
            out.append(self.text[end:last])
            out.append(new)
            last = start
        out.append(self.text[:last])
        return "".join(reversed(out))


class Renamer(ast.NodeVisitor):
    """Finds the places of a module's global names, without the locals of functions."""

    def __init__(self, names: dict[str, str]) -> None:
        self.names = names
        self.hidden: list[set[str]] = []
        self.places: list[tuple[ast.AST, str]] = []
        self.clashes: list[str] = []

    def is_global(self, name: str) -> bool:
        return name in self.names and not any(name in scope for scope in self.hidden)

    def visit_Name(self, node: ast.Name) -> None:
        if self.is_global(node.id):
            self.places.append((node, self.names[node.id]))
            if any(self.names[node.id] in scope for scope in self.hidden):
                self.clashes.append(f"line {node.lineno}: {node.id} -> {self.names[node.id]}")

    def _locals(self, node: ast.AST, arguments: ast.arguments | None) -> set[str]:
        found: set[str] = set()
        if arguments:
            every = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
            every += [a for a in (arguments.vararg, arguments.kwarg) if a]
            found |= {a.arg for a in every}
        globals_: set[str] = set()

        def walk(n: ast.AST) -> None:
            for child in ast.iter_child_nodes(n):
                if isinstance(child, (ast.FunctionDef, ast.ClassDef, ast.AsyncFunctionDef)):
                    found.add(child.name)
                    continue
                if isinstance(child, ast.Lambda):
                    continue
                if isinstance(child, (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)):
                    continue
                if isinstance(child, ast.Name) and isinstance(child.ctx, (ast.Store, ast.Del)):
                    found.add(child.id)
                elif isinstance(child, ast.ExceptHandler) and child.name:
                    found.add(child.name)
                elif isinstance(child, (ast.Import, ast.ImportFrom)):
                    found.update((a.asname or a.name).split(".")[0] for a in child.names)
                elif isinstance(child, ast.Global):
                    globals_.update(child.names)
                elif isinstance(child, (ast.MatchAs, ast.MatchStar)) and child.name:
                    found.add(child.name)
                walk(child)

        for child in (
            getattr(node, "body", []) if isinstance(getattr(node, "body", None), list) else []
        ):
            walk(ast.Module(body=[child], type_ignores=[]))
        return found - globals_

    def _function(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        if not self.hidden and node.name in self.names:
            self.places.append((node, self.names[node.name]))
        for each in node.decorator_list:
            self.visit(each)
        arguments = node.args
        for a in [
            *arguments.posonlyargs,
            *arguments.args,
            *arguments.kwonlyargs,
            arguments.vararg,
            arguments.kwarg,
        ]:
            if a is not None and a.annotation is not None:
                self.visit(a.annotation)
        for d in [*arguments.defaults, *arguments.kw_defaults]:
            if d is not None:
                self.visit(d)
        if node.returns is not None:
            self.visit(node.returns)
        self.hidden.append(self._locals(node, arguments))
        for each in node.body:
            self.visit(each)
        self.hidden.pop()

    visit_FunctionDef = _function
    visit_AsyncFunctionDef = _function

    def visit_Lambda(self, node: ast.Lambda) -> None:
        for d in [*node.args.defaults, *node.args.kw_defaults]:
            if d is not None:
                self.visit(d)
        self.hidden.append(self._locals(node, node.args))
        self.visit(node.body)
        self.hidden.pop()

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        if not self.hidden and node.name in self.names:
            self.places.append((node, self.names[node.name]))
        for each in [*node.decorator_list, *node.bases, *node.keywords]:
            self.visit(each)
        own = self._locals(node, None)
        for each in node.body:
            if isinstance(each, (ast.FunctionDef, ast.AsyncFunctionDef)):
                self._function_in_class(each)
            else:
                self.hidden.append(own)
                # an annotation or value at class level reads the global unless the class has it
                self.visit(each)
                self.hidden.pop()

    def _function_in_class(self, node: ast.FunctionDef) -> None:
        saved = self.names
        # the name of a method is no global
        self.hidden.append({node.name} & set())
        self._function_body_only(node)
        self.hidden.pop()
        self.names = saved

    def _function_body_only(self, node: ast.FunctionDef) -> None:
        for each in node.decorator_list:
            self.visit(each)
        arguments = node.args
        for a in [
            *arguments.posonlyargs,
            *arguments.args,
            *arguments.kwonlyargs,
            arguments.vararg,
            arguments.kwarg,
        ]:
            if a is not None and a.annotation is not None:
                self.visit(a.annotation)
        for d in [*arguments.defaults, *arguments.kw_defaults]:
            if d is not None:
                self.visit(d)
        if node.returns is not None:
            self.visit(node.returns)
        self.hidden.append(self._locals(node, arguments))
        for each in node.body:
            self.visit(each)
        self.hidden.pop()

    def _comprehension(self, node: ast.AST) -> None:
        targets = {
            n.id for g in node.generators for n in ast.walk(g.target) if isinstance(n, ast.Name)
        }
        self.visit(node.generators[0].iter)
        self.hidden.append(targets)
        for number, g in enumerate(node.generators):
            if number:
                self.visit(g.iter)
            for condition in g.ifs:
                self.visit(condition)
        for part in ("elt", "key", "value"):
            if hasattr(node, part):
                self.visit(getattr(node, part))
        self.hidden.pop()

    visit_ListComp = _comprehension
    visit_SetComp = _comprehension
    visit_DictComp = _comprehension
    visit_GeneratorExp = _comprehension


def renamed(text: str, names: dict[str, str], where: str) -> str:
    """The text with global names renamed, also in comments that quote them."""
    if not names:
        return text
    tree = ast.parse(text)
    finder = Renamer(names)
    finder.visit(tree)
    for clash in finder.clashes:
        note(f"CLASH in {where}: {clash}")
    edits = Edits(text)
    for node, new in finder.places:
        if isinstance(node, ast.Name):
            edits.node(node, new)
        else:  # def or class
            line = node.lineno
            found = re.compile(rf"\b{re.escape(node.name)}\b").search(edits.lines[line - 1])
            start = edits.offset_chars(line, found.start())
            edits.replace(start, start + len(node.name), new)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Global,)) and set(node.names) & set(names):
            note(f"CLASH in {where}: global statement with {node.names}")
    text = edits.done()
    # names quoted in comments and docstrings
    edits = Edits(text)
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in (tokenize.STRING, tokenize.COMMENT):
            start = edits.offset_chars(*token.start)
            for old, new in names.items():
                for found in re.finditer(rf"(?<=`){re.escape(old)}(?=[`(.])", token.string):
                    edits.replace(start + found.start(), start + found.end(), new)
    return edits.done()


# ---------------------------------------------------------------- the move of one group


class Move:
    def __init__(self, group: int) -> None:
        self.group = group
        listed = subprocess.run(
            ["git", "ls-files"], capture_output=True, text=True, check=True
        ).stdout.split("\n")
        self.files = {
            name for name in listed if name and Path(name).is_file() and name not in ("move.py")
        }
        self.texts: dict[str, str] = {}
        self.modules = {module_of(p): p for p in self.files if is_source(p) and p.endswith(".py")}
        # targets of this group: new path -> old paths
        self.targets: dict[str, list[str]] = {}
        plan = GROUPS[group]
        for new, old in plan.items():
            present = [o for o in old if o in self.files]
            for o in old:
                if o not in self.files:
                    note(f"missing: {o} (for {new})")
            if present:
                self.targets[new] = present
        self.splits = {}  # (old path) -> {new path: names}
        for old, parts in SPLITS.get(group, {}).items():
            if old not in self.files:
                note(f"missing for a split: {old}")
                continue
            self.splits[old] = parts
        self.path_map = {o: n for n, old in self.targets.items() for o in old}
        self.module_map = {
            module_of(o): module_of(n)
            for o, n in self.path_map.items()
            if module_of(o) != module_of(n)
        }
        self.symbols: dict[tuple[str, str], tuple[str, str]] = {}
        self.faces = self._faces()
        self.face_moves: dict[tuple[str, str], tuple[str, str]] = {}

    def text(self, path: str) -> str:
        if path not in self.texts:
            self.texts[path] = Path(path).read_text("utf-8")
        return self.texts[path]

    # -- public names of packages, from their stubs
    def _faces(self) -> dict[tuple[str, str], tuple[str, str]]:
        """(package, public name) -> (module, name there)."""
        found = {}
        for path in self.files:
            if not path.endswith("__init__.pyi"):
                continue
            package = module_of(path)
            for statement in ast.parse(self.text(path)).body:
                if isinstance(statement, ast.ImportFrom):
                    base = self._absolute(statement, package, True)
                    for alias in statement.names:
                        found[package, alias.asname or alias.name] = (base, alias.name)
        return found

    @staticmethod
    def _absolute(statement: ast.ImportFrom, module: str, is_package: bool) -> str:
        if not statement.level:
            return statement.module or ""
        parts = module.split(".")
        keep = len(parts) - statement.level + (1 if is_package else 0)
        return ".".join([*parts[:keep], *([statement.module] if statement.module else [])])

    def resolved(self, module: str, name: str) -> tuple[str, str]:
        """New module and name of `from module import name`."""
        seen = 0
        if (module, name) in self.symbols:
            return self.symbols[module, name]
        if (module, name) in self.face_moves:
            return self.face_moves[module, name]
        if module in self.module_map:
            return self.module_map[module], name
        return module, name

    # -- rewriting of one text
    def rewritten(
        self, text: str, old_module: str, new_module: str, where: str, is_package: bool = False
    ) -> tuple[str, dict[str, str]]:
        """The text with its imports in new places. Returns it and the local renames that it needs."""
        tree = ast.parse(text)
        nodes = list(ast.walk(tree))
        edits = Edits(text)
        renames: dict[str, str] = {}
        extra: list[str] = []
        module_aliases: dict[str, str] = {}
        removed: list[ast.stmt] = []
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and node.module != "__future__":
                base = self._absolute(node, old_module, is_package)
                new: dict[str, list[tuple[str, str]]] = {}
                changed = False
                for alias in node.names:
                    name, asname = alias.name, alias.asname
                    full = f"{base}.{name}"
                    if full in self.module_map or full in self.modules:
                        target = self.module_map.get(full, full)
                        module_aliases[asname or name] = full
                        if target == new_module:
                            note(f"MODULE imports itself: {where}: {full}")
                        parent, _, leaf = target.rpartition(".")
                        local = asname or name
                        shown = (leaf, "" if leaf == local else local)
                        if (full, "") in AS_MODULE:
                            shown = (leaf, AS_MODULE[full, ""])
                        changed |= target != full
                        if not parent:
                            note(f"MODULE without a package: {where}: {full}")
                        new.setdefault(parent, []).append(shown)
                        continue
                    target, there = self.resolved(base, name)
                    local = asname or name
                    if target == new_module:
                        changed = True
                        if local != there:
                            renames[local] = there
                        continue
                    if there != name and not asname:
                        # a renamed definition: its users take the new name
                        renames[name] = there
                        local = there
                    elif there != name:
                        local = asname
                    changed |= (target, there) != (base, name)
                    keep_as = bool(asname) and asname == name == there  # `x as x` of stubs
                    new.setdefault(target, []).append(
                        (there, there if keep_as else ("" if there == local else local))
                    )
                if not changed:
                    continue
                indent = " " * node.col_offset
                statements = []
                for target, names in new.items():
                    shown = target
                    if (
                        where.endswith(".pyi")
                        and node.level
                        and target.split(".")[0] == new_module.split(".")[0]
                    ):
                        shown = "." + target.removeprefix(new_module + ".")
                    inside = ", ".join(f"{n} as {a}" if a else n for n, a in names)
                    statement = f"from {shown} import {inside}"
                    if len(indent) + len(statement) > BUILTIN_LINE and len(names) >= 1:
                        statement = f"from {shown} import ({inside})"
                    statements.append(statement)
                comment = ""
                last_line = edits.lines[node.end_lineno - 1]
                if "# noqa" in last_line:
                    note(f"noqa at an import: {where}: {last_line.strip()}")
                if statements:
                    edits.node(node, f"\n{indent}".join(statements))
                else:
                    removed.append(node)
            elif isinstance(node, ast.Import):
                for alias in node.names:
                    if alias.name in self.module_map:
                        target = self.module_map[alias.name]
                        if alias.asname:
                            edits.node(alias, f"{target} as {alias.asname}")
                            module_aliases[alias.asname] = alias.name
                        else:
                            edits.node(alias, target)
                            for chain in nodes:
                                if (
                                    isinstance(chain, ast.Attribute)
                                    and ast.unparse(chain) == alias.name
                                ):
                                    edits.node(chain, target)
                    elif not alias.asname and any(
                        alias.name == package for package, _ in self.face_moves
                    ):
                        for chain in nodes:  # hfa_flight.GainSchedule
                            if (
                                isinstance(chain, ast.Attribute)
                                and isinstance(chain.value, ast.Name)
                                and chain.value.id == alias.name
                                and (alias.name, chain.attr) in self.face_moves
                            ):
                                package, name = self.face_moves[alias.name, chain.attr]
                                edits.node(chain, f"{package}.{name}")
                                extra.append(f"import {package}\n")
        for block in nodes if removed else []:
            for body in (getattr(block, part, None) for part in ("body", "orelse", "finalbody")):
                if not isinstance(body, list) or not any(node in removed for node in body):
                    continue
                inside = [node for node in body if node in removed]
                if len(inside) < len(body) or block is tree:
                    for node in inside:
                        edits.node(node, "")
                elif isinstance(block, ast.If) and is_checkers(block):
                    edits.node(block, "")
                else:
                    edits.node(inside[0], "pass")
                    for node in inside[1:]:
                        edits.node(node, "")
        for chain in nodes:
            if (
                isinstance(chain, ast.Attribute)
                and isinstance(chain.value, ast.Name)
                and chain.value.id in module_aliases
            ):
                full = module_aliases[chain.value.id]
                if (full, chain.attr) in self.symbols:
                    note(
                        f"ATTRIBUTE of a module: {where}:{chain.lineno}: {chain.value.id}.{chain.attr} is now {self.symbols[full, chain.attr]}"
                    )
        # strings and comments
        import_lines = {
            line
            for node in nodes
            if isinstance(node, (ast.Import, ast.ImportFrom))
            for line in range(node.lineno, node.end_lineno + 1)
        }
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if (
                token.type in (tokenize.STRING, tokenize.COMMENT)
                and token.start[0] not in import_lines
            ):
                new_string = self.in_words(token.string, where)
                if new_string != token.string:
                    edits.replace(
                        edits.offset_chars(*token.start), edits.offset_chars(*token.end), new_string
                    )
        text = edits.done()
        if extra:
            tree = ast.parse(text)
            at = next(
                n
                for n in tree.body
                if isinstance(n, (ast.Import, ast.ImportFrom))
                and getattr(n, "module", "") != "__future__"
            )
            lines = text.splitlines(keepends=True)
            lines.insert(at.lineno - 1, "".join(sorted(set(extra))))
            text = "".join(lines)
        return text, renames

    # -- names of modules and files in words
    def build_words(self) -> None:
        exact: dict[str, str] = {}
        for (module, name), (target, there) in self.symbols.items():
            exact[f"{module}:{name}"] = f"{target}:{there}"
            exact[f"{module}.{name}"] = f"{target}.{there}"
        for (package, name), (target, there) in self.face_moves.items():
            exact[f"{package}.{name}"] = f"{target}.{there}"
            exact[f"from {package} import {name}"] = f"from {target} import {there}"
        for old, new in self.module_map.items():
            if "." in old:
                exact.setdefault(old, new)
        for old, new in {**self.path_map, **self.moved_others}.items():
            if old != new and "/" in old:
                exact[old] = new
                if old.startswith("extensions/") and "/tests/" not in old:
                    short = "/".join(old.split("/")[2:])
                    exact[short] = (
                        "/".join(new.split("/")[2:]) if new.startswith("extensions/") else new
                    )
        exact.update(TEXT.get(self.group, {}))
        self.words = exact
        ordered = sorted(exact, key=len, reverse=True)
        every = {*exact, *self.module_map, *(module for module, _ in self.symbols)}
        every |= {f"import {package}" for package, _ in self.face_moves}
        every |= {f"from {package} import" for package, _ in self.face_moves}
        every |= {f"from {old.rpartition('.')[0]} import" for old in self.module_map}
        every |= {f"hfa_{package}" for package in GONE[self.group]}
        self.concerned = re.compile("|".join(map(re.escape, sorted(every, key=len, reverse=True))))
        self.pattern = (
            re.compile(r"(?<![\w./-])(" + "|".join(map(re.escape, ordered)) + r")(?![\w])")
            if ordered
            else None
        )

    def in_words(self, text: str, where: str) -> str:
        if self.pattern is None:
            return text
        return self.pattern.sub(lambda found: self.words[found[1]], text)

    # -- pieces
    def run(self) -> None:
        self.moved_others: dict[str, str] = {
            o: n for o, n in DATA.get(self.group, {}).items() if o in self.files
        }
        for old in DATA.get(self.group, {}):
            if old not in self.files:
                note(f"missing data or test: {old}")
        # symbols that go alone
        pieces: dict[str, list[tuple[str, str, str]]] = defaultdict(
            list
        )  # target -> (old path, text, label)
        remaining: dict[str, str] = {}
        for old, parts in self.splits.items():
            home = self.path_map.get(old, old)
            source = parsed(self.text(old))
            module = module_of(old)
            moved_names = {}
            for new, names in parts.items():
                defined = {n for s in source.segments for n in s.names}
                for name in names:
                    if name not in defined:
                        note(f"missing for a split: {old}:{name}")
                    elif new != home:
                        moved_names[name] = new
            for new in dict.fromkeys(moved_names.values()):
                while True:  # what the moved definitions need goes along, if the rest needs them
                    mine = [
                        s
                        for s in source.segments
                        if s.names and all(moved_names.get(n) == new for n in s.names)
                    ]
                    others = [s for s in source.segments if s not in mine]
                    used = set().union(*(loaded_names(s.node) for s in mine))
                    theirs = (
                        set().union(*(loaded_names(s.node) for s in others)) if others else set()
                    )
                    needed = {
                        n for s in others for n in s.names if n in used and n not in moved_names
                    }
                    if not needed or not theirs & {n for n in moved_names if moved_names[n] == new}:
                        break
                    note(f"split {old} -> {new}: also {sorted(needed)}")
                    moved_names |= dict.fromkeys(needed, new)
            for name, new in moved_names.items():
                self.symbols[module, name] = (module_of(new), name)
            kept = [
                s for s in source.segments if not (s.names and set(s.names) <= set(moved_names))
            ]
            for new in dict.fromkeys(moved_names.values()):
                mine = [
                    s
                    for s in source.segments
                    if s.names and all(moved_names.get(n) == new for n in s.names)
                ]
                used = set().union(*(loaded_names(s.node) for s in mine))
                needed = sorted(
                    n for s in source.segments if s not in mine for n in s.names if n in used
                )
                piece = Source("", source.future, [*source.imports], [*source.checkers], mine)
                if needed:
                    piece.imports.append(f"from {module} import {', '.join(needed)}\n")
                    private = [n for n in needed if n.startswith("_")]
                    if private:
                        note(f"split {new} imports {private} from {home}")
                pieces[new].append(
                    (old, written(piece), f"{old}:{'+'.join(n for s in mine for n in s.names)}")
                )
            used = set().union(*(loaded_names(s.node) for s in kept)) if kept else set()
            back = sorted(n for n in moved_names if n in used)
            rest = Source(
                source.docstring,
                source.future,
                [*source.imports],
                source.checkers,
                kept,
                source.tail,
            )
            if back:
                rest.imports.append(f"from {module} import {', '.join(back)}\n")
            remaining[old] = written(rest)
            if old not in self.path_map and old not in self.targets:
                self.targets.setdefault(old, [old])
        for new, old in self.targets.items():
            whole = [(o, remaining.get(o, self.text(o)), o) for o in old]
            pieces[new] = whole + pieces.get(new, [])
        for new in list(pieces):
            # a split into a file that exists and that no other rule moves
            if new not in self.targets:
                if new in self.files and not any(o == new for o, _, _ in pieces[new]):
                    pieces[new].insert(0, (new, self.text(new), new))
                self.targets[new] = []
        self._collisions(pieces)
        self._face_moves()
        self.build_words()
        results: dict[str, str] = {}
        for new, parts in pieces.items():
            results[new] = self._merged(new, parts)
        # all other files
        gone = {
            o
            for parts in pieces.values()
            for o, _, label in parts
            if o == label and o not in pieces
        }
        for path in sorted(self.files):
            if path in gone or path in results:
                continue
            target = self.moved_others.get(path, path)
            if path.endswith(".pyi") and path in DELETED.get(self.group, ()):
                continue
            if path in DELETED.get(self.group, ()):
                continue
            if (
                path.endswith(".py")
                and target == path
                and not self.concerned.search(self.text(path))
            ):
                continue
            if path.endswith((".py", ".pyi")):
                text = before = self.text(path)
                if "/tests/" in "/" + path:
                    text = without_presence(text, self.group)
                module = module_of(path)
                new_text, renames = self.rewritten(
                    text, module, module, path, path.endswith(("__init__.py", "__init__.pyi"))
                )
                if path.endswith("__init__.pyi"):
                    new_text = self._stub(path, new_text)
                new_text = renamed(new_text, renames, path)
                deeper = target.count("/") - path.count("/")
                if deeper:  # the root of the project from a test
                    new_text = re.sub(
                        r"(__file__\)(?:\.resolve\(\))?\.parents)\[([2-9])\]",
                        lambda found: f"{found[1]}[{int(found[2]) + deeper}]",
                        new_text,
                    )
                if new_text != before or target != path:
                    results[target] = new_text
            elif (
                path.endswith(
                    (
                        ".md",
                        ".toml",
                        ".ipynb",
                        ".cff",
                        ".yml",
                        ".yaml",
                        ".in",
                        ".c",
                        ".m",
                        ".rst",
                        ".txt",
                        ".cfg",
                        ".ini",
                        ".js",
                        ".css",
                        ".html",
                        ".sh",
                    )
                )
                or path in ("Makefile", ".gitignore", ".gitattributes")
                or path.startswith(".ci/")
                or path.startswith(".github")
            ):
                if path == "ARCHITECTURE.md" or path == "CHANGELOG.md":
                    continue
                try:
                    text = self.text(path)
                except UnicodeDecodeError:
                    continue
                if path == "pyproject.toml":
                    new_text = after_words(
                        self.group, self.in_words(pyproject(self.group, text), path)
                    )
                else:
                    new_text = self.in_words(text, path)
                if path.endswith(".md"):
                    new_text = self._page(text, new_text)
                if new_text != text or target != path:
                    results[target] = new_text
            if target != path and target not in results:
                results[target] = None  # bytes
            if target != path:
                gone.add(path)
        for path in DELETED.get(self.group, ()):
            if path in self.files:
                gone.add(path)
        for path, text in INITS.get(self.group, {}).items():
            results[path] = text
            if path.endswith(".pyi"):
                results[path] = text + "\n" + "".join(self.stub_adds.get(module_of(path), []))
            gone.discard(path)
        self._write(results, gone)

    def _page(self, old_text: str, text: str) -> str:
        """A document whose Python blocks import the packages that they use."""
        olds = {package for package, _ in self.face_moves}
        for old in sorted(olds):
            moved = {name: self.face_moves[p, name][0] for p, name in self.face_moves if p == old}
            used = {
                new for name, new in moved.items() if re.search(rf"\b{old}\.{name}\b", old_text)
            }
            line = re.compile(rf"^import {old}\n", re.M)
            if not line.search(text):
                continue
            still = re.search(rf"(?<![\w.]){old}\.\w", text)
            missing = sorted(new for new in used if not re.search(rf"^import {new}$", text, re.M))
            lines = "".join(f"import {new}\n" for new in missing) + (
                f"import {old}\n" if still else ""
            )
            text = line.sub(lines, text)
        return re.sub(r"^(import \w+\n)(?=\1)", "", text, flags=re.M)

    def _collisions(self, pieces: dict[str, list[tuple[str, str, str]]]) -> None:
        """Decide new names where two pieces of one file define the same name."""
        self.piece_renames: dict[tuple[str, str], dict[str, str]] = defaultdict(dict)
        self.piece_drops: dict[tuple[str, str], set[str]] = defaultdict(set)
        for new, parts in pieces.items():
            owner: dict[str, tuple[str, str, ast.stmt]] = {}
            for old, text, label in parts:
                stem = re.sub(r"\W", "_", Path(old).stem)
                for segment in parsed(text).segments:
                    for name in segment.names:
                        fixed = RENAMES.get((old, name))
                        if fixed:
                            self.piece_renames[new, label][name] = fixed
                            self.symbols[module_of(old), name] = (module_of(new), fixed)
                            continue
                        if name not in owner:
                            owner[name] = (old, label, segment.node)
                            continue
                        first = owner[name]
                        if first[1] == label:
                            continue  # overloads
                        if ast.dump(first[2]) == ast.dump(segment.node):
                            self.piece_drops[new, label].add(name)
                            note(f"{new}: {name} of {old} equals that of {first[0]}; kept once")
                            continue
                        fresh = f"{name}_{stem}" if not name.isupper() else f"{name}_{stem.upper()}"
                        if not name.startswith("_"):
                            note(
                                f"PUBLIC collision in {new}: {name} of {old} and {first[0]} -> {fresh}"
                            )
                        else:
                            note(f"{new}: {name} of {old} -> {fresh}")
                        self.piece_renames[new, label][name] = fresh
                        self.symbols[module_of(old), name] = (module_of(new), fresh)

    def _face_moves(self) -> None:
        """Public names follow the module that defines them, to the stub of its package."""
        self.stub_adds: dict[str, list[str]] = defaultdict(list)
        stubs = {package for package, _ in self.faces} | {
            module_of(p) for p in INITS.get(self.group, {}) if p.endswith(".pyi")
        }
        for (package, name), (module, there) in self.faces.items():
            if package.split(".")[0] == "hfa":
                continue
            target, new_there = self.resolved(module, there)
            top = target.split(".")[0]
            if top == package:
                continue
            if top in stubs:
                self.face_moves[package, name] = (top, name)
                inside = f"{new_there} as {name}"
                self.stub_adds[top].append(
                    f"from .{target.removeprefix(top + '.')} import {inside}\n"
                )
            else:
                note(f"public name without a stub: {package}.{name} -> {target}")
                self.face_moves[package, name] = (target, new_there)

    def _stub(self, path: str, text: str) -> str:
        """The stub without the names that left its package, and with those that came."""
        package = module_of(path)
        if package.split(".")[0] == "hfa":
            return text
        tree = ast.parse(text)
        edits = Edits(text)
        for node in tree.body:
            if isinstance(node, ast.ImportFrom):
                base = self._absolute(node, package, True)
                if base.split(".")[0] != package:
                    edits.node(node, "")
        text = edits.done()
        first = (
            next(n for n in ast.parse(text).body if not isinstance(n, ast.Expr))
            if len(ast.parse(text).body) > 1
            else None
        )
        lines = text.splitlines(keepends=True)
        lines.insert(
            first.lineno - 1 if first else len(lines), "".join(self.stub_adds.get(package, []))
        )
        return "".join(lines)

    def _merged(self, new: str, parts: list[tuple[str, str, str]]) -> str:
        new_module = module_of(new)
        ready: list[tuple[str, Source, str]] = []
        for old, text, label in parts:
            old_module = module_of(old)
            renames = dict(self.piece_renames.get((new, label), {}))
            text = renamed(text, renames, label)
            drops = self.piece_drops.get((new, label), set())
            if drops:
                source = parsed(text)
                source.segments = [
                    s for s in source.segments if not (s.names and set(s.names) <= drops)
                ]
                text = written(source)
            text, local = self.rewritten(
                text, old_module, new_module, f"{new} <- {label}", old.endswith("__init__.py")
            )
            text = renamed(text, local, label)
            ready.append((label, parsed(text), text))
        if len(ready) == 1 and parts[0][0] == parts[0][2]:
            return self._lazy(new, self._with_docstring(new, ready[0][2]))
        # imports of one name to different things
        bound: dict[str, tuple[str, str]] = {}
        defined = {n for _, s, _ in ready for seg in s.segments for n in seg.names}
        for number, (label, source, text) in enumerate(ready):
            aliases = {}
            for statement in [*source.imports, *source.checkers]:
                for node in ast.parse(statement.strip()).body:
                    for alias in node.names:
                        local = alias.asname or alias.name
                        what = (getattr(node, "module", "") or "", alias.name)
                        own = {n for seg in source.segments for n in seg.names}
                        if (local in bound and bound[local] != what) or (local in defined - own):
                            fresh = f"{local}_{Path(label.split(':')[0]).stem}"
                            aliases[local] = (what, fresh)
                        else:
                            bound.setdefault(local, what)
            if aliases:
                note(
                    f"{new}: imports of {label} under another name: { {k: v[1] for k, v in aliases.items()} }"
                )
                text = renamed(text, {k: v[1] for k, v in aliases.items()}, label)
                tree = ast.parse(text)
                edits = Edits(text)
                for node in ast.walk(tree):
                    if isinstance(node, (ast.Import, ast.ImportFrom)):
                        for alias in node.names:
                            local = alias.asname or alias.name
                            if (
                                local in aliases
                                and (getattr(node, "module", "") or "", alias.name)
                                == aliases[local][0]
                            ):
                                edits.node(alias, f"{alias.name} as {aliases[local][1]}")
                text = edits.done()
                ready[number] = (label, parsed(text), text)
        # order: what others read at load stands first; else as in the plan
        merged = Source()
        sources = {label: source for label, source, _ in ready}
        names = {
            label: {n for seg in source.segments for n in seg.names}
            for label, source in sources.items()
        }
        needs: dict[str, set[str]] = {}
        for label, source in sources.items():
            used = set()
            for seg in source.segments:
                used |= names_at_load(seg.node)
            needs[label] = {o for o in sources if o != label and names[o] & used}
        soft: dict[str, set[str]] = {}
        for label, source in sources.items():
            used = (
                set().union(*(loaded_names(s.node) for s in source.segments))
                if source.segments
                else set()
            )
            soft[label] = {o for o in sources if o != label and names[o] & used}
        order: list[str] = []
        waiting = list(sources)
        while waiting:
            free = [l for l in waiting if not (soft[l] & set(waiting) - {l})]
            if not free:
                free = [l for l in waiting if not (needs[l] & set(waiting) - {l})]
            if not free:
                note(f"ORDER in {new}: circle at load among {waiting}")
                free = waiting[:1]
            order.append(free[0])
            waiting.remove(free[0])
        largest = max(ready, key=lambda r: len(r[2]))
        docs = [r for r in ready if r[1].docstring]
        merged.docstring = largest[1].docstring or (docs[0][1].docstring if docs else "")
        dropped = [r[0] for r in docs if r[1].docstring != merged.docstring]
        if dropped:
            note(f"{new}: docstring of {largest[0]}; dropped those of {dropped}")
        merged.future = any(s.future for s in sources.values())
        runtime = {}
        for label in order:
            for statement in sources[label].imports:
                runtime.setdefault(statement.strip())
        merged.imports = [s + "\n" for s in runtime]
        at_run = bindings(merged.imports)
        for label in order:
            for statement in sources[label].checkers:
                kept = without(statement, at_run)
                if kept and kept not in merged.checkers:
                    merged.checkers.append(kept)
        if merged.checkers and "TYPE_CHECKING" not in at_run:
            merged.imports.append("from typing import TYPE_CHECKING\n")
        for label in order:
            merged.segments += sources[label].segments
        tails = [sources[label].tail for label in order if sources[label].tail]
        if tails:
            note(f"{new}: comments at the end of {order}")
            merged.tail = "\n".join(tails)
        return self._lazy(new, self._with_docstring(new, written(merged)))

    def _with_docstring(self, new: str, text: str) -> str:
        if new not in DOCSTRINGS:
            return text
        source = parsed(text)
        rest = (
            text[len(source.docstring) :]
            if source.docstring and text.startswith(source.docstring)
            else text
        )
        return f'"""{DOCSTRINGS[new]}"""\n' + rest

    def _lazy(self, new: str, text: str) -> str:
        for module in LAZY.get(new, ()):
            text = lazily(text, module, new)
        for module in TYPES_ONLY.get(new, ()):
            text = for_checkers(text, module, new)
        return text

    def _write(self, results: dict[str, str | None], gone: set[str]) -> None:
        changed = []
        for old, new in self.moved_others.items():
            Path(new).parent.mkdir(parents=True, exist_ok=True)
            subprocess.run(["git", "mv", old, new], check=True)
        for new, old in self.targets.items():
            source = next((o for o in old if o in gone), None)
            if source and not Path(new).exists():
                Path(new).parent.mkdir(parents=True, exist_ok=True)
                subprocess.run(["git", "mv", source, new], check=True)
        for path, text in results.items():
            if text is not None:
                Path(path).parent.mkdir(parents=True, exist_ok=True)
                Path(path).write_text(text, "utf-8")
                changed.append(path)
        for path in sorted(gone):
            if Path(path).exists() and path not in results:
                subprocess.run(["git", "rm", "-q", "-f", path], check=True)
        subprocess.run(["git", "add", "-A"], check=True)
        python = [p for p in changed if p.endswith((".py", ".pyi"))]
        merged = [n for n in self.targets if n.endswith(".py") and Path(n).exists()]
        ruff = ".venv/bin/ruff"
        subprocess.run(
            [
                ruff,
                "check",
                "-q",
                "--fix",
                "--select",
                "F401,F811",
                *(p for p in python if not p.endswith(".pyi")),
            ],
            check=False,
        )
        stubs = [p for p in python if p.endswith(".pyi")]
        subprocess.run([ruff, "check", "-q", "--fix", "--select", "I", *python], check=False)
        subprocess.run([ruff, "format", "-q", *python], check=False)
        self._reflow(python)
        subprocess.run([ruff, "format", "-q", *python], check=False)
        subprocess.run(["git", "add", "-A"], check=True)
        for package in GONE[self.group]:
            left = subprocess.run(
                ["git", "ls-files", f"extensions/{package}"],
                capture_output=True,
                text=True,
                check=True,
            )
            if left.stdout:
                note(f"LEFT in extensions/{package}: {left.stdout.split()}")

    def _reflow(self, paths: list[str]) -> None:
        """Break lines of docstrings and comments that longer names have made too long."""
        import json

        words = [".venv/bin/ruff", "check", "--select", "E501", "--output-format", "json", *paths]
        found = subprocess.run(words, capture_output=True, text=True, check=False).stdout
        places: dict[str, list[int]] = defaultdict(list)
        for each in json.loads(found):
            places[each["filename"]].append(each["location"]["row"])
        for path, rows in places.items():
            text = Path(path).read_text("utf-8")
            prose = set()
            for token in tokenize.generate_tokens(io.StringIO(text).readline):
                if token.type == tokenize.COMMENT or (
                    token.type == tokenize.STRING and token.string.startswith(('"""', 'r"""'))
                ):
                    prose |= set(range(token.start[0], token.end[0] + 1))
            lines = text.split("\n")
            for row in sorted(rows, reverse=True):
                if row not in prose:
                    note(f"LONG LINE {path}:{row}: {lines[row - 1].strip()}")
                    continue
                at = row - 1
                while len(lines[at]) > BUILTIN_LINE:
                    line = lines[at]
                    begin = re.match(r"\s*(#:? )?", line)[0]
                    cut = line.rfind(" ", len(begin), BUILTIN_LINE + 1)
                    if cut <= len(begin):
                        note(f"LONG LINE {path}:{row}: {line.strip()}")
                        break
                    rest = line[cut + 1 :]
                    lines[at] = line[:cut]
                    following = lines[at + 1]
                    same = re.match(r"\s*(#:? )?", following)[0]
                    is_prose = (
                        following.strip()
                        and same == begin
                        and not re.match(r'\s*(#:? )?(- |"""|\w+: |Raises|>>>)', following)
                    )
                    if is_prose:
                        lines[at + 1] = begin + rest + " " + following[len(begin) :]
                    else:
                        lines.insert(at + 1, begin + rest)
                    at += 1
            Path(path).write_text("\n".join(lines), "utf-8")


def without_presence(text: str, group: int) -> str:
    """Tests without the condition that a package is installed which is now in the core."""
    if group == 7:
        return text
    for name in GONE[group]:
        text = re.sub(r"(needs\([^)]*?)\"hfa_%s\"(,\s*)?" % name, r"\1", text, flags=re.S)
        text = re.sub(r"needs\(([^)]*), \)", r"needs(\1)", text)
        text = re.sub(r'^ *pytest.importorskip\("hfa_%s"[^\n]*\)\n' % name, "", text, flags=re.M)
    text = re.sub(r"^ *@needs\(\s*\)\n", "", text, flags=re.M)
    return text


def names_at_load(node: ast.AST) -> set[str]:
    """Names that a statement reads when its module is loaded."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
        found = set()
        for each in [
            *node.decorator_list,
            *node.args.defaults,
            *(d for d in node.args.kw_defaults if d),
        ]:
            found |= loaded_names(each)
        return found
    if isinstance(node, ast.ClassDef):
        found = set()
        for each in [*node.decorator_list, *node.bases, *node.keywords]:
            found |= loaded_names(each)
        for each in node.body:
            if isinstance(each, ast.AnnAssign):
                if each.value is not None:
                    found |= loaded_names(each.value)
            else:
                found |= names_at_load(each)
        return found
    if isinstance(node, ast.Lambda):
        return set()
    return loaded_names(node)


def bindings(statements: list[str]) -> set[str]:
    return {
        alias.asname or alias.name
        for statement in statements
        for node in ast.parse(statement.strip()).body
        for alias in node.names
    }


def without(statement: str, names: set[str]) -> str:
    """An import statement without some of its names."""
    (node,) = ast.parse(statement.strip()).body
    kept = [a for a in node.names if (a.asname or a.name) not in names]
    if not kept:
        return ""
    node.names = kept
    return ast.unparse(node)


def lazily(text: str, module: str, where: str) -> str:
    """The text with the names of a module imported in the functions that read them."""
    source = parsed(text)
    names: dict[str, str] = {}
    kept = []
    for statement in source.imports:
        (node,) = ast.parse(statement.strip()).body
        if isinstance(node, ast.ImportFrom) and node.module == module:
            for alias in node.names:
                names[alias.asname or alias.name] = (
                    f"{alias.name} as {alias.asname}" if alias.asname else alias.name
                )
        else:
            kept.append(statement)
    if not names:
        note(f"LAZY: {where} imports nothing of {module}")
        return text
    source.imports = kept
    text = written(source)
    tree = ast.parse(text)
    lines = text.splitlines(keepends=True)
    inserts: dict[int, str] = {}
    only_types = set(names)

    class Find(ast.NodeVisitor):
        def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
            used = set()
            for each in node.body:
                used |= loaded_names(each) & set(names)
            inner = [n for n in ast.walk(node) if isinstance(n, ast.FunctionDef) and n is not node]
            if used:
                only_types.difference_update(used)
                first = node.body[0]
                is_doc = (
                    isinstance(first, ast.Expr)
                    and isinstance(first.value, ast.Constant)
                    and isinstance(first.value.value, str)
                )
                at = node.body[1] if is_doc and len(node.body) > 1 else first
                line = first_line(at) - 1
                inside = ", ".join(names[n] for n in sorted(used))
                inserts[line] = " " * at.col_offset + f"from {module} import {inside}\n\n"

    Find().visit(tree)
    loads = set()
    for each in tree.body:
        loads |= names_at_load(each) & set(names)
    if loads:
        note(f"LAZY: {where} reads {loads} of {module} when loaded")
    for line, statement in sorted(inserts.items(), reverse=True):
        lines.insert(line, statement)
    text = "".join(lines)
    every = set()
    annotated = set(names)
    source = parsed(text)
    inside = ", ".join(names[n] for n in sorted(annotated))
    source.checkers.append(f"from {module} import {inside}")
    if "TYPE_CHECKING" not in bindings(source.imports):
        source.imports.append("from typing import TYPE_CHECKING\n")
    source.future = True
    return written(source)


def for_checkers(text: str, module: str, where: str) -> str:
    """The text with the names of a module imported for type checkers alone."""
    source = parsed(text)
    kept, moved = [], []
    for statement in source.imports:
        (node,) = ast.parse(statement.strip()).body
        if isinstance(node, ast.ImportFrom) and node.module == module:
            moved.append(statement.strip())
        else:
            kept.append(statement)
    if not moved:
        note(f"TYPES_ONLY: {where} imports nothing of {module}")
        return text
    source.imports = kept
    source.checkers += moved
    if "TYPE_CHECKING" not in bindings(source.imports):
        source.imports.append("from typing import TYPE_CHECKING\n")
    source.future = True
    return written(source)


if __name__ == "__main__":
    for number in sys.argv[1:]:
        print(f"group {number}")
        Move(int(number)).run()
        if int(number) in FIXES:
            subprocess.run(["bash", "-c", FIXES[int(number)]], check=True)
