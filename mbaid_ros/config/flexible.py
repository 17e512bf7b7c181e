"""Passive joints: panels, booms, propellant and grasps that give, each a joint of the URDF with a spring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mbaid_ros.config.parameters import by_name, parameter
from mbaid_ros.core.errors import ParameterError, listing


@dataclass(frozen=True)
class PassiveJointConfig:
    """Spring and damper of a single passive joint, which act towards its zero."""

    frequency: float = parameter(0.0, 'Hz', minimum=0.0, maximum=1e3)
    """Natural frequency of this joint with everything else held still (cantilever); required for every joint of
    flexible.joints."""
    frequency_relative_std: float = parameter(0.05, minimum=0.0, maximum=0.5)
    """Relative standard deviation of the natural frequency; 0: exact."""
    damping: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Damping ratio, a fraction of critical."""
    damping_std: float = parameter(0.01, minimum=0.0, maximum=1.0)
    """Standard deviation of the damping ratio; 0: exact."""
    initial_std: float = parameter(0.05, 'rad', minimum=0.0)
    """Standard deviation of the deflection at the start (m for a prismatic joint); that of the rate follows from the
    frequency. 0: at rest at zero."""
    disturbance_std: float = parameter(1e-4, 'rad', minimum=0.0)
    """Standard deviation of an unmodelled deflection (m for a prismatic joint), as from a nonlinear spring or encoder
    noise. 0: none."""


@dataclass(frozen=True)
class FlexibleConfig:
    """Passive joints."""

    joints: tuple[str, ...] = parameter(())
    """Joints of the URDF that a spring holds and no JointState reports: panels, booms, propellant, a grasp that
    gives."""
    each: Mapping[str, Mapping[str, float]] = by_name(PassiveJointConfig, 'joint')

    def passive(self, joint_names: tuple[str, ...]) -> dict[str, PassiveJointConfig]:
        """Return the passive joints by their names.

        Raises ParameterError: A name is no joint's, or a joint has no frequency.
        """
        for name in self.joints:
            if name not in joint_names or self.joints.count(name) > 1:
                raise ParameterError(
                    f"parameter 'flexible.joints' has '{name[:60]}'; accepted: {listing(joint_names)}, each once"
                )
        foreign = [name for name in self.each if name not in self.joints]
        if foreign:
            raise ParameterError(
                f"parameter 'flexible.{foreign[0][:60]}' is of no joint in 'flexible.joints'; accepted: "
                f'{listing(self.joints) or "none"}'
            )
        found = {name: PassiveJointConfig(**self.each.get(name, {})) for name in self.joints}
        still = [name for name, joint in found.items() if joint.frequency == 0.0]
        if still:
            raise ParameterError(f"parameter 'flexible.{still[0]}.frequency' is 0 Hz; accepted: above 0")
        return found
