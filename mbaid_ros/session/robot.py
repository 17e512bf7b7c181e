"""The robot of a run: as it is described, and as it has learnt to know itself before a capture."""

from __future__ import annotations

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.capture import Capture, CaptureEstimator, Phase
from mbaid_ros.core.intake.attached_frame import AttachedFrame
from mbaid_ros.core.results.debris import Debris, debris
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.inertia import physical
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import RobotModel, load_model
from mbaid_ros.core.robot.urdf_values import change_inertial, joints_moved
from mbaid_ros.session.frames import PRINCIPAL, debris_frame, marker_frame
from mbaid_ros.session.known import known_side, with_known_errors
from mbaid_ros.session.surroundings import storage


class Robot:
    """The robot, and the body that it holds beside it.

    Parameters
    ----------
    config : EstimatorConfig
    urdf : text of the robot description

    Attributes
    ----------
    model : as it is described
    target_link : name of the link whose inertia is identified
    described : momentum of the robot as it is described
    known : how well a calibration has all of it known; None where the parameters say how well
    marker : where the frame of the odometry is on the base, where the parameters say so

    Raises
    ------
    ModelError, ParameterError
        The robot, the target link or a combination of parameters cannot be used.
    """

    def __init__(self, config: EstimatorConfig, urdf: str) -> None:
        self._report_debris = config.debris.report
        self._in_principal_axes = config.debris.frame == PRINCIPAL
        self.model = load_model(urdf, config.base_link)
        self._written: tuple[RobotModel, str] = (self.model, urdf)  # what `urdf` was last asked for
        self.target_link = config.target_link or self.model.last_link
        kernel = MomentumKernel(self.model, self.target_link).storing(storage(config.wheels, self.model))
        self.described, self._link_covariance = with_known_errors(kernel, config.known_links)
        # The file is read but once: a run that starts again goes on with what it was started with.
        self.known = known_side(config, self.described) if config.known_links.calibration else None
        self.marker: AttachedFrame | None = marker_frame(config)
        self._debris_frame = debris_frame(config.debris.frame, self.model, kernel.target)
        self._capture: CaptureEstimator | None = None

    def begin(self, capture: CaptureEstimator | None) -> None:
        """Begin a run: with a capture to come, which the robot may learn to know itself before, or after it (None)."""
        self._capture = capture

    @property
    def kernel(self) -> MomentumKernel:
        """The robot's momentum as it is known now, and how well."""
        return self.described if self._capture is None else self._capture.kernel

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of what is read: the joints that follow no other, and what stores momentum."""
        return (*self.model.independent_joints, *self.described.storage.names)

    @property
    def phase(self) -> Phase:
        """Where the run is: before the capture, in it, or after it."""
        return 'post_capture' if self._capture is None else self._capture.phase

    @property
    def calibrated(self) -> str:
        """What the robot has learnt of itself before the capture, in a line; empty where nothing."""
        learnt = None if self._capture is None else self._capture.handover
        return '' if learnt is None else learnt.told

    @property
    def urdf(self) -> str:
        """The robot description, with what the robot has learnt of itself before the capture."""
        if self._written[0] is not self.kernel.model:
            model, text = self.kernel.model, self.model.urdf
            for old, new in zip(self.model.links, model.links, strict=True):
                if new.parameters is not old.parameters:
                    text = change_inertial(text, new.name, physical(new.parameters))
            text = joints_moved(text, self.model, model)
            self._written = model, text
        return self._written[1]

    def debris(self, estimate: Estimate) -> Debris | None:
        """Return the captured body alone, where that is asked for and determined: the estimate less the URDF's link."""
        if not self._report_debris:
            return None
        learnt = None if self._capture is None else self._capture.handover
        return debris(
            estimate,
            self.kernel.target.parameters,
            self._debris_frame,
            in_principal_axes=self._in_principal_axes,
            link_covariance=self._link_covariance if learnt is None else learnt.link_covariance,
        )

    def captured(self, estimate: Estimate) -> Capture | None:
        """Return what the capture tells with the latest estimate, None while there was none."""
        if self._capture is None:
            return None
        target = self.kernel.target
        alone = debris(estimate, target.parameters, debris_frame('', self.model, target))
        return self._capture.capture(None if alone is None else alone.parameters)
