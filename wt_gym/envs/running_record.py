"""Records of a turbine that runs under a controller in turbulence, and the instants of them that fit a wind.

With w the means of the rotor-effective wind over the windows `WINDOWS` before an instant, a linear fit z = B w + c of
the record tells what of the motion z (`FOLLOWS`) the wind explains. Candidates are the instants whose explained motion
B w is nearest to that of the wind of the episode, in standard deviations of z; one of them is drawn. What the wind does
not explain, and the motion side-side above all, is thus drawn from its distribution.
"""

from __future__ import annotations

import copy
import itertools
import logging
import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from threading import Event
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wt_gym.blas_threads import one_blas_thread
from wt_gym.control import Demand
from wt_gym.control.coleman import to_blades, to_fixed_frame
from wt_gym.control.controllers import checked_demand, lidar_of, readings_of
from wt_gym.control.controllers.memory import Memory, changing_parts, memory_of
from wt_gym.control.starting_point import starting_point
from wt_gym.envs.rewards import AVERAGED
from wt_gym.envs.start import ControllerHistory, Start, Trail
from wt_gym.errors import SimulationError
from wt_gym.simulation import Signals, Simulator
from wt_gym.simulation.channels import channel_table
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.wind.protocol import fill_velocity, read_only

if TYPE_CHECKING:
    from wt_gym.control.controllers import Controller
    from wt_gym.turbines import Turbine
    from wt_gym.wind import Inflow

__all__ = ["RECORDING_PLAN", "WINDOWS", "Record", "RecordingPlan", "Run", "StartRecorder", "rotor_wind"]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RecordingPlan:
    """How long and how often the running turbine is recorded; times of the pace of a large turbine [s].

    Attributes
    ----------
    runs : int
        Winds recorded at a wind speed.
    settling : float
        Left out at the beginning of a run: the side-side motion of the 5-MW decays by half in 100 s.
    recorded : float
        Of a run.
    """

    runs: int = 4
    settling: float = 120.0
    recorded: float = 600.0


RECORDING_PLAN = RecordingPlan()
"""Of the records made from now on."""
SPACING = 1.0
"""Between the instants of a record with which an episode can begin [s]."""
WINDOWS = (0.0, 1.0, 3.0, 6.0, 12.0)
"""Times before the start between which the wind is averaged [s]; the first window is the instant itself."""
FOLLOWS = ("rotor_speed", "pitch", "generator_torque", "aero_thrust", "tower_top_fore_aft")
"""What of the motion decides which instants are alike, with the tilt and yaw moments of the rotor."""
_LATEST = 3
"""Where the mean wind of the first window before an instant stands among what counts of the wind."""
_REMEMBERED = 3
"""Windows over which the wind across the rotor counts: the bending of blades follows it within seconds."""
NEAREST = 8
"""Instants alike from which one is drawn."""
_SLOW_TURN = 2.0 * math.pi / 1.267
"""Seconds a turn of a large turbine: times are shorter by as much as a small one turns faster."""
_TRAIL = 60
"""Instants before that of a start whose signals are known to the washout of observations."""
_MEAN_TIME = 10.0
"""Time constant of the running means of loads [s], that of the rewards' filters."""
_NEEDED = ("rotor_speed", "azimuth", "generator_torque", "aero_thrust", "tower_top_fore_aft", "pitch", *AVERAGED)
_READINGS = 3
"""Readings after which a controller has the form in which its numbers are put."""
_FARTHEST = 0.3
"""Difference of the winds just before two instants, over the wind, beyond which they are not alike."""


def _time_scale(turbine: Turbine) -> float:
    """Times of a turbine over those of a large one."""
    return min(1.0, 2.0 * math.pi / turbine.drivetrain.rated_rotor_speed / _SLOW_TURN)


class RowLayout(NamedTuple):
    """Places of the parts of a row of `Run`."""

    signals: slice
    tower_top: slice
    wind: slice
    means: slice
    pitch: slice
    torque: slice
    lidar: slice
    turning: slice
    motion: slice


