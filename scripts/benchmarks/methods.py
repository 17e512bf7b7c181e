"""The methods compared: one line each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from benchmarks.data import MAXIMUM_GAP, Case
from benchmarks.frame import declared
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise
from mbaid_ros.core.sensors.levels import FoundNoise
from mbaid_ros.session.methods import make_estimator


@dataclass(frozen=True)
class Method:
    """A method: its parameters, and for which cases and how many seeds it runs."""

    settings: Mapping[str, object]
    share: float = 1.0  # of the seeds
    fewest: int = 0  # seeds at least, if there are so many
    papers: bool = False  # a method of the paper takes all velocities, and reports no uncertainty
    finds_noise: bool = False  # the noise is estimated, not declared

    def runs(self, seeds: int, *, plain: bool) -> int:
        """Return for how many seeds it runs; cases that are not plain have few, and run all."""
        if not plain:
            return seeds
        return max(round(self.share * seeds), min(self.fewest, seeds))

    def takes(self, case: Case) -> bool:
        """Return whether it runs for a case."""
        return case.plain or not (self.finds_noise or self.papers)


METHODS = {
    'difference': Method({'method': 'difference'}),
    'trajectory': Method({'method': 'trajectory'}, 0.5, 100),
    'trajectory, noise found': Method({'method': 'trajectory'}, 0.5, 100, finds_noise=True),
    'paper_main': Method({'method': 'paper_main'}, 0.05, 10, papers=True),
    'paper_difference previous': Method(
        {'method': 'paper_difference', 'paper.reference': 'previous'}, 0.05, 10, papers=True
    ),
    'paper_difference first': Method({'method': 'paper_difference', 'paper.reference': 'first'}, 0.05, 10, papers=True),
}


@dataclass(frozen=True)
class Identification:
    """A robot that is exactly its URDF, ready to be identified by any method."""

    kernel: MomentumKernel
    noise: SensorNoise
    momentum: Array  # (6,) true total, of which paper_main is given the angular part

    def identifier(self, method: str, settings: Mapping[str, object] | None = None) -> Identifier:
        """Return a method before its first measurement."""
        values: dict[str, object] = {
            **EXACT,
            'paper.total_angular_momentum': [float(value) for value in self.momentum[3:]],
            **declared(self.noise),
            **METHODS[method].settings,
            **(settings or {}),
        }
        config = build(EstimatorConfig, values)
        found = FoundNoise(self.noise, self.kernel.model.joints, estimate=METHODS[method].finds_noise)
        return Identifier(make_estimator(config, self.kernel), config.window, MAXIMUM_GAP, noise=found)

    def estimates(self, method: str, joints: JointStream, base: BaseStream) -> list[Estimate]:
        """Return all estimates of one run."""
        return self.identifier(method).push(joints, base)
