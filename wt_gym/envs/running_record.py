"""Start of a running turbine: instants of records of it under a controller in turbulence that fit the wind.

With w the means of the rotor-effective wind over the windows `WINDOWS` before an instant, a linear fit z = B w + c of
the instants at a wind speed tells how much of the motion z (`FOLLOWS`) the wind explains. Candidates are the instants
at whose wind speed B explains the least difference from the wind of the episode, in standard deviations of z; one of
them is drawn, and all that it holds but the azimuth is moved by the linear fit of all columns to the wind of the
episode. The part that the wind does not explain, and the motion side-side above all, is thus drawn from its
distribution. So is the slow motion of a platform, which remembers the wind for longer than the windows: its mean and
variance follow the mean speed of the wind. It is recorded in waves, whose drag damps it, without the answer to them: a
start adds the answer to its own. Turbulence of another class or model draws from the same instants.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections import deque
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wt_gym.control import Demand
from wt_gym.control.controllers import Controller, Readings, WithDemandedPower, checked_demand, readings_of
from wt_gym.control.controllers.controller import Memory, changing_parts, memory_of, remember, standing
from wt_gym.control.operating_point import starting_point
from wt_gym.control.sensors import to_blades, to_fixed_frame
from wt_gym.envs.power import AZIMUTHS, RINGS, disc_points
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation import Signals, Simulator
from wt_gym.simulation.channels import TOWER_TOP_PARITIES, channel_table, parities
from wt_gym.simulation.drivetrain.drives import available_torque
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import Turbine
from wt_gym.turbines.variants import REFLECTION_6
from wt_gym.wind import Inflow
from wt_gym.wind.inflow import fill_velocity, read_only


def kind_of(controller: Controller) -> str:
    """Module and name of the class of a controller."""
    return f"{type(controller).__module__}.{type(controller).__qualname__}"


@dataclass(frozen=True)
class Start:
    """State of the turbine at the start of an episode.

    Attributes
    ----------
    tower_top : numpy.ndarray, shape (4,), optional
        As `wt_gym.simulation.Simulator.reset` takes it; None: at rest in balance.
    motion : numpy.ndarray, shape (n,), optional
        Of the structure, as `wt_gym.simulation.Simulator.reset` takes it, where fidelity and azimuth are those of the
        record.
    deviations : dict
        Of the running means of channels from their current values, by name; of the tower of a floater, whose loads
        were those of other waves, the running means.
    """

    rotor_speed: float  #: [rad/s]
    pitch: np.ndarray  #: shape (n_blades,), [rad]
    generator_torque: float  #: High-speed shaft [N m]
    azimuth: float  #: azimuth of blade 1 [rad]
    tower_top: np.ndarray | None = None
    motion: np.ndarray | None = None
    wake_thrust: float | None = None  #: Mean thrust of the air in the time before, to which the wake belongs [N]
    deviations: dict[str, float | np.ndarray] = field(default_factory=dict)
    memory: ControllerForm | None = None  #: memory of the controller that ran before
    trail: np.ndarray | None = None  #: shape (n_channels,), means of the signals before; NaN where not recorded
    platform: np.ndarray | None = None  #: shape (12,), slow motion of a floater, see `Simulator.reset`

    def mirrored(self, n_blades: int) -> Start:
        """Start of the mirror image of the turbine in the mirrored wind, see `wt_gym.simulation.channels`.

        The motion stays: it is that of the clockwise image, as in snapshots. So does the memory of a controller that
        acts on rotor and pitch alone.
        """
        signs = parities(n_blades)
        of = Signals(signs, n_blades)
        return replace(
            self,
            tower_top=None if self.tower_top is None else self.tower_top * TOWER_TOP_PARITIES,
            deviations={name: deviation * of[name] for name, deviation in self.deviations.items()},
            trail=None
            if self.trail is None
            else self.trail * parities(n_blades, Signals(self.trail, n_blades).n_lines),
            platform=None if self.platform is None else self.platform * np.tile(REFLECTION_6, 2),
        )

    def start(self, controller: Controller, readings: Readings, demand: Demand) -> None:
        """Start a controller from the current demand and readings, with the memory that fits it."""
        controller.start(readings, demand)
        if self.memory is not None:
            self.memory.put(controller)

    def averaged(self, signals: Signals) -> Signals:
        """Signals with the running means in place of the current values of the loads."""
        if not self.deviations:
            return signals
        averaged = Signals(signals.values.copy(), signals.n_blades)
        for name, deviation in self.deviations.items():
            afloat = self.platform is not None and name in AVERAGED[1:]
            averaged.set(name, deviation if afloat else signals[name] + deviation)
        return averaged


@dataclass(frozen=True)
class RecordingPlan:
    """Lengths of a recorded run; times of the pace of a large turbine [s]."""

    settling: float = 220.0  #: Left out at the start of a run: the side-side motion of the 5-MW decays by half in 100 s
    instants: int = 16  #: Recorded of a run
    spacing: float = 24.0  #: time between instants


PLAN = RecordingPlan()
"""Plan of the records of the package."""
FLOATING_PLAN = RecordingPlan(settling=400.0)
"""Plan for floating turbines, whose surge decays by half in some 50 s."""
AVERAGED = ("root_flap_moment", "tower_base_fore_aft_moment", "tower_base_side_side_moment")
"""Loads whose high-pass filters begin an episode with the running mean of the turbine that runs before it."""
WINDOWS = (0.0, 1.0, 3.0, 6.0, 12.0)
"""Times before the start between which the wind is averaged [s]; the first window is the instant itself."""
FOLLOWS = ("rotor_speed", "pitch", "generator_torque", "aero_thrust", "tower_top_fore_aft")
"""Motion that decides which instants are alike, with the tilt and yaw moments of the rotor."""
_LATEST = 3  # Place of the mean wind of the first window before an instant in the history of the wind
_REMEMBERED = 3  # Windows over which the wind across the rotor counts: the bending of blades follows it within seconds
NEAREST = 8
"""Instants alike from which one is drawn."""
_SPEED_SPREAD = 1.0  # Difference of the mean wind speed that counts like a standard deviation of the motion [m/s]
_SLOW_TURN = 2.0 * math.pi / 1.267
"""Seconds a turn of a large turbine: times are shorter by as much as a small one turns faster."""
_WASHOUT = 20.0  # Time constant of the means of signals with which a washout of observations starts [s]
_MEAN_TIME = 10.0  # Time constant of the running means of loads [s], that of the rewards' filters
_RECORDED = ("rotor_speed", "azimuth", "generator_speed", "generator_torque", "generator_power", "aero_thrust",
             "tower_top_fore_aft", "pitch", *AVERAGED)  # fmt: skip
_FARTHEST = 0.3  # Difference of the winds just before two instants, over the wind, beyond which they are not alike


def time_scale(turbine: Turbine) -> float:
    """Times of a turbine over those of a large one."""
    return min(1.0, 2.0 * math.pi / turbine.drivetrain.rated_rotor_speed / _SLOW_TURN)


class RowLayout(NamedTuple):
    """Places of the parts of an instant."""

    signals: slice  #: Signals `_RECORDED`
    lasting: slice  #: Their means over the time before
    tower_top: slice  #: As `wt_gym.simulation.Simulator.reset` takes it
    means: slice  #: Running means of the loads `AVERAGED`
    turning: slice  #: Azimuth and speed of the low-speed shaft
    history: slice  #: Wind before, see `_averaged`
    thrust: slice  #: Mean over the windows before [N]
    motion: slice  #: motion of the structure, empty where the fidelity takes none; of a floater, its slow motion
    memory: slice  #: Numbers of the controller that change; to the end

    @classmethod
    def of(cls, n_blades: int, n_motion: int) -> RowLayout:
        """RowLayout for so many blades and numbers of the motion of the structure."""
        n_signals, n_means = (sum(len(_places(n_blades)[name]) for name in names) for names in (_RECORDED, AVERAGED))
        counts = n_signals, n_signals, 4, n_means, 2, _N_KNOWN, 1, n_motion
        ends = np.cumsum(counts).tolist()
        parts = [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
        return cls._make([*parts, slice(ends[-1], None)])


class Instants(NamedTuple):
    """Instants of a turbine in one wind."""

    rows: NDArray[np.float64]  #: shape (n_instants, n_columns), see `RowLayout`; without the memory of the controller
    memories: list[Memory]  #: memory of the controller at each


class StartRecorder:
    """Records a turbine under a controller, which is copied for each run.

    Parameters
    ----------
    demanded_power : float, optional
        Power that a grid operator asks for [W].
    """

    def __init__(self, turbine: Turbine, fidelity: str, controller: Controller, demanded_power: float | None = None):
        self.turbine, self.fidelity, self.controller = turbine, fidelity_of(fidelity), controller
        self._demanded_power = demanded_power

    def run(self, inflow: Inflow, plan: RecordingPlan | None = None, sea: WaveComponents | None = None) -> Instants:
        """Run the turbine in a wind, on a platform in a sea.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the simulation fails.
        """
        turbine, controller, n = self.turbine, copy.deepcopy(self.controller), self.turbine.n_blades
        simulator, floats = Simulator(turbine, inflow, self.fidelity, sea=sea), turbine.floater is not None
        plan, point = plan or (FLOATING_PLAN if floats else PLAN), starting_point(turbine, inflow)
        signals = simulator.reset(point.rotor_speed, point.pitch, generator_torque=point.generator_torque)
        readings = self._readings(controller, signals, inflow)
        controller.start(readings, Demand(np.array(signals.pitch), 0.0, signals.generator_torque))
        dt, scale = simulator.time_step, time_scale(turbine)
        settling, spacing = (round(scale * time / dt) for time in (plan.settling, plan.spacing))
        gain, slow_gain = (-math.expm1(-dt / (scale * time)) for time in (_MEAN_TIME, _WASHOUT))
        means, lasting = _loads(signals), _unturned(signals)
        thrusts: deque[float] = deque(maxlen=max(round(scale * WINDOWS[-1] / dt), 1))
        rows: list[NDArray[np.float64]] = []
        memories: list[Memory] = []
        for k in range(1, settling + (plan.instants - 1) * spacing + 1):
            demand = checked_demand(controller.step(readings, dt), controller, n)
            torque = demand.generator_torque if turbine.drivetrain.takes_torque else 0.0
            signals = simulator.advance(dt, demand.pitch, 0.0, torque)
            readings = self._readings(controller, signals, inflow)
            means = means + gain * (_loads(signals) - means)
            lasting = lasting + slow_gain * (_unturned(signals) - lasting)
            thrusts.append(signals["aero_thrust"])
            if k >= settling and (k - settling) % spacing == 0:
                y, s = simulator.coupling.integrator.state, simulator.structure
                parts: tuple[Any, ...] = (
                    signals.values[_recorded_channels(n)], _turned(lasting, signals["azimuth"], n),
                    simulator.tower_top(), means, [y[s.azimuth_q] % (2.0 * math.pi), y[s.system.n_q + s.azimuth_u]],
                    wind_history(inflow, turbine, 0.0, k * dt), [np.mean(thrusts)],
                    simulator.motion() if simulator.takes_motion else simulator.slow_platform() if floats else [],
                )  # fmt: skip
                rows.append(np.concatenate(parts))
                memories.append(memory_of(controller))
        return Instants(np.array(rows), memories)

    def _readings(self, controller: Controller, signals: Signals, inflow: Inflow) -> Readings:
        readings = readings_of(controller, signals, inflow, self.turbine.hub_height, self.turbine.rotation)
        return readings if self._demanded_power is None else WithDemandedPower(readings, self._demanded_power)


class ControllerForm(NamedTuple):
    """Numbers of a controller, and which of them are recorded.

    Attributes
    ----------
    kind : str
        Module and name of its class; empty: nothing is recorded, and controllers start from the current demand.
    """

    kind: str
    values: NDArray[np.float64]  #: shape (n,), all numbers at one instant
    sizes: NDArray[np.int_]  #: shape (n_parts,), as of a `Memory`
    changing: NDArray[np.bool_]  #: shape (n_parts,), parts that differ between instants; the others are its parameters

    @classmethod
    def of(cls, controller: Controller, memories: list[Memory]) -> ControllerForm:
        """Form of the memory of a controller at some instants: nothing where lists in it grow and shrink."""
        values, sizes = memories[0]
        if any(not np.array_equal(memory.sizes, sizes) for memory in memories):
            return cls("", np.zeros(0), np.zeros(0, dtype=int), np.zeros(0, dtype=bool))
        return cls(kind_of(controller), values, sizes, changing_parts(memories))

    def numbers(self, memories: list[Memory]) -> NDArray[np.float64]:
        """Recorded numbers of some memories (n_memories, n_numbers)."""
        return np.array([memory.values[: len(self.values)][self._recorded] for memory in memories])

    def memory(self, numbers: NDArray[np.float64]) -> ControllerForm | None:
        """Memory with recorded numbers (n_numbers,)."""
        values = self.values.copy()
        values[self._recorded] = numbers
        return self._replace(values=values) if self.kind else None

    def put(self, controller: Controller) -> None:
        """Put it into a controller of that kind and with those parameters, or into such a base of it; into no other."""
        inner = next((each for each in standing(controller) if kind_of(each) == self.kind), None)
        if inner is None or not np.array_equal((present := memory_of(inner)).sizes, self.sizes):
            return
        # a number that the first step sets, as the step of a filter, is none before
        fixed = np.repeat(~self.changing, self.sizes) & ~np.isnan(present.values)
        if np.allclose(present.values[fixed], self.values[fixed], rtol=1e-6, atol=0.0, equal_nan=True):
            remember(inner, Memory(self.values, self.sizes), self.changing)

    @property
    def _recorded(self) -> NDArray[np.bool_]:
        return np.repeat(self.changing, self.sizes)


class Record:
    """A turbine as it ran in some winds.

    Parameters
    ----------
    n_blades, n_motion : int
        Number of blades, and of the numbers of the motion of the structure.
    speeds : numpy.ndarray, shape (n_speeds,)
        Mean wind speeds [m/s].
    rows : numpy.ndarray, shape (n_speeds, n_instants, n_columns)
        See `RowLayout`.
    controller : ControllerForm
        Of the controller that ran.
    """

    def __init__(
        self, n_blades: int, n_motion: int, speeds: NDArray[np.float64], rows: NDArray[np.float64],
        controller: ControllerForm,
    ):  # fmt: skip
        self._n_blades, self._speeds, self._controller = n_blades, speeds, controller
        self._columns = columns = RowLayout.of(n_blades, n_motion)
        self._has_motion = n_motion > 0
        self._history, motion = rows[:, :, columns.history], rows[:, :, columns.motion]
        self._platform = motion.mean(axis=1), motion.var(axis=1) + 1e-30  # a motion may rest
        followed = [_followed(at_speed, n_blades) for at_speed in rows]
        spread = [np.maximum(motion.std(axis=0), 1e-9 * np.abs(motion).max(axis=0) + 1e-30) for motion in followed]
        fits = [_linear_fit(*parts) for parts in zip(self._history, followed, strict=True)]
        self._follows = np.array([fit / each for fit, each in zip(fits, spread, strict=True)])
        self._explained = self._history @ self._follows
        self._responses = np.array([_linear_fit(*parts) for parts in zip(self._history, rows, strict=True)])
        for turns in (columns.signals, columns.lasting):
            self._responses[:, :, turns.start + _places(n_blades)["azimuth"]] = 0.0
        self._responses[:, :, columns.turning.start] = 0.0
        whole = (rows[:, :, columns.memory] == np.round(rows[:, :, columns.memory])).all(axis=(0, 1))
        self._responses[:, :, columns.memory] *= ~whole  # counters and flags
        self._rows, self._per_speed = rows.reshape(-1, rows.shape[-1]), rows.shape[1]
        self._rotor_speed = rows[:, :, _places(n_blades)["rotor_speed"][0]]

    def start(
        self, turbine: Turbine, inflow: Inflow, speed: float, yaw: float, number: float, azimuth: float | None,
        fastest: float,
    ) -> Start | None:  # fmt: skip
        """Start that fits the wind before an episode; None where the wind was like none of the record.

        Parameters
        ----------
        speed : float
            Mean of the wind [m/s].
        yaw : float
            Nacelle yaw [rad].
        number : float
            Decides between instants alike, 0 … 1.
        azimuth : float, optional
            Of blade 1, by default that of the record [rad].
        fastest : float
            Rotor speed beyond which nothing starts [rad/s].
        """
        history = wind_history(inflow, turbine, yaw, 0.0)
        difference = self._explained - (history @ self._follows)[:, None]
        distance = (difference**2).sum(axis=-1) + (((self._speeds - speed) / _SPEED_SPREAD) ** 2)[:, None]
        near = np.abs(self._history[..., _LATEST] - history[_LATEST]) <= _FARTHEST * abs(history[_LATEST])
        distance[(self._rotor_speed > fastest) | ~near] = np.inf
        distance = distance.ravel()
        alike = np.argsort(distance, kind="stable")[:NEAREST]
        alike = alike[np.isfinite(distance[alike])]
        if not len(alike):
            return None
        instant = int(alike[int(number * len(alike))])
        change = (history - self._rows[instant, self._columns.history]) @ self._responses[instant // self._per_speed]
        if turbine.floater is not None:
            change[self._columns.motion] = self._platform_change(instant, speed)
        start = self.at(turbine, instant, azimuth, change)
        return start if start.platform is None else replace(start, platform=_along(start.platform, yaw))

    def _platform_change(self, instant: int, speed: float) -> NDArray[np.float64]:
        """Change of the motion of a platform (12,) by its mean and variance from an instant to a wind speed [m/s]."""
        means, variances = self._platform
        own, row = instant // self._per_speed, self._rows[instant, self._columns.motion]
        mean, variance = (np.array([np.interp(speed, self._speeds, of) for of in each.T]) for each in self._platform)
        return np.asarray(mean + (row - means[own]) * np.sqrt(variance / variances[own]) - row)

    def at(
        self, turbine: Turbine, instant: int, azimuth: float | None = None, change: NDArray[np.float64] | float = 0.0
    ) -> Start:
        """Start at one of the instants, with a change of the columns."""
        row, n, columns = self._rows[instant] + change, self._n_blades, self._columns
        pitch = np.clip(row[_places(n)["pitch"]], turbine.pitch.min_pitch, turbine.pitch.max_pitch)
        recorded = float(row[columns.turning.start])
        floats = turbine.floater is not None
        motion = row[columns.motion] if azimuth is None and self._has_motion and not floats else None  # by the azimuth
        if azimuth is None:
            azimuth = recorded
        elif n == 3:  # what the blades do by azimuth they do elsewhere
            pitch = np.array(to_blades(to_fixed_frame(pitch, recorded), azimuth, n))
        else:
            pitch = np.full(n, pitch.mean())
        places = [_places(n)[name] for name in AVERAGED]
        means = np.split(row[columns.means], np.cumsum([len(place) for place in places])[:-1])
        present = [np.zeros(1) if floats and name in AVERAGED[1:] else row[_places(n)[name]] for name in AVERAGED]
        changes = {name: mean - now for name, mean, now in zip(AVERAGED, means, present, strict=True)}
        deviations = {name: each if len(each) > 1 else float(each[0]) for name, each in changes.items()}
        speed, torque = float(row[columns.turning.start + 1]), 0.0
        if turbine.drivetrain.takes_torque:  # a changed row may ask for more than the generator has
            available = available_torque(turbine.drivetrain, speed)
            torque = min(max(float(row[_places(n)["generator_torque"][0]]), 0.0), available)
        return Start(
            speed, pitch, torque, azimuth,
            row[columns.tower_top], motion, float(row[columns.thrust.start]), deviations,
            self._controller.memory(row[columns.memory]), self._trail(row[columns.lasting], turbine.n_lines),
            row[columns.motion] if floats else None,
        )  # fmt: skip

    def _trail(self, lasting: NDArray[np.float64], n_lines: int | None) -> NDArray[np.float64]:
        signals = np.full(len(channel_table(self._n_blades, n_lines)), np.nan)
        signals[_recorded_channels(self._n_blades)] = lasting
        return signals


def _along(platform: NDArray[np.float64], yaw: float) -> NDArray[np.float64]:
    """Motion of a platform (12,) that was recorded in wind along x, in wind along a heading [rad]."""
    turn, (place, tilt, velocity, rates) = Rotation.from_rotvec([0.0, 0.0, yaw]), platform.reshape(4, 3)
    tilts = Rotation.from_euler("xyz", tilt + np.outer((-1.0, 0.0, 1.0), 1e-4 * rates))  # 0.1 ms before, now and after
    before, now, after = (turn * tilts * turn.inv()).as_euler("xyz")
    return np.concatenate([turn.apply(place), now, turn.apply(velocity), (after - before) / 2e-4])


def wind_history(inflow: Inflow, turbine: Turbine, yaw: float, time: float) -> NDArray[np.float64]:
    """Wind before a time [s], as far as the motion depends on it (n_known,), see `_averaged`."""
    disc, scale = _disc(turbine, yaw), time_scale(turbine)
    wind = [_over(disc, inflow, yaw, time - scale * age) for age in _AGES.tolist()]
    return _averaged(np.array(wind))


_AGES = np.arange(0.0, WINDOWS[-1], 0.5)  # Times before an instant at which the wind counts [s]


def _averaged(wind: NDArray[np.float64]) -> NDArray[np.float64]:
    """Wind at `_AGES` over the rotor (n, 3), as `rotor_wind` gives it, averaged over `WINDOWS` (n_known,).

    Mean of the wind, and its changes across the rotor over the windows that blades remember.
    """
    places = np.searchsorted(_AGES, WINDOWS)
    windows = [slice(*ends) for ends in itertools.pairwise(places.tolist())]
    means = [wind[0], *(wind[window].mean(axis=0) for window in windows)]
    return np.concatenate([mean[: 3 if k < _REMEMBERED else 1] for k, mean in enumerate(means)])


_N_KNOWN = 3 * _REMEMBERED + len(WINDOWS) - _REMEMBERED  # Numbers of `_averaged`


def _linear_fit(history: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change of values (n_instants, n) with the wind before (n_known, n), least squares with a small ridge."""
    centered = history - history.mean(axis=0)
    gram = centered.T @ centered
    gram += 1e-2 * np.trace(gram) / len(gram) * np.eye(len(gram))
    fit: NDArray[np.float64] = np.linalg.solve(gram, centered.T @ (values - values.mean(axis=0)))
    return fit


