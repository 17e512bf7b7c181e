"""The exported parameters in a run of Basilisk (`pip install bsk`): the momentum is that of the identified body."""

from __future__ import annotations

import json
import runpy
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from made_runs import BODY, run
from mbaid_ros.core.geometry import unvec
from mbaid_ros.replay.arguments import export as main
from mbaid_ros.replay.json_output import as_json

pytest.importorskip('Basilisk', reason='Basilisk is not installed (pip install bsk)')

RATE = np.array([0.1, -0.2, 0.3])  # rad/s


def exported(folder: Path, form: str) -> dict[str, Any]:
    result, code = folder / 'result.json', folder / 'captured.py'
    result.write_text(json.dumps(as_json(run())), encoding='utf-8')
    assert main([str(result), '--format', form, '--output', str(code)]) == 0
    return runpy.run_path(str(code))


def column(values: np.ndarray[Any, Any]) -> list[list[float]]:
    return [[float(value)] for value in values]


def test_a_hub_with_the_parameters_has_and_keeps_the_momentum(tmp_path: Path) -> None:
    values = exported(tmp_path, 'basilisk-hub')
    craft = import_module('Basilisk.simulation.spacecraft').Spacecraft()
    for name in ('mHub', 'r_BcB_B', 'IHubPntBc_B'):
        setattr(craft.hub, name, values[name])
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit, craft.hub.sigma_BNInit = (column(np.zeros(3)) for _ in range(3))
    craft.hub.omega_BN_BInit = column(RATE)
    simulation = import_module('Basilisk.utilities.SimulationBaseClass').SimBaseClass()
    seconds = import_module('Basilisk.utilities.macros').sec2nano
    simulation.CreateNewProcess('process').addTask(simulation.CreateNewTask('task', seconds(0.01)))
    log = craft.logger('totRotAngMomPntC_N')
    for model in (craft, log):
        simulation.AddModelToTask('task', model)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(seconds(5.0))
    simulation.ExecuteSimulation()
    expected = unvec(BODY[4:]) @ RATE
    for momentum in np.array(log.totRotAngMomPntC_N)[1:]:  # the first is logged before the first step
        assert momentum == pytest.approx(expected, rel=1e-9)


def test_a_spinning_body_takes_the_parameters(tmp_path: Path) -> None:
    values = exported(tmp_path, 'basilisk-effector')
    module = import_module('Basilisk.simulation.spinningBodyOneDOFStateEffector')
    effector = module.SpinningBodyOneDOFStateEffector()
    for name in ('mass', 'r_ScS_S', 'IPntSc_S'):
        setattr(effector, name, values[name])
    assert np.array_equal(np.array(effector.IPntSc_S), unvec(BODY[4:]))
