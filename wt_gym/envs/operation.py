"""A turbine in operation: simulator, base controller and the set points of an agent, one control step at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.errors import SimulationError, did_you_mean
from wt_gym.base.options import shown
from wt_gym.control import ActionMap, AgentSetpoint, Demand, Lidar
from wt_gym.control.controllers import Controller, Readings, WithDemandedPower, WithLidar, checked_demand, lidar_of
from wt_gym.control.controllers.additions import ResidualPitch, YawByDeadBand, yaw_drive_of
from wt_gym.control.controllers.fault_supervisor import fault_supervisor_of
from wt_gym.control.controllers.linear_optimal import linear_part
from wt_gym.control.controllers.supervisor import Supervisor, supervisor_of
from wt_gym.envs.instruments import Instruments, PitchGain
from wt_gym.envs.terms import Beginning, Plant, Stateful, hooks
from wt_gym.envs.wind_sampler import EpisodeWind
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation import Fidelity, Signals, Simulator
from wt_gym.simulation.contract import DrivenSimulator, SimulatorMaker, TurbineSimulator
from wt_gym.simulation.drivetrain.faults import DriveFault, PitchMisalignment, SensorBias, VoltageDip
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import BladeIce, Turbine
from wt_gym.wind import Inflow

if TYPE_CHECKING:
    from wt_gym.envs.power_reference import PowerReference
    from wt_gym.envs.variation import DrawnVariation

OWN = "wt_gym"
"""Name of the simulator of this package."""
_SIMULATORS = (OWN, "openfast")


# ---- simulators ----


def make_simulator(turbine: Turbine, inflow: Inflow, fidelity: str | Fidelity) -> TurbineSimulator:
    """Make a simulator of this package."""
    return cast("TurbineSimulator", Simulator(turbine, inflow=inflow, fidelity=fidelity_of(fidelity)))


def simulator_maker(
    choice: Any, turbine: Any, pictured: bool, longest: Callable[[], float | None] = lambda: None
) -> SimulatorMaker:
    """Function that makes a simulator of turbine, inflow and fidelity.

    Parameters
    ----------
    choice : str, mapping or callable
        "wt_gym" or "openfast"; a mapping with it as ``"name"`` and further arguments of
        `wt_gym.bridges.openfast.OpenFASTSimulator`; or a function (turbine, inflow, fidelity) that gives a
        `wt_gym.simulation.contract.TurbineSimulator`.
    turbine : Any
        As the user gave it: the path of an OpenFAST model (``.fst``) is simulated as it is.
    pictured : bool
        Pictures are required.
    longest : callable
        Gives the time that an inflow must last [s], None if that is open; called when a simulator is made.

    Raises
    ------
    ValueError
        If there is no such simulator, it takes no such argument, or it gives no pictures.
    wt_gym.base.errors.SimulationError
        If OpenFAST's library is not there.
    """
    if callable(choice):
        return cast("SimulatorMaker", choice)
    options = dict(choice) if isinstance(choice, Mapping) else {"name": choice}
    name = options.pop("name", None)
    if name not in _SIMULATORS:
        guess = did_you_mean(name, _SIMULATORS) if isinstance(name, str) else ""
        raise ValueError(
            f"simulator must be one of {', '.join(map(repr, _SIMULATORS))}, a mapping with one of them as 'name', or a "
            f"function that makes a simulator; got {shown(choice)}{guess}"
        )
    if name == OWN:
        if options:
            raise ValueError(f"the simulator of this package takes no further arguments, got {sorted(options)}")
        return make_simulator
    if pictured:
        raise ValueError("OpenFAST gives no shapes for pictures: render_mode must be None with it")
    from wt_gym.bridges.openfast import OpenFASTSimulator, find_library  # not needed without it
    from wt_gym.bridges.openfast.simulator import OPTIONS

    if unknown := sorted(set(options) - set(OPTIONS)):
        raise ValueError(f"OpenFAST takes {', '.join(OPTIONS)}; got {', '.join(unknown)}")
    options["openfast_library"] = find_library(options.get("openfast_library"))
    if isinstance(turbine, str) and turbine.lower().endswith(".fst"):
        options.setdefault("model", turbine)

    def make(turbine: Turbine, inflow: Inflow, fidelity: str | Fidelity) -> TurbineSimulator:
        duration = longest()  # the wind lasts as long as episodes do
        lasting = {} if duration is None else {"duration": duration}
        return OpenFASTSimulator(turbine, inflow, fidelity, **lasting | options)

    return make


def _no_instruments(_: object) -> None:
    """Exact readings."""


class Operation(Stateful):
    """A turbine in the wind of an episode, under a base controller and an agent.

    Parameters
    ----------
    controller : Controller or None
        Base controller, stepped at the step of the simulator.
    residual : ResidualPitch or None
        Filters of residual pitch.
    lidar : Lidar
        Whose readings are observed, and read by a controller that has one.
    steps : (float, int)
        Step of the simulator [s], and number of such steps in a control step.
    make : callable
        Makes the simulator, see `make_simulator`; called at the first start of each plant.
    """

    remembered = (
        "signals", "demand", "base", "setpoint", "controller", "residual", "faults", "plant", "instruments",
        "pitch_gain", "_taken", "reference", "sea",
    )  # fmt: skip
    wind: EpisodeWind
    demand: Demand  #: on the drives
    base: Demand  #: of the base controller
    setpoint: AgentSetpoint
    plant: Plant
    everyone: bool = False  #: the base controller reads the instruments of the agent
    simulator: TurbineSimulator | None = None  #: None before the first start
    signals: Signals = cast("Signals", None)  #: of the simulator at the current instant; None before the first start
    faults: tuple[DriveFault | SensorBias, ...] = ()  #: of the episode with their times
    instruments: Instruments | None = None  #: None where readings are exact
    reference: PowerReference | None = None  #: demand of a grid operator
    sea: WaveComponents | None = None  #: of the episode of a floating turbine
    pitch_gain: PitchGain | None = None  #: response to pitch, where it is not that of the model
    _taken: Signals | None = None
    _drive_faults: tuple[DriveFault, ...] = ()
    _look: tuple[tuple[float, float], np.ndarray] | None = None

    def __init__(
        self,
        turbine: Turbine,
        action: ActionMap,
        controller: Controller | None,
        residual: ResidualPitch | None,
        lidar: Lidar,
        fidelity: str | Fidelity,
        steps: tuple[float, int],
        make: SimulatorMaker,
    ):
        self.turbine, self.action, self.controller, self.residual = turbine, action, controller, residual
        self.lidar, self._fidelity, self.make_simulator = lidar, fidelity, make
        self.step, self.count = steps
        self._supervised = supervisor_of(controller) is not None
        self._lidar_is_read = controller is not None and lidar_of(controller) is not None
        self.make_instruments: Callable[[DrawnVariation], Instruments | None] = _no_instruments
        self._simulators: dict[tuple[int, BladeIce | None], TurbineSimulator] = {}
        self._filters: list[Callable[[Signals], Signals]] = []

    # ---- starts ----

    def begin(self, beginning: Beginning) -> None:
        """Start simulator and controller."""
        start = beginning.start
        simulator = self._enter(beginning.wind, beginning.plant, beginning.faults)
        self._equip(beginning)
        afloat = {} if self.turbine.floater is None else {"platform": start.platform}
        self.signals = simulator.reset(
            rotor_speed=start.rotor_speed, pitch=start.pitch, azimuth=start.azimuth, yaw=beginning.yaw,
            generator_torque=start.generator_torque, tower_top=start.tower_top, wake_thrust=start.wake_thrust,
            motion=start.motion, **afloat,
        )  # fmt: skip
        self.demand = self.base = Demand(start.pitch.copy(), 0.0, start.generator_torque)
        self.setpoint = self.action.start(self.demand)
        if self.pitch_gain is not None:
            self.pitch_gain.start(start.pitch)
        self._take(self.signals)
        if self.controller is not None:
            read = self._read_by_controller(self.readings() if self._reads_together else self.measured(self.signals))
            start.start(self.controller, read, self.demand)
        if self.residual is not None:
            pitch = start.pitch[0] + float((start.pitch - start.pitch[0]).mean())  # exactly that of equal blades
            self.residual.start(pitch, start.rotor_speed, self.step)

    def _enter(self, wind: EpisodeWind, plant: Plant, faults: tuple[DriveFault | SensorBias, ...]) -> TurbineSimulator:
        """Put the simulator of a plant into a wind, with these faults and no others; the lidar has not looked yet.

        Each turbine of a variation, and each with ice, has a simulator, which is made when it is drawn for the first
        time.
        """
        self.wind, self.plant, self._look, key = wind, plant, None, (plant.number, plant.ice)
        simulator = self._simulators.get(key)
        if simulator is None:
            turbine = plant.turbine if plant.ice is None else replace(plant.turbine, ice=plant.ice)
            simulator, self._drive_faults = self.make_simulator(turbine, wind.inflow, self._fidelity), ()
            self._simulators[key] = simulator
        else:
            simulator.inflow = wind.inflow
            if simulator is not self.simulator:
                self._drive_faults = tuple(simulator.faults)
        self.simulator, self.faults = simulator, faults
        drive_faults = tuple(fault for fault in faults if isinstance(fault, DriveFault))
        if drive_faults != self._drive_faults:
            simulator.faults = self._drive_faults = drive_faults
        return simulator

    def _equip(self, beginning: Beginning) -> None:
        """Take what is drawn of features."""
        self.pitch_gain = self.instruments = self.reference = self.sea = None
        for equip in hooks(beginning.drawn.values(), "equip"):
            equip(self)
        self._resolve()

    def meet(self, sea: WaveComponents | None) -> None:
        """Put a floating turbine into a sea."""
        self.sea = sea
        if self.turbine.floater is not None:
            cast("DrivenSimulator", self.simulator).sea = sea

    def _resolve(self) -> None:
        """Filters that the readings of the episode pass: response to pitch, then failing sensors."""
        failing: list[Callable[[Signals], Signals]] = [
            fault.read for fault in self.faults if isinstance(fault, SensorBias | PitchMisalignment)
        ]
        self._filters = failing if self.pitch_gain is None else [self.pitch_gain.read, *failing]

    def close(self) -> None:
        """Release all simulators."""
        for simulator in self._simulators.values():
            if (close := getattr(simulator, "close", None)) is not None:
                close()
        self._simulators.clear()
        self.simulator = None

    # ---- steps ----

    def advance(self, setpoint: AgentSetpoint) -> Signals:
        """Simulate a control step, in which the demand moves to the set point at every step of the simulator.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the simulation fails; set point and signals stay as they were.
        wt_gym.base.errors.ControllerError
            If the base controller gives a demand without meaning.
        """
        simulator, controller, residual = self.simulator, self.controller, self.residual
        if simulator is None:
            raise SimulationError("the turbine does not run: it must be started first")
        bound, guarded = None, self.action.mode == "residual"
        if (supervisor := self.supervisor) is not None:
            # an integral of the agent that went on where it does not act would have to come back first
            supervisor.asked = supervisor.acting_offset(setpoint.set_point)
            setpoint = replace(setpoint, set_point=supervisor.asked)
            bound = supervisor if guarded else None
        before, signals, count, dt, demand_of = self.setpoint, self.signals, self.count, self.step, self.action.demand
        pitch, torque, yaw_rate = before.pitch, before.generator_torque, setpoint.yaw_rate
        turn, rise = setpoint.pitch - pitch, setpoint.generator_torque - torque
        gain, n_blades, together, filtered = self.pitch_gain, self.turbine.n_blades, self._reads_together, self._filters
        observer, watcher = linear_part(controller), fault_supervisor_of(controller)
        for k in range(1, count + 1):
            part = k / count
            if together:
                signals = cast("Signals", self._taken)
            elif filtered:
                signals = self.measured(signals)
            if controller is not None:
                read = self._read_by_controller(signals)
                self.base = checked_demand(controller.step(read, dt), controller, n_blades)
            believed: Readings = signals if watcher is None else watcher.believed(signals)
            wanted, speed = pitch + part * turn, believed["rotor_speed"]
            if residual is not None:
                wanted = residual.acting(wanted, self.base.pitch, speed, dt)
            offset = torque + part * rise
            if bound is not None and (share := bound.agent_share) != 1.0:
                wanted, offset = share * wanted, share * offset
                if residual is not None:
                    residual.mean *= share
            present = AgentSetpoint(wanted, yaw_rate, offset)
            demand = demand_of(present, self.base, believed["azimuth"], speed)
            if guarded and watcher is not None:
                demand = watcher.with_agent(self.base, demand)
            self.demand = demand
            if observer is not None:
                observer.see_demand(self.base, demand, believed, dt)
            if watcher is not None:
                watcher.take_demand(demand)
            moved = demand.pitch if gain is None else gain.moved(demand.pitch, dt)
            signals = simulator.advance(dt, moved, demand.yaw_rate, demand.generator_torque, accumulate=k > 1)
            if self.instruments is not None:
                self._take(signals)
        if not math.isfinite(sum(signals.values.tolist())):  # a third of the time of numpy's
            raise SimulationError(f"the simulator returned values that are not finite at {signals['time']!r} s")
        self.signals, self.setpoint = signals, setpoint
        return signals

    # ---- states that can be observed ----

    @property
    def supervisor(self) -> Supervisor | None:
        """Supervisor of the base controller; a snapshot replaces the controller, so it is looked up."""
        return supervisor_of(self.controller) if self._supervised else None

    @property
    def yaw_drive(self) -> YawByDeadBand | None:
        """Dead-band control of the base controller."""
        return yaw_drive_of(self.controller)

    def known_disturbances(self) -> np.ndarray | None:
        """Knowledge of the linear optimal pitch of the base controller about the current instant."""
        part, watcher, signals = linear_part(self.controller), fault_supervisor_of(self.controller), self.readings()
        return None if part is None else part.known(signals if watcher is None else watcher.believed(signals))

    @property
    def demanded_power(self) -> float | None:
        """Demand of a grid operator at the current instant, None without one [W]."""
        return None if self.reference is None else self.reference.at(self.signals["time"])

    def infos(self) -> list[Callable[[], dict[str, Any]]]:
        """Functions that give the parts of `info` that the episode has beside those of every episode."""
        has_dip = any(isinstance(fault, VoltageDip) for fault in self.faults)
        parts = (
            (self.supervisor is not None, self._state_info), (has_dip, self._voltage_info),
            (self.reference is not None, self._power_info),
        )  # fmt: skip
        return [part for is_there, part in parts if is_there]

    def _state_info(self) -> dict[str, Any]:
        return {"state": cast("Supervisor", self.supervisor).state}

    def _voltage_info(self) -> dict[str, Any]:
        """Voltage of the grid over nominal at the current instant [-]."""
        dips = [fault for fault in self.faults if isinstance(fault, VoltageDip)]
        return {"grid_voltage": min(dip.voltage(self.signals["time"]) for dip in dips)}

    def _power_info(self) -> dict[str, Any]:
        return {"demanded_power": self.demanded_power}

    # ---- readings ----

    @property
    def _reads_together(self) -> bool:
        """The base controller reads the instruments of the agent."""
        return self.instruments is not None and self.everyone

    def measured(self, signals: Signals) -> Signals:
        """Signals as sound instruments read them, and sensors that fail."""
        for read in self._filters:
            signals = read(signals)
        return signals

    def readings(self) -> Signals:
        """Readings of an agent at the current instant."""
        return self.measured(self.signals) if self._taken is None else self._taken

    def seen(self) -> np.ndarray:
        """Readings of the lidar of an agent at the current instant [m/s]."""
        if self.instruments is None:
            return self.ahead(self.readings())
        return self.instruments.seen(self._looked(self.instruments.instant))

    def _take(self, signals: Signals) -> None:
        """Read the instruments, if there are any, at the current instant."""
        if self.instruments is None:
            self._taken = None
            return
        failing = self._filters
        if self.pitch_gain is not None:
            signals, failing = self.pitch_gain.read(signals), failing[1:]
        taken = self.instruments.take(signals)
        for read in failing:
            taken = read(taken)
        self._taken = taken

    def ahead(self, signals: Signals) -> np.ndarray:
        """Readings of the lidar at an instant [m/s]: a look serves the observation and the controller's next step."""
        return self._looked((signals["time"], signals["yaw"]))

    def _looked(self, instant: tuple[float, float]) -> np.ndarray:
        if self._look is None or self._look[0] != instant:
            where = self.turbine.hub_height, self.turbine.rotation
            self._look = instant, self.lidar.read(self.wind.inflow, *instant, *where)
        return self._look[1]

    def _read_by_controller(self, signals: Signals) -> Readings:
        """Readings of the base controller: signals, its lidar, demanded power."""
        read: Readings = signals
        if self._lidar_is_read:
            read = WithLidar(signals, self.seen() if self._reads_together else self.ahead(signals), self.lidar)
        reference = self.reference
        return read if reference is None else WithDemandedPower(read, reference.at(signals["time"]), reference)

    # ---- snapshots ----

    def resume(self, memory: Mapping[str, Any], wind: EpisodeWind, state: Any) -> None:
        """Continue with a memory in a wind from a state of the simulator; None: as the simulator is."""
        simulator = self._enter(wind, memory["plant"], memory["faults"])
        self.meet(memory["sea"])
        if state is not None:
            simulator.restore(state)
        self.recall(memory)
        self._resolve()