class Run(NamedTuple):
    """A turbine in one wind.

    Attributes
    ----------
    step : float
        Between the rows [s].
    rows : numpy.ndarray, shape (n_times, n_columns), float32
        Signals at ``StartRecorder.places``; motion of the tower top (4); wind over the rotor (3); running means of the
        loads; demanded pitch and torque; what the lidar saw; azimuth and speed of the generator, low-speed shaft;
        motion of the structure.
    memories : list of Memory
        What the controller remembers at the instants.
    """

    step: float
    rows: np.ndarray
    memories: list[Memory]


class StartRecorder:
    """Records a turbine under a controller.

    Parameters
    ----------
    turbine : Turbine
    fidelity : str
    controller : Controller
        Is copied for each run.
    """

    def __init__(self, turbine: Turbine, fidelity: str, controller: Controller):
        self.turbine, self.fidelity, self.controller = turbine, fidelity, controller
        names = dict.fromkeys((*_NEEDED, *controller.channels))
        known = _table(turbine.n_blades)
        lidar = lidar_of(controller)
        self.lidar_names = () if lidar is None else lidar.names
        # the readings of a lidar are among the names that a controller reads, and no signals
        places = [np.atleast_1d(known[name]) for name in names if not name.startswith("lidar_")]
        self.places = np.unique(np.concatenate(places)).astype(int)
        self.time_scale = _time_scale(turbine)
        n_means = sum(_width(name, turbine.n_blades) for name in AVERAGED)
        counts = len(self.places), 4, 3, n_means, turbine.n_blades, 1, len(self.lidar_names), 2
        ends = np.cumsum(counts).tolist()
        parts = [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]
        self.columns = RowLayout._make([*parts, slice(ends[-1], None)])

    def places_of(self, name: str) -> np.ndarray:
        """Columns of a signal, of the blades together."""
        return _places_of(name, self.places, self.turbine.n_blades)

    def record(self, inflows: list[Inflow]) -> Record | None:
        """Run the turbine in winds; None where it cannot run in any of them."""
        stop = Event()
        with one_blas_thread(), ThreadPoolExecutor(max(os.cpu_count() or 1, 1)) as pool:
            try:
                runs = list(pool.map(partial(self.run, stop=stop), inflows))
            finally:  # after an interrupt nobody waits for the runs that are under way
                stop.set()
        done = [run for run in runs if run is not None]
        return Record.of_runs(self, done) if done else None

    def times(self, step: float) -> tuple[list[int], int, int]:
        """Rows: ends of the windows, before the first instant, and between instants."""
        windows = [max(round(self.time_scale * time / step), k) for k, time in enumerate(WINDOWS)]
        return windows, max(windows[-1], _READINGS), max(round(self.time_scale * SPACING / step), 1)

    def steps(self, step: float) -> np.ndarray:
        """How many steps before an instant the wind is asked for."""
        return np.arange(0, self.times(step)[0][-1], max(round(0.5 * self.time_scale / step), 1))

    def run(self, inflow: Inflow, stop: Event | None = None) -> Run | None:
        """Run the turbine in a wind; None where the simulation fails, and soon after ``stop`` is set."""
        turbine, controller = self.turbine, copy.deepcopy(self.controller)
        simulator = Simulator(turbine, inflow, fidelity_of(self.fidelity))
        point = starting_point(turbine, inflow)
        signals = simulator.reset(point.rotor_speed, point.pitch, generator_torque=point.generator_torque)
        demand = Demand(np.array(signals.pitch), 0.0, signals.generator_torque)
        readings = readings_of(controller, signals, inflow, turbine.hub_height, turbine.rotation)
        controller.start(readings, demand)
        dt = simulator.time_step
        settling, recorded = (
            round(self.time_scale * time / dt) for time in (RECORDING_PLAN.settling, RECORDING_PLAN.recorded)
        )
        _, before, spacing = self.times(dt)
        means, gain = None, -math.expm1(-dt / (self.time_scale * _MEAN_TIME))
        rows: list[np.ndarray] = []
        memories: list[Memory] = []
        try:
            for k in range(settling + recorded):
                if stop is not None and stop.is_set():
                    return None
                present = np.concatenate([np.atleast_1d(signals[name]) for name in AVERAGED])
                means = present if means is None else means + gain * (present - means)
                if k >= settling - before:
                    if len(rows) >= before and (len(rows) - before) % spacing == 0:
                        memories.append(memory_of(controller))
                    wind = rotor_wind(inflow, turbine, 0.0, signals["time"])
                    seen = [readings[name] for name in self.lidar_names]
                    y, s = simulator.coupling.integrator.state, simulator.structure
                    turning = y[s.azimuth_q] % (2.0 * math.pi), y[s.system.n_q + s.azimuth_u]
                    kept = [signals.values[self.places], simulator.tower_top(), wind, means, demand.pitch]
                    kept += [[demand.generator_torque], seen, turning, simulator.motion()]
                    rows.append(np.concatenate(kept).astype(np.float32))
                demand = checked_demand(controller.step(readings, dt), controller, turbine.n_blades)
                torque = demand.generator_torque if turbine.drivetrain.takes_torque else 0.0
                signals = simulator.advance(dt, demand.pitch, 0.0, torque)
                readings = readings_of(controller, signals, inflow, turbine.hub_height, turbine.rotation)
        except SimulationError as error:
            _log.warning("%s does not run in %s (%s): no start is taken of it", turbine.name, inflow, error)
            return None
        return Run(dt, np.array(rows), memories)


