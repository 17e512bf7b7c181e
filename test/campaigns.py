"""A small campaign of the paper's case, for the tests of what reads and makes campaigns."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from checked import answer
from mbaid_ros.replay.arguments import campaign
from simulated import CONFIG

refused = partial(answer, campaign, code=2)
FILES = f"""
model: {CONFIG / 'table1.urdf'}
simulator_params: {CONFIG / 'table1_simulator.yaml'}
estimator_params: {CONFIG / 'table1_estimator.yaml'}
"""
TEXT = f"""{FILES}
simulator: {{duration: 5.0, joint_rate: 20.0, odometry_rate: 20.0}}
noise: {{base_position: 1e-4}}
seeds: 4
cases:
  noise:
    low: {{noise: {{joint_position: 1.0e-5}}}}
    mid: {{noise: {{joint_position: 1.0e-4}}}}
"""


def written(folder: Path, text: str = TEXT) -> Path:
    path = folder / 'campaign.yaml'
    path.write_text(text)
    return path