def _followed(rows: NDArray[np.float64], n_blades: int) -> NDArray[np.float64]:
    """Values of `FOLLOWS` in rows, and the moments of tilt and yaw (n_rows, n)."""
    columns = [rows[:, _places(n_blades)[name]].mean(axis=-1) for name in FOLLOWS]
    flap, azimuth = rows[:, _places(n_blades)["root_flap_moment"]], rows[:, _places(n_blades)["azimuth"]]
    blades = azimuth + 2.0 * math.pi * np.arange(n_blades) / n_blades
    columns += [(flap * wave(blades)).sum(axis=-1) for wave in (np.cos, np.sin)]
    return np.stack(columns, axis=-1)


def _loads(signals: Signals) -> NDArray[np.float64]:
    return np.concatenate([np.atleast_1d(signals[name]) for name in AVERAGED])


def _unturned(signals: Signals) -> NDArray[np.float64]:
    """Recorded signals, those of three blades as mean, tilt and yaw, whose means do not depend on the azimuth."""
    values: NDArray[np.float64] = signals.values[_recorded_channels(signals.n_blades)].copy()
    for place in _of_blades(signals.n_blades):
        values[place] = to_fixed_frame(values[place], signals["azimuth"])
    return values


def _turned(lasting: NDArray[np.float64], azimuth: float, n_blades: int) -> NDArray[np.float64]:
    """Inverse of `_unturned` at an azimuth [rad], which becomes that of the signals."""
    values = lasting.copy()
    for place in _of_blades(n_blades):
        values[place] = to_blades(values[place], azimuth, n_blades)
    values[_places(n_blades)["azimuth"]] = azimuth
    return values