class Record:
    """A turbine as it ran in some winds.

    Parameters
    ----------
    recorder : StartRecorder
        Of what it is a record.
    step : float
        Of the simulation [s].
    now : numpy.ndarray, shape (n_instants, n_columns), float32
        Rows of `Run` at the instants of all runs.
    history : numpy.ndarray, shape (n_instants, n_known), float32
        What is known of the wind before them, see `_averaged`.
    thrust : numpy.ndarray, shape (n_instants,), float32
        Mean over the windows before them [N].
    before : numpy.ndarray, shape (n_instants, n_readings, n_columns), float32
        The rows just before them, without the motion of the structure.
    memory : Memory
        What the controller remembers at the instants: values (n_instants, n), not numbers at the end where there are
        fewer, and sizes (n_instants, n_parts).
    changing : numpy.ndarray, shape (n_parts,), bool
        Which parts of it are no parameters.
    """

    def __init__(
        self,
        recorder: StartRecorder,
        step: float,
        now: np.ndarray,
        history: np.ndarray,
        thrust: np.ndarray,
        before: np.ndarray,
        memory: Memory,
        changing: np.ndarray,
    ):
        self.step, self.now, self.history, self.thrust, self.before = step, now, history, thrust, before
        self.memory, self.changing = memory, changing
        self._columns, self._windows, self._steps = recorder.columns, recorder.times(step)[0], recorder.steps(step)
        self._turbine, self._places = recorder.turbine, recorder.places
        spacing = recorder.times(step)[2]
        self._spacing = spacing * step
        self._a_run = math.ceil(round(recorder.time_scale * RECORDING_PLAN.recorded / step) / spacing)
        self._fit()

    @classmethod
    def of_runs(cls, recorder: StartRecorder, runs: list[Run]) -> Record:
        """Gather what is needed of runs of one turbine."""
        step, rows = runs[0].step, np.stack([run.rows for run in runs])
        windows, first, spacing = recorder.times(step)
        instants = np.arange(first, rows.shape[1], spacing)
        columns = recorder.columns
        wind = rows[:, instants[:, None] - recorder.steps(step), columns.wind].astype(float)
        thrust = rows[..., recorder.places_of("aero_thrust")[0]].astype(float)
        memories = [memory for run in runs for memory in run.memories]
        values = np.full((len(memories), max(len(memory.values) for memory in memories)), np.nan)
        for row, memory in zip(values, memories, strict=True):
            row[: len(memory.values)] = memory.values
        sizes = np.array([memory.sizes for memory in memories])
        gathered = (
            rows[:, instants],
            _averaged(wind, recorder.steps(step), windows),
            thrust[:, instants[:, None] - np.arange(windows[-1])].mean(axis=-1),
            rows[:, instants[:, None] - np.arange(_READINGS, 0, -1), : columns.motion.start],
        )
        now, history, thrust, before = (part.reshape(-1, *part.shape[2:]).astype(np.float32) for part in gathered)
        return cls(recorder, step, now, history, thrust, before, Memory(values, sizes), changing_parts(memories))

    def _fit(self) -> None:
        """Which motion the wind before explains."""
        history, motion = self.history.astype(float), self._followed()
        self._spread = np.maximum(motion.std(axis=0), 1e-9 * np.abs(motion).max(axis=0) + 1e-30)
        self._mean_history = history.mean(axis=0)
        centered = history - self._mean_history
        gram = centered.T @ centered
        gram += 1e-3 * np.trace(gram) / len(gram) * np.eye(len(gram))
        normal = (motion - motion.mean(axis=0)) / self._spread
        self._follows = np.linalg.solve(gram, centered.T @ normal)
        self._explained = centered @ self._follows

    def _followed(self) -> np.ndarray:
        """Values of `FOLLOWS` at the instants, and the moments of tilt and yaw (n_instants, n)."""
        now, known = self.now.astype(float), self._places_of
        columns = [now[:, known(name)].mean(axis=-1) for name in FOLLOWS]
        flap, azimuth = now[:, known("root_flap_moment")], now[:, known("azimuth")]
        blades = azimuth + 2.0 * math.pi * np.arange(flap.shape[-1]) / flap.shape[-1]
        columns += [(flap * wave(blades)).sum(axis=-1) for wave in (np.cos, np.sin)]
        return np.stack(columns, axis=-1)

    def _places_of(self, name: str) -> np.ndarray:
        return _places_of(name, self._places, self._turbine.n_blades)

    def start(self, inflow: Inflow, yaw: float, number: float, azimuth: float | None, fastest: float) -> Start | None:
        """Start that fits the wind before the beginning of an episode; None where it was like none of the record.

        Parameters
        ----------
        inflow : Inflow
        yaw : float
            Nacelle yaw [rad].
        number : float
            Decides between instants alike, 0 … 1.
        azimuth : float, optional
            Of blade 1, by default that of the record [rad].
        fastest : float
            Rotor speed beyond which nothing begins [rad/s].
        """
        history = self._history(inflow, yaw)
        explained = (history - self._mean_history) @ self._follows
        distance = ((self._explained - explained) ** 2).sum(axis=1)
        speed = self.now[:, self._places_of("rotor_speed")[0]]
        distance[speed > fastest] = np.inf
        alike = np.argsort(distance, kind="stable")[:NEAREST]
        alike = alike[np.isfinite(distance[alike])]
        near = np.abs(self.history[alike, _LATEST] - history[_LATEST]) <= _FARTHEST * abs(history[_LATEST])
        alike = alike[near]
        if not len(alike):
            return None
        chosen = alike[int(number * len(alike))]
        return self.at(int(chosen), azimuth, yaw)

    def _history(self, inflow: Inflow, yaw: float) -> np.ndarray:
        """What is known of the wind before time zero (n_known,)."""
        wind = [rotor_wind(inflow, self._turbine, yaw, -k * self.step) for k in self._steps.tolist()]
        return _averaged(np.array(wind), self._steps, self._windows)

    def at(self, chosen: int, azimuth: float | None = None, yaw: float = 0.0) -> Start:
        """Start at one of the instants."""
        row, n, columns = self.now[chosen].astype(float), self._turbine.n_blades, self._columns
        pitch, recorded = row[self._places_of("pitch")], float(row[columns.turning.start])
        motion = row[columns.motion] if azimuth is None else None  # blades bend as they do at an azimuth
        if azimuth is None:
            azimuth = recorded
        elif n == 3:  # what the blades do by azimuth they do elsewhere
            pitch = np.array(to_blades(to_fixed_frame(pitch, recorded), azimuth, n))
        else:
            pitch = np.full(n, pitch.mean())
        deviations: dict[str, float | np.ndarray] = {}
        first = columns.means.start
        for name in AVERAGED:
            last = first + _width(name, n)
            deviation = row[first:last] - row[self._places_of(name)]
            deviations[name] = deviation if last - first > 1 else float(deviation[0])
            first = last
        memory = Memory(*(part[chosen] for part in self.memory))
        torque = max(float(row[columns.torque.start]), 0.0) if self._turbine.drivetrain.takes_torque else 0.0
        return Start(
            float(row[columns.turning.start + 1]), pitch, torque, azimuth,
            row[columns.tower_top], motion, float(self.thrust[chosen]), deviations,
            self._before(self.before[chosen].astype(float), memory, yaw), self._trail(chosen),
        )  # fmt: skip

    def _trail(self, chosen: int) -> Trail:
        """Instants of the same run before one of them."""
        first = max(chosen - chosen % self._a_run, chosen - _TRAIL)
        signals = np.full((chosen - first, len(channel_table(self._turbine.n_blades))), np.nan)
        signals[:, self._places] = self.now[first:chosen, self._columns.signals]
        return Trail(signals, self._spacing)

    def _before(self, before: np.ndarray, memory: Memory, yaw: float) -> ControllerHistory:
        """What was read and demanded in the rows before an instant."""
        n, columns = self._turbine.n_blades, self._columns
        signals = np.full((len(before), len(channel_table(n))), np.nan)
        signals[:, self._places] = before[:, columns.signals]
        known = _table(n)
        signals[:, known["time"]] = self.step * np.arange(-len(before), 0)
        signals[:, known["yaw"]] = yaw
        return ControllerHistory(
            signals, before[:, columns.pitch], before[:, columns.torque.start], before[:, columns.lidar], self.step,
            memory, self.changing,
        )  # fmt: skip


