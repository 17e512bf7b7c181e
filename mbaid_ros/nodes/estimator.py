"""The node `estimator`, by itself or managed (a lifecycle node)."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from mbaid_ros.cli import run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.nodes.arguments import estimator_arguments
from mbaid_ros.nodes.estimating import Estimating
from mbaid_ros.nodes.parameters import changed, declare_parameters
from mbaid_ros.nodes.runner import own_arguments, ros, spin

NAME = 'estimator'


class EstimatorNode(Node):
    """Identifies from its start on.

    Raises
    ------
    ParameterError, ModelError
        A parameter, or the robot description file it names, cannot be used.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._estimating = Estimating(self, declare_parameters(self, EstimatorConfig))
        self.add_on_set_parameters_callback(self._on_parameters)

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take what may change at run time; everything else is read-only."""
        try:
            self._estimating.adjust(changed(self, EstimatorConfig, parameters))
        except MbaidError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def _managed() -> Node:
    from mbaid_ros.nodes.managed import ManagedEstimatorNode  # noqa: PLC0415 - brings message packages of its own

    node: Node = ManagedEstimatorNode(NAME)
    return node


def _main(argv: list[str]) -> int:
    arguments = estimator_arguments().parse(own_arguments(argv))
    with ros(argv) as interrupt:
        spin(_managed() if arguments.lifecycle else EstimatorNode(), lambda: interrupt.requested)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node and return the exit code."""
    return run(_main, argv, name=NAME)


if __name__ == '__main__':
    sys.exit(main())
