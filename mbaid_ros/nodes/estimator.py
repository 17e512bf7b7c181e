"""The executable `estimator`: a plain node, or a managed one that is configured, then activated."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from mbaid_ros.cli import run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import specification_of
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.nodes.arguments import estimator_arguments
from mbaid_ros.nodes.estimating import LiveEstimator
from mbaid_ros.nodes.runner import changed, declare_parameters, own_arguments, ros, spin

NAME = 'estimator'


class EstimatorNode(Node):
    """Identifies from its start on.

    Raises ParameterError, ModelError: A parameter, or the robot description file it names, cannot be used.
    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._estimator = LiveEstimator(self, declare_parameters(self, EstimatorConfig))
        self.add_on_set_parameters_callback(self._on_parameters)

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Change parameters at run time; the others are read-only."""
        try:
            self._estimator.adjust(changed(self, EstimatorConfig, parameters))
        except MbaidError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


class ManagedEstimatorNode(LifecycleNode):
    """Identifies while it is active.

    `configure` reads the parameters, which may be set until then, and the robot; `activate` and `deactivate` begin and
    end to use messages; `cleanup` forgets everything.

    Raises ParameterError: A parameter cannot be used.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        declare_parameters(self, EstimatorConfig, settable=True)
        self._estimator: LiveEstimator | None = None
        self.add_on_set_parameters_callback(self._on_parameters)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read parameters and robot; fail, with the reason in the log, if these cannot be used."""
        try:
            self._estimator = LiveEstimator(self, changed(self, EstimatorConfig, []), active=False)
        except MbaidError as error:
            self.get_logger().error(str(error))  # type: ignore[no-untyped-call]
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to use messages."""
        return self._switch(super().on_activate(state), active=True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End to use messages; the run stays."""
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
        if self._estimator is not None:
            self._estimator.activate(active=active)
        return result

    def _close(self) -> None:
        if self._estimator is not None:
            self._estimator.close()
            self._estimator = None

    def _on_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Change any parameter before `configure`, and the run-time ones after it."""
        try:
            config = changed(self, EstimatorConfig, parameters)
            if self._estimator is not None:
                specs = (specification_of(each.name, EstimatorConfig) for each in parameters)
                fixed = [spec.name for spec in specs if spec is not None and spec.read_only]
                if fixed:
                    reason = f"'{fixed[0]}' is read when the node is configured: clean up first"
                    return SetParametersResult(successful=False, reason=reason)
                self._estimator.adjust(config)
        except MbaidError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)


def _main(argv: list[str]) -> int:
    arguments = estimator_arguments().parse(own_arguments(argv))
    with ros(argv) as interrupt:
        node: Node = ManagedEstimatorNode(NAME) if arguments.lifecycle else EstimatorNode()
        spin(node, lambda: interrupt.requested)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run the node and return the exit code."""
    return run(_main, argv, name=NAME)


if __name__ == '__main__':
    sys.exit(main())