def _averaged(wind: np.ndarray, steps: np.ndarray, windows: list[int]) -> np.ndarray:
    """What counts of the wind over the rotor before an instant.

    Parameters
    ----------
    wind : numpy.ndarray, shape (..., n, 3)
        As `rotor_wind` gives it.
    steps : numpy.ndarray, shape (n,)
        So many steps before the instant.
    windows : list of int
        Ends of the windows, in steps.

    Returns
    -------
    numpy.ndarray, shape (..., n_known)
        Its mean over the windows, and its changes across the rotor over the windows that blades remember.
    """
    ages = [(steps >= late) & (steps < early) for late, early in itertools.pairwise(windows)]
    means = [wind[..., 0, :], *(wind[..., age, :].mean(axis=-2) for age in ages)]
    return np.concatenate([mean[..., : 3 if k < _REMEMBERED else 1] for k, mean in enumerate(means)], axis=-1)


def _places_of(name: str, places: np.ndarray, n_blades: int) -> np.ndarray:
    """Columns of a signal, of the blades together, where the signals at certain places are recorded."""
    return np.searchsorted(places, np.atleast_1d(_table(n_blades)[name]))


@cache
def _width(name: str, n_blades: int) -> int:
    """Numbers of a signal."""
    return np.size(_table(n_blades)[name])


