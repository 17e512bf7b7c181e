"""The methods compared: one line each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from benchmarks.data import MAXIMUM_GAP, Case
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.model_errors import EXACT
from mbaid_ros.config.parameters import build
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.identifier import Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import BaseStream, JointStream, SensorNoise
from mbaid_ros.core.sensors.levels import FoundNoise
from mbaid_ros.session import make_estimator


@dataclass(frozen=True)
class Method:
    """A method of the registry.

    Attributes
    ----------
    settings : what it is told besides the noise; the true total angular momentum it gets if it has to be told one
    share, fewest : it runs for that share of the seeds, but for no fewer than those, as far as there are: to tell
        factors of a hundred apart takes few
    papers : whether it is the paper's: it takes every velocity as it comes, and reports no uncertainty
    extra : whether it is only run where it is asked for
    finds_noise : whether it is not told how noisy the sensors are, but finds it
    """

    settings: Mapping[str, object]
    share: float = 1.0
    fewest: int = 0
    papers: bool = False
    extra: bool = False
    finds_noise: bool = False

    def runs(self, seeds: int, *, plain: bool) -> int:
        """Return how many of some seeds it runs for; of cases that are not plain, which have few, for all."""
        if not plain and not self.papers:
            return seeds
        return max(round(self.share * seeds), min(self.fewest, seeds))

    def takes(self, case: Case) -> bool:
        """Tell whether it is run for a case: the paper's take all sensors, what noise is found in is plain."""
        if self.finds_noise:
            return case.plain
        return not self.papers or case.plain or bool(case.drift or case.offset)


METHODS = {
    'difference': Method({'method': 'difference'}),
    'trajectory': Method({'method': 'trajectory'}, 0.5, 100),
    'trajectory, noise found': Method({'method': 'trajectory'}, 0.5, 100, finds_noise=True),
    'difference unasked': Method({'method': 'difference', 'convergence.identifiable_std': 1e3}, extra=True),
    'paper_main': Method({'method': 'paper_main'}, 0.05, 10, papers=True),
    'paper_difference previous': Method(
        {'method': 'paper_difference', 'paper.reference': 'previous'}, 0.05, 10, papers=True
    ),
    'paper_difference first': Method({'method': 'paper_difference', 'paper.reference': 'first'}, 0.05, 10, papers=True),
}


@dataclass(frozen=True)
class Identification:
    """One method at work on one robot.

    Attributes
    ----------
    kernel : of the robot
    noise : of its sensors
    momentum : (6,) the true total, of which paper_main is given L_0
    """

    kernel: MomentumKernel
    noise: SensorNoise
    momentum: Array

    def identifier(self, method: str, settings: Mapping[str, object] | None = None) -> Identifier:
        """Return a method of the registry, ready for its first measurement."""
        values: dict[str, object] = {
            **EXACT,  # as the simulated robots are
            'paper.total_angular_momentum': [float(value) for value in self.momentum[3:]],
            **{f'noise.{name}': value for name, value in vars(self.noise).items()},
            **METHODS[method].settings,
            **(settings or {}),
        }
        config = build(EstimatorConfig, values)
        found = FoundNoise(self.noise, self.kernel.model.joints, estimate=METHODS[method].finds_noise)
        return Identifier(make_estimator(config, self.kernel), config.window, MAXIMUM_GAP, noise=found)

    def estimates(self, method: str, joints: JointStream, base: BaseStream) -> list[Estimate]:
        """Return all estimates of one run."""
        return self.identifier(method).push(joints, base)
