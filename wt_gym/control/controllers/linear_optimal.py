"""Linear optimal pitch: offsets from the disturbances that a model of the turbine leaves in what is measured.

The model is a finite impulse response from offsets of mean, tilt and yaw to what is measured under the base controller.
What it does not explain is the disturbance, which no offset changes: feedback from it cannot make the loop unstable as
long as the model holds, and its coefficients follow from least squares (Youla, Jabr and Bongiorno, IEEE Trans. Autom.
Control 21 (1976) 319; system-level synthesis: Anderson et al., Annu. Rev. Control 47 (2019) 364). The designs come from
``wt-gym design linear_optimal``.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wt_gym.control.controllers.controller import parts_of
from wt_gym.control.controllers.parameters import PATH, Parameter
from wt_gym.control.controllers.rotor_rules import same_rotor
from wt_gym.control.optimal.design_file import LinearDesign, load_design
from wt_gym.control.optimal.measured import OUTPUTS, channels_read, measured_outputs, side_sign
from wt_gym.control.optimal.model_fit import ModelFit
from wt_gym.control.optimal.offsets import PitchOffsets
from wt_gym.control.optimal.past import delay_bins
from wt_gym.control.sensors import LowPass
from wt_gym.turbines import load_turbine

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from wt_gym.control.actions import Demand
    from wt_gym.control.controllers.controller import Controller, Readings
    from wt_gym.turbines import Turbine

__all__ = ["PARAMETERS", "SHIPPED", "LinearOptimalPitch", "linear_part", "seen_bins"]

PARAMETERS = (
    Parameter(
        "file", "-", "design for the turbine and the base controller", word=PATH, otherwise="the one shipped for the "
        "turbine",
    ),
    Parameter("gain", "-", "factor on all offsets", 0.0, 2.0),
)  # fmt: skip
"""What can be chosen (`wt_gym.control.controllers.parameters`)."""

SHIPPED = ("iea_15mw", "iea_22mw", "nrel_5mw", "nrel_5mw_monopile")
"""Turbines with a design in ``data``."""

SCHEDULE_TIME = 10.0
"""Time constant of the pitch that chooses between designs [s]."""


def seen_bins(design: LinearDesign) -> tuple[tuple[int, int], ...]:
    """Bins of delays, first to last without the last, in intervals, over which an agent sees means of disturbances."""
    return delay_bins(design.gains.shape[-1] * design.interval, design.interval, fine=3, growth=1.6)


class LinearOptimalPitch:
    """Addition that answers disturbances of loads and rotor speed by mean, tilt and yaw pitch.

    Parameters
    ----------
    turbine : Turbine
    design : LinearDesign
    gain : float
        Factor on all offsets [-].

    Attributes
    ----------
    offsets : PitchOffsets
    disturbance : numpy.ndarray, shape (6,)
        Found in the last step, in the units of `OUTPUTS`.
    fit : ModelFit
        Of the model, over what is measured.
    """

    def __init__(self, turbine: Turbine, design: LinearDesign, gain: float = 1.0) -> None:
        self.design, self.gain = design, gain
        self.offsets = PitchOffsets(turbine, design.limit, design.rate_limit, design.fading)
        self.channels = channels_read(turbine.n_blades)
        self.sign, self.n_blades = side_sign(turbine), turbine.n_blades
        with np.errstate(divide="ignore"):
            self._kept = np.where(design.washout > 0.0, np.exp(-design.interval / design.washout), 0.0)
        self._washes = design.washout > 0.0
        self._schedule = LowPass(SCHEDULE_TIME)
        self._acted = np.zeros((3, design.responses.shape[-1]))
        self._past = np.zeros((len(OUTPUTS), design.gains.shape[-1]))
        self._lasting = np.zeros(len(OUTPUTS))
        self.disturbance, self._sum = np.zeros(len(OUTPUTS)), np.zeros(3)
        self.fit = ModelFit(len(OUTPUTS), design.interval)
        self.bins = seen_bins(design)
        self._first, self._last = np.array(self.bins).T
        self._forget()

    @classmethod
    def of_turbine(cls, turbine: Turbine, file: str | None = None, gain: float = 1.0) -> LinearOptimalPitch:
        """Controller of a design.

        Parameters
        ----------
        turbine : Turbine
        file : str, optional
            Path of a design; by default that shipped for the turbine.
        gain : float
            Factor on all offsets [-].

        Raises
        ------
        ValueError
            If no design is shipped for the turbine.
        FileNotFoundError
            If there is no such file.
        wt_gym.base.errors.ControllerError
            If the file is not a design.
        """
        return cls(turbine, load_design(_shipped(turbine) if file is None else file), gain)

    def start(self, signals: Readings) -> None:
        """Forget everything: nothing is added at this instant."""
        self._forget()

    def _forget(self) -> None:
        self.offsets.start()
        self._acted[:] = self._past[:] = 0.0
        self._lasting[:] = self.disturbance[:] = 0.0
        self._sum[:] = 0.0
        self.fit.start()
        self._wanted, self._age, self._acted_for, self._fresh = (0.0, 0.0, 0.0), 0.0, 0.0, True

    def see_demand(self, base: Demand, demand: Demand, signals: Readings, dt: float) -> None:
        """Take what an agent added to the demand of the base controller for an offset of this controller's own.

        So the disturbances stay what no offset changes, and this controller does not answer what the agent does.
        """
        self._sum += dt * np.array(self.offsets.between(base, demand, signals["azimuth"], signals["rotor_speed"], dt))

    def known(self, signals: Readings) -> NDArray[np.float64]:
        """What is known of the disturbances at an instant, before the controller acts on it.

        Parameters
        ----------
        signals : Readings

        Returns
        -------
        numpy.ndarray, shape (n,)
            Means of the disturbances over `bins` of delays, over their scale and without what lasts, output by output;
            mean, tilt and yaw that they ask for [rad]; share in which offsets act; slow pitch [rad]; gains [-] and lags
            [s] of `fit`.
        """
        passed = int(self._age + 1e-6)
        past, acted = self._past, self._acted
        slow = float(np.mean(signals["pitch"])) if self._fresh else self._schedule.value
        if self._fresh or passed > 0:
            acted = acted.copy()
            if passed > 0:
                _shift(acted, passed)
                acted[:, :passed] = (self._sum / self._acted_for)[:, None]
            found, _ = self._found(signals, acted, slow)
            past, _ = self._moved(found, passed)
        sums = np.cumsum(past, axis=1)
        sums = np.concatenate([np.zeros((len(OUTPUTS), 1)), sums], axis=1)
        means = (sums[:, self._last] - sums[:, self._first]) / (self._last - self._first)
        wanted = self._answer(past, slow)
        return np.concatenate([means.reshape(-1), wanted, [self.offsets.share, slow], self.fit.values])

    def step(self, signals: Readings, dt: float, demand: Demand) -> Demand:
        """Add the offsets, which are decided at the interval of the design, or at every step where that is longer."""
        speed, azimuth = signals["rotor_speed"], signals["azimuth"]
        share = self.offsets.update_share(demand, speed, dt)
        pitch = sum(map(float, demand.pitch)) / self.n_blades + self.offsets.acting[0]
        if self._fresh:
            self._schedule.reset(pitch)
        slow = self._schedule.update(pitch, dt)
        passed = int(self._age + 1e-6)
        if self._fresh or passed > 0:
            self._remember(passed)
            self._wanted = self._decide(signals, slow, passed)
            self._age -= passed
            self._fresh = False
        mean, tilt, yaw = self._wanted
        changed = self.offsets.added((share * mean, share * tilt, share * yaw), demand, azimuth, speed, dt)
        self._age += dt / self.design.interval
        self._acted_for += dt
        self._sum += dt * np.array(self.offsets.acting)
        return changed

    def _remember(self, passed: int) -> None:
        """Take the mean of the offsets since the last decision for each of the intervals that passed."""
        if passed > 0:
            _shift(self._acted, passed)
            self._acted[:, :passed] = (self._sum / self._acted_for)[:, None]
            self._sum[:] = 0.0
            self._acted_for = 0.0

    def _decide(self, signals: Readings, pitch: float, passed: int) -> tuple[float, float, float]:
        """Offsets of what is measured now, at a slow pitch [rad], after so many intervals without a decision."""
        found, measured = self._found(signals, self._acted, pitch)
        self.fit.update(found, measured - found, passed)
        self._past, self._lasting = self._moved(found, passed)
        self.disturbance[:] = found * self.design.scale
        mean, tilt, yaw = self._answer(self._past, pitch).tolist()
        return mean, tilt, yaw

    def _found(
        self, signals: Readings, acted: NDArray[np.float64], pitch: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Disturbances over scales (6,), which are what is measured less what the offsets did, and what is measured."""
        design = self.design
        found = np.empty(len(OUTPUTS))
        measured_outputs(signals, self.n_blades, self.sign, found)
        found /= design.scale
        measured = found.copy()
        low, weight = _place(design.pitch, pitch)
        for k, share in ((low, 1.0 - weight), (low + 1, weight)):
            if share > 0.0:
                found -= share * (design.responses[k].reshape(len(OUTPUTS), -1) @ acted.reshape(-1))
        return found, measured

    def _moved(self, found: NDArray[np.float64], passed: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Past (6, n_delays) and what lasts of it (6,), with the disturbances found after so many intervals."""
        if self._fresh:
            lasting = found.copy()
            past = np.repeat(np.where(self._washes, 0.0, found)[:, None], self._past.shape[1], axis=1)
        else:
            past, lasting = self._past.copy(), self._lasting.copy()
            _shift(past, passed)
            past[:, 1:passed] = self._past[:, :1]  # nothing was measured between
        lasting += (1.0 - self._kept**passed) * (found - lasting)
        past[:, 0] = np.where(self._washes, found - lasting, found)
        return past, lasting

    def _answer(self, past: NDArray[np.float64], pitch: float) -> NDArray[np.float64]:
        """Offsets (3,) that the past of the disturbances asks for at a slow pitch [rad]."""
        design = self.design
        low, weight = _place(design.pitch, pitch)
        wanted = np.zeros(3)
        for k, share in ((low, 1.0 - weight), (low + 1, weight)):
            if share > 0.0:
                wanted += share * self.gain * (design.gains[k].reshape(3, -1) @ past.reshape(-1))
        return wanted


def _shift(rows: NDArray[np.float64], steps: int) -> None:
    """Move what stands in rows to the right; the first columns stay."""
    if 0 < steps < rows.shape[1]:
        rows[:, steps:] = rows[:, :-steps].copy()


def _place(knots: NDArray[np.float64], value: float) -> tuple[int, float]:
    """Index of the knot below and the share of the one above; beyond the ends the last one alone."""
    if value <= knots[0] or len(knots) == 1:
        return 0, 0.0
    k = min(int(np.searchsorted(knots, value)) - 1, len(knots) - 2)
    return k, min(float((value - knots[k]) / (knots[k + 1] - knots[k])), 1.0)


def _shipped(turbine: Turbine) -> Path:
    """Design that comes with the package: for the rotor and for what it stands on."""
    for name in SHIPPED:
        home = load_turbine(name)
        on_land = home.tower.support is None
        if home.name == turbine.name and on_land == (turbine.tower.support is None) and same_rotor(home, turbine):
            return Path(__file__).with_name("data") / f"linear_optimal_{name}.npz"
    raise ValueError(
        f"linear_optimal must be given a design for {turbine.name}: linear_optimal:file=PATH, made by wt-gym design "
        f"linear_optimal; one is shipped for {', '.join(SHIPPED)}"
    )


def linear_part(controller: Controller | None) -> LinearOptimalPitch | None:
    """The linear optimal pitch among the parts of a controller, None where it has none."""
    parts = () if controller is None else parts_of(controller)
    return next((part for part in parts if isinstance(part, LinearOptimalPitch)), None)