@cache
def _table(n_blades: int) -> Signals:
    """Places of the channels, as signals."""
    return Signals(np.arange(len(channel_table(n_blades))), n_blades)  # type: ignore[arg-type]  # places, not values


_RINGS = np.sqrt([0.25, 0.75])
_AZIMUTHS = 2.0 * np.pi * np.arange(6) / 6
_PLANE = np.stack([np.full(12, 1 / 12), *(np.outer(_RINGS, f(_AZIMUTHS)).ravel() / 3.0 for f in (np.cos, np.sin))])


def rotor_wind(inflow: Inflow, turbine: Turbine, yaw: float, time: float) -> np.ndarray:
    """Wind along the heading of the nacelle over the rotor disc, by 12 points of equal area.

    Returns
    -------
    numpy.ndarray, shape (3,)
        Mean, and change from the center to the rim, upward and to the left, of the plane through the points [m/s].
    """
    disc = np.zeros((_RINGS.size, _AZIMUTHS.size, 3))
    ring = turbine.rotor_diameter / 2 * _RINGS
    beside = np.outer(ring, np.sin(_AZIMUTHS))
    disc[..., 0], disc[..., 1] = -math.sin(yaw) * beside, math.cos(yaw) * beside
    disc[..., 2] = turbine.hub_height + np.outer(ring, np.cos(_AZIMUTHS))
    wind = np.empty((disc.size // 3, 3))
    fill_velocity(inflow, read_only(disc.reshape(-1, 3)), time, wind)
    return _PLANE @ (wind[:, 0] * math.cos(yaw) + wind[:, 1] * math.sin(yaw))
