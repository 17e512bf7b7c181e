"""From parameters to the method of identification they name."""

from __future__ import annotations

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.difference.estimator import DifferenceEstimator, DifferenceSettings
from mbaid_ros.core.difference.problem import Beside
from mbaid_ros.core.identifier import Estimator
from mbaid_ros.core.paper.estimator import PaperEstimator, PaperSettings
from mbaid_ros.core.results.reporting import Reporting
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.scale import unknown_scale
from mbaid_ros.core.samples import SensorNoise
from mbaid_ros.core.trajectory.estimator import TrajectoryEstimator, TrajectorySettings


def make_estimator(config: EstimatorConfig, kernel: MomentumKernel) -> Estimator:
    """Return the method that the parameters name.

    Raises
    ------
    ParameterError
        The method lacks a parameter.
    """
    convergence = config.convergence
    noise = SensorNoise(**vars(config.noise))
    reporting = Reporting(
        scale=unknown_scale(kernel)[:10],
        identifiable_std=convergence.identifiable_std,
        converged_std=convergence.relative_std,
        length=convergence.length,
        largest_residual=convergence.largest_residual,
    )
    if config.method == 'trajectory':
        return TrajectoryEstimator(
            kernel,
            TrajectorySettings(
                noise=noise,
                window=config.window,
                start=config.trajectory.start_windows,
                kept=config.trajectory.kept_windows,
                time_offset_std=config.time_offset.prior_std if config.time_offset.estimate else 0.0,
                adapt=config.trajectory.adapt,
                known_std=config.known_links.relative_std,
            ),
            reporting,
        )
    if config.method == 'difference':
        return DifferenceEstimator(
            kernel,
            DifferenceSettings(
                noise=noise,
                kept_windows=config.difference.kept_windows,
                forgetting_time=config.difference.forgetting_time,
                window=config.window,
                beside=Beside(
                    linear_momentum_std=config.momentum.linear_prior_std,
                    constant='none',
                    known_std=(0.0,) * len(kernel.known),
                    known_mode='consider',
                ),
            ),
            reporting,
        )
    paper = config.paper
    return PaperEstimator(
        kernel,
        PaperSettings(
            form='main' if config.method == 'paper_main' else 'difference',
            forgetting_factor=paper.forgetting_factor,
            initial_covariance=paper.initial_covariance,
            reference='first' if paper.reference == 'first' else 'previous',
            lag=paper.lag,
            total_angular_momentum=paper.total_angular_momentum,
            settled=convergence.relative_std,
            length=convergence.length,
        ),
    )
