"""The robot of a session, with its target link and the captured body; and the collision meshes of its description."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote

import coal
import numpy as np

from mbaid_ros import limits
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.capture.estimator import CaptureEstimator
from mbaid_ros.core.capture.known_momentum import Capture
from mbaid_ros.core.errors import ModelError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import CapturePhase, Debris, Estimate, debris
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf_document import captured_stderr
from mbaid_ros.core.sensors.base import AttachedFrame
from mbaid_ros.core.trajectory.solution import joints_carrying_target
from mbaid_ros.files import require_regular
from mbaid_ros.session.known_robot import nominal_model, with_known_errors
from mbaid_ros.session.settings import marker_frame, springs, storage

_PACKAGE, _FILE = 'package://', 'file://'
_HALF_A_PERIOD = 0.35  # half periods by which a window may differ from one


def mesh_points(name: str) -> Array:
    """Return the vertices (V, 3) of a mesh, in the units of its file.

    Raises ModelError: There is no such file, or it cannot be read.

    Parameters
    ----------
    name : as a robot description has it: package://, file:// or a path that is not relative
    """
    path = _path(name)
    require_regular(path, 'mesh', ModelError)
    if path.stat().st_size > limits.MESH_BYTES:
        raise ModelError(f"mesh '{name}' has more than {limits.MESH_BYTES} bytes, which is the limit")
    try:
        with captured_stderr([]):
            return np.asarray(coal.MeshLoader().load(str(path), np.ones(3)).vertices())
    except (ValueError, RuntimeError) as error:
        lines = [line for line in str(error).splitlines() if not line.startswith('Hint:')]
        raise ModelError(f"mesh '{name}' cannot be read: {lines[-1]}") from error


def _path(name: str) -> Path:
    """Return where a mesh is."""
    path = Path(unquote(name.removeprefix(_FILE)))
    if name.startswith(_PACKAGE):
        package, _, rest = name.removeprefix(_PACKAGE).partition('/')
        shares = [Path(prefix) / 'share' / package for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(':')]
        share = next((each for each in shares if each.is_dir()), None)
        if share is None:
            raise ModelError(f"mesh '{name}': AMENT_PREFIX_PATH has no package '{package}'")
        return share / unquote(rest)
    if not path.is_absolute():
        raise ModelError(f"mesh '{name}' is relative; accepted: package://, file:// or an absolute path")
    return path


class Robot:
    """The robot of a session.

    Raises ModelError, ParameterError: The robot, the target link or a combination of parameters cannot be used.

    Parameters
    ----------
    urdf : text of the robot description

    Attributes
    ----------
    urdf, model : the robot description
    target_link : name of the link whose inertia is identified
    kernel : its momentum, with the uncertainty of its bodies
    window : length of windows, s: twice the declared one where that is about half a period of a passive joint that
        carries the target, because the swing that encoder noise drives then alternates from window to window
    known : nominal model of a calibration file; None without one
    marker : frame of the odometry on the base, if the parameters place one
    """

    def __init__(self, config: EstimatorConfig, urdf: str) -> None:
        self._report_debris = config.debris.report
        self.model = load_model(urdf, config.base_link)
        self.urdf = urdf
        self.target_link = config.target_link or self.model.last_link
        kernel = MomentumKernel(self.model, self.target_link).with_storage(storage(config.wheels, self.model))
        kernel = kernel.with_springs(springs(config.flexible, self.model))
        halves = kernel.springs.frequency[joints_carrying_target(kernel)] * config.window / np.pi
        self.window = (2.0 if np.any(np.abs(halves - 1.0) < _HALF_A_PERIOD) else 1.0) * config.window
        self.kernel, self._link_covariance = with_known_errors(kernel, config.known_links)
        # Read once: a run that starts again keeps its calibration.
        self.known = nominal_model(config, self.kernel) if config.known_links.calibration else None
        self.marker: AttachedFrame | None = marker_frame(config.marker)
        self._capture: CaptureEstimator | None = None

    def begin(self, capture: CaptureEstimator | None) -> None:
        """Begin a run, which has a capture to come or None."""
        self._capture = capture

    @property
    def readings(self) -> tuple[str, ...]:
        """Names of the readings: independent joints, then stored momenta."""
        return (*self.model.independent_joints, *self.kernel.storage.names)

    @property
    def phase(self) -> CapturePhase:
        """Phase of the run relative to the capture."""
        return 'post_capture' if self._capture is None else self._capture.phase

    def debris(self, estimate: Estimate) -> Debris | None:
        """Return the captured body alone: the estimate less the URDF's link; None if not wanted or not determined."""
        if not self._report_debris:
            return None
        return debris(estimate, self.kernel.target.parameters, self._link_covariance)

    def captured(self, estimate: Estimate) -> Capture | None:
        """Return the momenta at the capture, given the latest estimate; None before a capture."""
        if self._capture is None:
            return None
        alone = debris(estimate, self.kernel.target.parameters)
        return self._capture.capture(None if alone is None else alone.parameters)
