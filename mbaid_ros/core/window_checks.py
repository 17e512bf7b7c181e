"""Faults that closed windows show without an identification: wrong frames, units and rates, a base held."""

from __future__ import annotations

from collections.abc import Sequence

from mbaid_ros.core.diagnosis.held_base import HeldBase
from mbaid_ros.core.diagnosis.rate_checks import GyroFrame, TwistFrame
from mbaid_ros.core.results.status import Reason, notes
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.sensors.joint_rates import JointRates


class WindowChecks:
    """Follows windows, leaves out rates that contradict the positions, and returns reasons to distrust a run.

    Parameters
    ----------
    twist_frame : 'child' or 'inertial', as the base's twist was read
    held : finds whether the base is held; None does not ask
    joint_rates : leaves out joint velocities that are no rates of the positions; None leaves all in
    gyro : whether an IMU on the base measures
    """

    def __init__(
        self,
        twist_frame: str = 'child',
        held: HeldBase | None = None,
        joint_rates: JointRates | None = None,
        *,
        gyro: bool = False,
    ) -> None:
        self._twist_frame = TwistFrame(twist_frame)
        self._gyro_frame = GyroFrame() if gyro else None
        self._held, self._joint_rates = held, joint_rates
        self._contradictions: dict[float, Reason] = {}  # of the twist's frame, by the end of the latest windows, s
        self._wrong_gyro: tuple[float, Reason] | None = None  # since when (s) the IMU is known to be misread, and how
        self._held_since: tuple[float, Reason] | None = None  # s, and the reason
        self._wrong_rates: list[tuple[float, str]] = []  # since when (s) which velocities are left out, in words

    def applied(self, windows: Sequence[Samples]) -> list[Samples]:
        """Return the next windows without rates that contradict the positions."""
        held = self._held.update(windows) if self._held is not None else [None] * len(windows)
        checked = [self._checked(*each) for each in zip(windows, held, strict=True)]
        contradictions = zip(checked, self._twist_frame.update(checked), strict=True)
        # Poses and twist contradict each other without a model of the robot: as a cause, that comes first.
        self._contradictions = {
            float(window.time[-1]): Reason(text, gain=gain) for window, (text, gain) in contradictions
        }
        return checked

    def run_slice(self) -> None:
        """Look at the frame of the latest window's twist now, not when the next one comes."""
        self._twist_frame.run_slice()

    def reasons(self, time: float, *, with_gyro: bool) -> list[Reason]:
        """Return the findings up to the end of a window, s; `with_gyro` if the method uses the IMU."""
        reasons = notes([text for since, text in self._wrong_rates if since <= time][-1:])
        contradiction = self._contradictions.get(time)
        if contradiction is not None and contradiction.text:
            reasons.append(contradiction)
        if self._wrong_gyro is not None and self._wrong_gyro[0] <= time and with_gyro:
            reasons.append(self._wrong_gyro[1])
        if self._held_since is not None and self._held_since[0] <= time:
            reasons.append(self._held_since[1])
        return reasons

    def _checked(self, window: Samples, held: Reason | None) -> Samples:
        end = float(window.time[-1])
        if self._gyro_frame is not None and self._wrong_gyro is None:
            text = self._gyro_frame.update(window)
            if text:
                self._wrong_gyro = float(window.time[0]), Reason(text, 'conflict', self._gyro_frame.gain)
        if held is not None:
            self._held_since = end, held
        if self._joint_rates is None:
            return window
        checked = self._joint_rates.applied(window)
        text = self._joint_rates.contradiction
        if text and (not self._wrong_rates or self._wrong_rates[-1][1] != text):
            self._wrong_rates.append((end, text))
        return checked
