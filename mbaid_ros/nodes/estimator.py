"""The estimator as a managed node: configured it has read the robot, activated it takes data."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from mbaid_ros.cli import run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import named_specifications, specification_of, specifications
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.nodes.estimating import Estimating
from mbaid_ros.nodes.parameters import changed, declare_parameters
from mbaid_ros.nodes.runner import estimator_arguments, own_arguments, ros, spin


class ManagedEstimatorNode(LifecycleNode):
    """Identifies while it is active.

    `configure` reads the parameters, which may be set until then, and the robot; `activate` and `deactivate` begin and
    end to take data; `cleanup` forgets everything.

    Parameters
    ----------
    name : of the node

    Raises
    ------
    ParameterError
        A parameter cannot be used.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        declare_parameters(self, EstimatorConfig, settable=True)
        self._estimating: Estimating | None = None
        self.add_on_set_parameters_callback(self._on_parameters)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and robot; fail, with the reason in the log, where these cannot be used."""
        try:
            self._estimating = Estimating(self, changed(self, EstimatorConfig, []), active=False)
        except MbaidError as error:
            self.get_logger().error(str(error))  # type: ignore[no-untyped-call]
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to take data."""
        return self._switch(super().on_activate(state), active=True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End to take data; what has been learnt stays."""
        return self._switch(super().on_deactivate(state), active=False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget everything and leave the graph but for the node itself."""
        self._close()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End for good."""
        self._close()
        return super().on_shutdown(state)

    def _switch(self, result: TransitionCallbackReturn, *, active: bool) -> TransitionCallbackReturn:
        if self._estimating is not None:
            self._estimating.activate(active=active)
        return result

    def _close(self) -> None:
        if self._estimating is not None:
            self._estimating.close()
            self._estimating = None

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Take anything before `configure`, and what may change at run time after it."""
        known, of_things = specifications(EstimatorConfig), tuple(named_specifications(EstimatorConfig).values())
        try:
            config = changed(self, EstimatorConfig, parameters)
            if self._estimating is not None:
                specs = (specification_of(each.name, known, of_things) for each in parameters)
                fixed = [spec.name for spec in specs if spec is not None and spec.read_only]
                if fixed:
                    reason = f"'{fixed[0]}' is read when the node is configured: clean up first"
                    return SetParametersResult(successful=False, reason=reason)
                self._estimating.adjust(config)
        except MbaidError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


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
