"""The robot of a session: what its description and its declarations make."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from urllib.parse import unquote

import coal
import numpy as np
from scipy.linalg import block_diag

from mbaid_ros import limits
from mbaid_ros.config.calibration_file import CalibrationFile, read_calibration
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.capture import Capture, CaptureEstimator
from mbaid_ros.core.contracts import Unknown, diagonal, uncertain
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.joints.model import joint_placements
from mbaid_ros.core.links import (
    KnownLinksConfig,
    TotalMass,
    calibrated_errors,
    declared_errors,
    independent_errors,
    known_bodies,
    link_deviations,
    links_to_bodies,
)
from mbaid_ros.core.odometry.model import marker_frame, odometry_mount
from mbaid_ros.core.odometry.stream import AttachedFrame
from mbaid_ros.core.passive import joints_carrying_target, springs
from mbaid_ros.core.results.estimate import CapturePhase, Estimate
from mbaid_ros.core.robot.body import body_sizes
from mbaid_ros.core.robot.model import Link, RobotModel, load_model
from mbaid_ros.core.robot.momentum import KnownErrors, MomentumKernel
from mbaid_ros.core.robot.urdf import captured_stderr
from mbaid_ros.core.state import Declared, UnknownsPrior
from mbaid_ros.core.target import Debris, debris, described_prior
from mbaid_ros.core.wheels import storage
from mbaid_ros.errors import ModelError, ParameterError, listing
from mbaid_ros.files import require_regular
from mbaid_ros.session.catalogue import declaration, is_exact

_LEAST_STD = 1e-6  # least standard deviation of a number in its unit: exact beside others of the same unknown
# Largest difference between the two files, which have 12 digits: of a body, relative to its typical size; of a joint's
# frame, m or rad.
_SAME = 1e-6
_ACCEPTED = 'accepted: the URDF that calibrate --output wrote with it'
_PACKAGE, _FILE = 'package://', 'file://'
_MISWEIGHED = 4.0  # standard deviations between weighed and described mass from which a warning names both
_HALF_A_PERIOD = 0.35  # half periods by which a window may differ from one


@dataclass(frozen=True, eq=False)
class CalibratedModel:
    """A calibration beside the robot description, which has its bodies, origins and axes already."""

    links: tuple[Link, ...]  # k of them
    zeros: Array  # (n,) as of a NominalModel
    mount: Array  # (6,) as of a NominalModel
    # (10 k + 6 n + 6,) squared: standard parameters of the links, each in its own frame; of each joint zero,
    # displacement of its frame and tilts of its axis; mount
    covariance: Array

    def with_kernel(
        self, kernel: MomentumKernel, declared: Iterable[Unknown], *, located: bool = True
    ) -> tuple[MomentumKernel, tuple[Unknown, ...], UnknownsPrior]:
        """Return a kernel with its target, its unknowns and their joint prior: those not calibrated as declared.

        Parameters
        ----------
        declared : all unknowns, in the order of the state
        located : whether poses are measured; nothing is mounted elsewhere than the base's own frame where not
        """
        joints = kernel.model.joints
        bodies, carry = links_to_bodies(self.links, [link.name for link in kernel.unknown])
        whole = block_diag(carry, np.eye(6 * joints + 6))
        covariance, mount = whole @ self.covariance @ whole.T, self.mount
        if not located:
            covariance[-6:] = covariance[:, -6:] = 0.0
            mount = np.zeros(6)
        deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        of_bodies = deviations[: len(carry)]
        each = deviations[len(carry) : -6].reshape(joints, 6)
        zeros, origins, axes = (_size(part) for part in (each[:, :1], each[:, 1:4], each[:, 4:]))
        orientation, position = _size(deviations[-6:].reshape(2, 3))
        units = np.concatenate(
            (
                of_bodies,
                np.column_stack((zeros, *(origins,) * 3, *(axes,) * 2)).ravel(),
                np.repeat((orientation, position), 3),
            )
        )
        values = np.concatenate((np.zeros(len(carry)), np.zeros(6 * joints), mount))
        values[len(carry) : -6 : 6] = self.zeros
        doubted = kernel.with_errors(KnownErrors(bodies, diagonal(of_bodies)))
        robot = uncertain(
            known_bodies(doubted.model, doubted.errors, unknown=[link.name for link in kernel.unknown]),
            joint_placements(doubted, zeros.tolist(), origins.tolist(), axes.tolist(), independent=True),
        )
        of_odometry = uncertain(odometry_mount(float(position), float(orientation)))
        others = [each for each in declared if not each.calibrated]
        predicted, read = (tuple(each for each in others if each.of_measurement is which) for which in (False, True))
        known = _gaussian(values, covariance, units)
        known = known.extended(_count(predicted), before=_count(robot))
        known = known.extended(_count(read), before=len(known.mean))
        return doubted, (*robot, *predicted, *of_odometry, *read), known


def _count(unknowns: Iterable[Unknown]) -> int:
    return sum(unknown.count for unknown in unknowns)


def _size(deviations: Array) -> Array:
    """Return the root mean square of each row."""
    return np.sqrt(np.mean(deviations**2, axis=-1))


def _gaussian(values: Array, covariance: Array, units: Array) -> UnknownsPrior:
    """Return numbers in their units with a factor of their covariance; those without a unit are left out."""
    uncertain = units > 0.0
    own = units[uncertain]
    scaled = covariance[np.ix_(uncertain, uncertain)] / own / own[:, None]
    size = np.maximum(np.sqrt(np.maximum(np.diag(scaled), 0.0)), _LEAST_STD)
    eigenvalues, vectors = np.linalg.eigh(scaled / size / size[:, None])
    return UnknownsPrior(values[uncertain] / own, size[:, None] * vectors * np.sqrt(np.maximum(eigenvalues, 0.0)))


@dataclass(frozen=True, eq=False)
class KnownRobot:
    """The nominal model with its uncertainty, as the trajectory filter needs it."""

    kernel: MomentumKernel  # with the errors of its known bodies, as the unknowns have them
    declared: Declared


def with_known_errors(kernel: MomentumKernel, config: KnownLinksConfig) -> tuple[MomentumKernel, Array | None]:
    """Return a kernel with the errors of its known bodies, and the covariance of the target link's own parameters.

    The covariance is (10, 10) of (m, h, I_o) in the target link's frame, None where they count as exact.

    Raises ParameterError: The parameters contradict each other or the robot, or the calibration cannot be used.
    """
    link = kernel.target.parameters
    if not config.calibration:
        given = config.links.get(kernel.target.name)
        own = {0: link_deviations(link, config, given)} if given and link[0] > 0.0 else {}
        target = independent_errors(link[None], config.relative_std, own)
        return kernel.with_errors(declared_errors(kernel, config)), target.covariance if target.count else None
    found = _calibration(kernel.model, config)
    count = 10 * len(found.links)
    links = [kernel.model.link(name) for name in found.links]
    errors = calibrated_errors(links, found.covariance[:count, :count], [link.name for link in kernel.unknown])
    place = 10 * found.links.index(kernel.target.name) if kernel.target.name in found.links else None
    alone = None if place is None else found.covariance[place : place + 10, place : place + 10]
    return kernel.with_errors(errors), alone


def nominal_model(config: EstimatorConfig, kernel: MomentumKernel) -> KnownRobot:
    """Return the nominal model of a kernel that has the errors of its known bodies, as declared or calibrated.

    Raises ParameterError: The parameters contradict each other or the robot, or the calibration cannot be used.
    """
    as_declared = declaration(config, kernel)
    if not config.known_links.calibration:
        given = config.known_links.links.get(kernel.target.name)
        to_come = config.capture.phase == 'pre_capture' or config.capture.time > 0.0
        if given is not None and not (config.debris.report or to_come):  # otherwise it is of the <inertial> alone
            as_declared = replace(as_declared, target=described_prior(config.target_prior, kernel, given))
        return KnownRobot(kernel, replace(as_declared, total_mass=_mass_without_target(config.known_links, kernel)))
    found = _calibration(kernel.model, config.known_links)
    nominal = CalibratedModel(
        tuple(kernel.model.link(name) for name in found.links),
        found.values[10 * len(found.links) : -6 : 6],
        found.values[-6:],
        found.covariance,
    )
    located = config.by_odometry or config.imu.orientation
    kernel, unknowns, known = nominal.with_kernel(kernel, as_declared.unknowns, located=located)
    return KnownRobot(kernel, replace(as_declared, unknowns=unknowns, joint_prior=known))


def declared_mass(config: KnownLinksConfig) -> TotalMass | None:
    """Return the mass of the whole robot, None where it is not declared; half of a declaration is refused."""
    if (config.total_mass > 0.0) != (config.total_mass_std > 0.0):
        raise ParameterError(
            f"parameters 'known_links.total_mass' and '.total_mass_std' are {config.total_mass:g} kg and "
            f'{config.total_mass_std:g} kg; accepted: both above 0, or none'
        )
    return TotalMass(config.total_mass, config.total_mass_std) if config.total_mass else None


def _mass_without_target(config: KnownLinksConfig, kernel: MomentumKernel) -> TotalMass | None:
    """Return the mass of all bodies but the target, whose own part has the mass of its <inertial>, as declared."""
    total, own = declared_mass(config), kernel.target.parameters
    if total is None or own[0] <= 0.0:
        return total
    given = config.links.get(kernel.target.name, {}).get('mass_relative_std', np.sqrt(2.0) * config.relative_std)
    return TotalMass(total.mass - float(own[0]), float(np.hypot(total.std, given * own[0])))


def contradicted_mass(config: KnownLinksConfig, kernel: MomentumKernel) -> str:
    """Return how a weighed mass contradicts the masses of the robot description; empty where they agree."""
    total = _mass_without_target(config, kernel)
    if total is None or config.calibration:
        return ''
    own, described = float(kernel.target.parameters[0]), float(np.sum(kernel.known[:, 0]))
    std = float(np.hypot(total.std, np.linalg.norm(kernel.errors.factor[::10].sum(axis=0))))
    if abs(total.mass - described) <= _MISWEIGHED * std:
        return ''
    target = f', {own:.4g} kg of it in target link {kernel.target.name!r}' if own > 0.0 else ''
    return (
        f'known_links.total_mass is {config.total_mass:.6g} kg, but the robot description has '
        f'{described + own:.6g} kg{target}: correct the masses; the target link must not contain the captured body'
    )


def _calibration(model: RobotModel, config: KnownLinksConfig) -> CalibrationFile:
    """Return the calibration that the parameters name, of the very robot."""
    found = read_calibration(config.calibration)
    _require_the_same(found, model)
    return found


def _require_the_same(found: CalibrationFile, model: RobotModel) -> None:
    """Refuse a calibration of another robot, or one whose values the robot description does not have."""
    names = [link.name for link in model.links]
    foreign = [name for name in found.links if name not in names]
    if foreign:
        raise ParameterError(
            f"calibration '{found.path}' is of {listing(foreign)}; accepted: links of the robot description: "
            f'{listing(names)}'
        )
    if found.joints != model.joint_names:
        raise ParameterError(
            f"calibration '{found.path}' has the joints {listing(found.joints)}; accepted: those of the robot "
            f'description: {listing(model.joint_names)}'
        )
    for index, name in enumerate(found.links):
        link, values = model.link(name).parameters, found.values[10 * index : 10 * index + 10]
        if not link[0] > 0.0 or np.any(np.abs(link - values) > _SAME * body_sizes(link)):
            raise ParameterError(
                f"link '{name}' has other values in the robot description than in calibration '{found.path}' "
                f'({link[0]:.6g} kg, {values[0]:.6g} kg); {_ACCEPTED}'
            )
    moved = np.linalg.norm(model.positions - found.positions, axis=1)
    turned = np.linalg.norm(model.rotations - found.rotations, axis=(1, 2))
    for name, metres, radians in zip(model.joint_names, moved, turned, strict=True):
        if max(metres, radians) > _SAME:
            raise ParameterError(
                f"joint '{name}' is elsewhere in the robot description than in calibration '{found.path}' "
                f'({metres:.2g} m, {radians:.2g} rad away); {_ACCEPTED}'
            )


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
        self._config = config
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
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs: independent joints, then stored momenta."""
        return (*self.model.independent_joints, *self.kernel.storage.names)

    @cached_property
    def exact(self) -> bool:
        """Whether nothing of the robot is declared uncertain: fault isolation tries single causes, not many small."""
        return self.known is None and is_exact(self._config, self.kernel)

    @property
    def phase(self) -> CapturePhase:
        """Phase of the run relative to the capture."""
        return 'post_capture' if self._capture is None else self._capture.phase

    def debris(self, estimate: Estimate) -> Debris | None:
        """Return the captured body alone: the estimate less the URDF's link; None if not wanted or not determined."""
        if not self._config.debris.report:
            return None
        return debris(estimate, self.kernel.target.parameters, self._link_covariance)

    def captured(self, estimate: Estimate) -> Capture | None:
        """Return the momenta at the capture, given the latest estimate; None before a capture."""
        if self._capture is None:
            return None
        alone = debris(estimate, self.kernel.target.parameters)
        return self._capture.capture(None if alone is None else alone.parameters)