def _of_blades(n_blades: int) -> list[NDArray[np.int_]]:
    """Places of the recorded signals of three blades."""
    return [places for places in _places(n_blades).values() if len(places) == n_blades == 3]


@cache
def _places(n_blades: int) -> dict[str, NDArray[np.int_]]:
    """Places of the recorded signals in a row, of the blades together."""
    ends = np.cumsum([np.size(_table(n_blades)[name]) for name in _RECORDED]).tolist()
    return {name: np.arange(*ends_of) for name, ends_of in zip(_RECORDED, itertools.pairwise([0, *ends]), strict=True)}


@cache
def _recorded_channels(n_blades: int) -> NDArray[np.int_]:
    """Places of `_RECORDED` among the channels of the simulator."""
    table = _table(n_blades)
    return np.concatenate([np.atleast_1d(table[name]) for name in _RECORDED]).astype(int)


@cache
def _table(n_blades: int) -> Signals:
    """Places of the channels, as signals."""
    return Signals(np.arange(len(channel_table(n_blades))), n_blades)  # type: ignore[arg-type]  # places, not values


_PLANE = np.stack([np.full(12, 1 / 12), *(np.outer(RINGS, f(AZIMUTHS)).ravel() / 3.0 for f in (np.cos, np.sin))])


def _disc(turbine: Turbine, yaw: float) -> NDArray[np.float64]:
    """Points of the rotor disc (12, 3) [m]."""
    beside, height = disc_points(turbine)
    return read_only(np.stack([-math.sin(yaw) * beside, math.cos(yaw) * beside, height], axis=-1))


def rotor_wind(inflow: Inflow, turbine: Turbine, yaw: float, time: float) -> NDArray[np.float64]:
    """Wind along the heading of the nacelle over the rotor disc, by 12 points of equal area.

    Returns
    -------
    numpy.ndarray, shape (3,)
        Mean, and change from the center to the rim, upward and to the left, of the plane through the points [m/s].
    """
    return _over(_disc(turbine, yaw), inflow, yaw, time)


def _over(disc: NDArray[np.float64], inflow: Inflow, yaw: float, time: float) -> NDArray[np.float64]:
    """`rotor_wind` at the points of a disc."""
    wind = np.empty(disc.shape)
    fill_velocity(inflow, disc, time, wind)
    plane: NDArray[np.float64] = _PLANE @ (wind[:, 0] * math.cos(yaw) + wind[:, 1] * math.sin(yaw))
    return plane
