"""A turbine in operation: simulator, base controller and the set points of an agent, one control step at a time."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from wt_gym.base.errors import SimulationError
from wt_gym.control import AgentSetpoint, Demand
from wt_gym.control.controllers import WithDemandedPower, WithLidar, checked_demand, lidar_of
from wt_gym.control.controllers.fault_supervisor import fault_supervisor_of
from wt_gym.control.controllers.linear_optimal import linear_part
from wt_gym.control.controllers.supervisor import supervisor_of
from wt_gym.simulation import Simulator
from wt_gym.simulation.drivetrain.faults import DriveFault, PitchMisalignment, SensorBias, VoltageDip
from wt_gym.simulation.fidelity import fidelity as fidelity_of

if TYPE_CHECKING:
    from wt_gym.control import ActionMap, Lidar
    from wt_gym.control.controllers import Controller, Readings
    from wt_gym.control.controllers.additions import ResidualPitch
    from wt_gym.control.controllers.supervisor import Supervisor
    from wt_gym.envs.episode_start import Beginning
    from wt_gym.envs.fault_draws import DrawnFault
    from wt_gym.envs.instruments import Instruments
    from wt_gym.envs.pitch_gain import PitchGain
    from wt_gym.envs.power_reference import PowerReference
    from wt_gym.envs.variation import DrawnVariation, VariationDraws
    from wt_gym.envs.wind_sampler import EpisodeWind
    from wt_gym.simulation import Fidelity, Signals
    from wt_gym.simulation.contract import SimulatorMaker, TurbineSimulator
    from wt_gym.turbines import BladeIce, Turbine
    from wt_gym.wind import Inflow

__all__ = ["Operation", "make_simulator"]

_NOMINAL = -1
"""Plant of the turbine itself."""
_MEMORY = (
    "signals", "demand", "base", "setpoint", "controller", "residual", "faults", "drawn", "instruments", "pitch_gain",
    "_taken", "reference", "fault",
)  # fmt: skip


def make_simulator(turbine: Turbine, inflow: Inflow, fidelity: str | Fidelity) -> TurbineSimulator:
    """Make what environments simulate a turbine with."""
    return cast("TurbineSimulator", Simulator(turbine, inflow=inflow, fidelity=fidelity_of(fidelity)))


class Operation:
    """A turbine in the wind of an episode, under a base controller and an agent.

    Parameters
    ----------
    turbine : Turbine
    action : ActionMap
    controller : Controller or None
        Base controller, stepped at the step of the simulator.
    residual : ResidualPitch or None
        What residual pitch passes.
    lidar : Lidar
        Whose readings are observed, and read by a controller that has one.
    fidelity : str or Fidelity
    step : float
        Of the simulator [s].
    count : int
        Such steps in a control step.
    make : callable
        Makes the simulator, see `make_simulator`; called at the first start of each turbine of a variation.
    draws : VariationDraws, optional
        Makes the instruments of episodes with a variation.

    Attributes
    ----------
    lidar : Lidar
    make_simulator : callable
    simulator : TurbineSimulator or None
        None before the first start.
    wind : EpisodeWind
    signals : Signals
        Of the simulator at the present instant.
    demand : Demand
        On the drives.
    base : Demand
        Of the base controller.
    setpoint : AgentSetpoint
        What the agent asks for.
    faults : tuple
        What fails, and when.
    drawn : DrawnVariation or None
        What the episode has of a variation.
    instruments : Instruments or None
        What is read with, where readings are not exact.
    reference : PowerReference or None
        What a grid operator asks for.
    fault : DrawnFault or None
        What of the faults of the environment breaks; its faults are among ``faults``.
    pitch_gain : PitchGain or None
        Response to pitch, where it is not that of the model.
    step : float
        Of the simulator [s].
    count : int
        Such steps in a control step.
    """

    wind: EpisodeWind
    demand: Demand
    base: Demand
    setpoint: AgentSetpoint

    def __init__(
        self,
        turbine: Turbine,
        action: ActionMap,
        controller: Controller | None,
        residual: ResidualPitch | None,
        lidar: Lidar,
        fidelity: str | Fidelity,
        step: float,
        count: int,
        make: SimulatorMaker,
        draws: VariationDraws | None = None,
    ):
        self.turbine, self.action, self.controller, self.residual = turbine, action, controller, residual
        self.lidar, self._fidelity, self.make_simulator = lidar, fidelity, make
        self.step, self.count = step, count
        self._supervised = supervisor_of(controller) is not None
        self._draws = draws
        self._simulators: dict[tuple[int, BladeIce | None], TurbineSimulator] = {}
        self.simulator: TurbineSimulator | None = None
        self.drawn: DrawnVariation | None = None
        self.instruments: Instruments | None = None
        self.pitch_gain: PitchGain | None = None
        self.reference: PowerReference | None = None
        self.fault: DrawnFault | None = None
        self._taken: Signals | None = None
        self.signals = cast("Signals", None)  # before the first start, for which everything that needs them asks
        self.faults: tuple[DriveFault | SensorBias, ...] = ()
        self._sensor_faults: tuple[SensorBias | PitchMisalignment, ...] = ()
        self._drive_faults: tuple[DriveFault, ...] = ()
        self._look: tuple[tuple[float, float], np.ndarray] | None = None

    # ---- starts ----

    def begin(self, beginning: Beginning) -> None:
        """Start simulator and controller."""
        start, yaw, drawn = beginning.start, beginning.yaw, beginning.drawn
        simulator = self._enter(beginning.wind, beginning.faults, drawn, beginning.fault)
        self.drawn, self.reference, self.fault = drawn, beginning.reference, beginning.fault
        self.pitch_gain = None if drawn is None else drawn.pitch_gain()
        self.instruments = None if drawn is None or self._draws is None else self._draws.instruments(drawn)
        self.signals = simulator.reset(
            rotor_speed=start.rotor_speed, pitch=start.pitch, azimuth=start.azimuth, yaw=yaw,
            generator_torque=start.generator_torque, tower_top=start.tower_top, wake_thrust=start.wake_thrust,
            motion=start.motion,
        )  # fmt: skip
        self.demand = self.base = Demand(start.pitch.copy(), 0.0, start.generator_torque)
        self.setpoint = self.action.start(self.demand)
        if self.pitch_gain is not None:
            self.pitch_gain.start(start.pitch)
        self._take()
        if self.controller is not None:
            start.start(self.controller, self._read_by(self.controller), self.demand)
        if self.residual is not None:
            pitch = start.pitch[0] + float((start.pitch - start.pitch[0]).mean())  # exactly that of equal blades
            self.residual.start(pitch, start.rotor_speed, self.step)

    def _enter(
        self,
        wind: EpisodeWind,
        faults: tuple[DriveFault | SensorBias, ...],
        drawn: DrawnVariation | None,
        fault: DrawnFault | None,
    ) -> TurbineSimulator:
        """Put the simulator of the turbine into a wind, with these faults and no others; the lidar has not looked yet.

        Each turbine of a variation, and each with ice, has a simulator, which is made when it is drawn for the first
        time.
        """
        self.wind, self._look = wind, None
        plant = _NOMINAL if drawn is None or not drawn.structural else drawn.plant
        ice = None if fault is None else fault.ice
        kept = self._simulators.get((plant, ice))
        if kept is None:
            turbine = self.turbine if drawn is None else drawn.turbine
            turbine = turbine if ice is None else replace(turbine, ice=ice)
            kept, self._drive_faults = self.make_simulator(turbine, wind.inflow, self._fidelity), ()
            self._simulators[plant, ice] = kept
        else:
            kept.inflow = wind.inflow
            if kept is not self.simulator:
                self._drive_faults = tuple(kept.faults)
        self.simulator = kept
        self.faults = faults
        self._sensor_faults = tuple(one for one in faults if isinstance(one, SensorBias | PitchMisalignment))
        drive_faults = tuple(one for one in faults if isinstance(one, DriveFault))
        if drive_faults != self._drive_faults:
            self.simulator.faults = self._drive_faults = drive_faults
        return self.simulator

    def close(self) -> None:
        """Release all simulators."""
        for simulator in self._simulators.values():
            if (close := getattr(simulator, "close", None)) is not None:
                close()
        self._simulators.clear()
        self.simulator = None

    # ---- steps ----

    def advance(self, setpoint: AgentSetpoint) -> Signals:
        """Simulate a control step, in which the demand moves to what the agent asks for at every step of the simulator.

        Raises
        ------
        wt_gym.base.errors.SimulationError
            If the simulation fails; what the agent asked for before and the signals stay as they were.
        wt_gym.base.errors.ControllerError
            If the base controller gives a demand without meaning.
        """
        simulator, controller, residual = self.simulator, self.controller, self.residual
        if simulator is None:
            raise SimulationError("the turbine does not run: it must be started first")
        bound = None
        if (supervisor := self.supervisor) is not None:
            # an integral of the agent that went on where it does not act would have to come back first
            supervisor.asked = supervisor.acting_offset(setpoint.set_point)
            setpoint = replace(setpoint, set_point=supervisor.asked)
            bound = supervisor if self.action.mode == "residual" else None
        before, signals, count, dt, demand_of = self.setpoint, self.signals, self.count, self.step, self.action.demand
        pitch, torque, yaw_rate = before.pitch, before.generator_torque, setpoint.yaw_rate
        turn, rise = setpoint.pitch - pitch, setpoint.generator_torque - torque
        sees = controller is not None and lidar_of(controller) is not None
        gain, n_blades = self.pitch_gain, self.turbine.n_blades
        biased, together = bool(self._sensor_faults) or gain is not None, self._reads_together
        observer, reference, watcher = linear_part(controller), self.reference, fault_supervisor_of(controller)
        guarded = self.action.mode == "residual"
        for k in range(1, count + 1):
            part = k / count
            if together:
                signals = cast("Signals", self._taken)
            elif biased:
                signals = self.measured(signals)
            if controller is not None:
                read: Readings = self._with_lidar(signals, together) if sees else signals
                if reference is not None:
                    read = WithDemandedPower(read, reference.at(signals["time"]), reference)
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
            pitch_moved = demand.pitch if gain is None else gain.moved(demand.pitch, dt)
            signals = simulator.advance(dt, pitch_moved, demand.yaw_rate, demand.generator_torque, accumulate=k > 1)
            if self.instruments is not None:
                self._take(signals)
        if not math.isfinite(sum(signals.values.tolist())):  # a third of the time of numpy's
            raise SimulationError(f"the simulator returned values that are not finite at {signals['time']!r} s")
        self.signals, self.setpoint = signals, setpoint
        return signals

    @property
    def supervisor(self) -> Supervisor | None:
        """Supervisor of the base controller, None without any; a snapshot replaces the controller, so none is kept."""
        return supervisor_of(self.controller) if self._supervised else None

    @property
    def grid_voltage(self) -> float | None:
        """Voltage of the grid over nominal at the present instant, None where it does not dip in the episode [-]."""
        dips = [fault.voltage(self.signals["time"]) for fault in self.faults if isinstance(fault, VoltageDip)]
        return min(dips) if dips else None

    # ---- what is measured ----

    @property
    def _reads_together(self) -> bool:
        """Whether the base controller reads the instruments of the agent."""
        return self.instruments is not None and self._draws is not None and self._draws.everyone

    def measured(self, signals: Signals) -> Signals:
        """Signals as sound instruments read them, and sensors that fail."""
        if self.pitch_gain is not None:
            signals = self.pitch_gain.read(signals)
        return self._failing(signals)

    def readings(self) -> Signals:
        """What an agent reads at the present instant."""
        return self.measured(self.signals) if self._taken is None else self._taken

    def seen(self) -> np.ndarray:
        """What the lidar gives an agent at the present instant [m/s]."""
        if self.instruments is None:
            return self.ahead(self.readings())
        return self.instruments.seen(self._looked(self.instruments.instant))

    def _take(self, signals: Signals | None = None) -> None:
        """Read the instruments, if there are any, at the present instant."""
        if self.instruments is None:
            self._taken = None
            return
        signals = self.signals if signals is None else signals
        read = signals if self.pitch_gain is None else self.pitch_gain.read(signals)
        self._taken = self._failing(self.instruments.take(read))

    def _failing(self, signals: Signals) -> Signals:
        """Readings with those of failing sensors."""
        for fault in self._sensor_faults:
            signals = fault.read(signals)
        return signals

    def ahead(self, signals: Signals) -> np.ndarray:
        """What the lidar sees at an instant [m/s]: a look is for the observation and for the controller's next step."""
        return self._looked((signals["time"], signals["yaw"]))

    def _looked(self, instant: tuple[float, float]) -> np.ndarray:
        if self._look is None or self._look[0] != instant:
            where = self.turbine.hub_height, self.turbine.rotation
            self._look = instant, self.lidar.read(self.wind.inflow, *instant, *where)
        return self._look[1]

    def _with_lidar(self, signals: Signals, together: bool) -> WithLidar:
        """Signals and what the lidar gives a controller with them."""
        return WithLidar(signals, self.seen() if together else self.ahead(signals), self.lidar)

    def _read_by(self, controller: Controller) -> Readings:
        """What a controller reads at the present instant: signals, what its lidar sees, what is asked for."""
        together = self._reads_together
        signals = self.readings() if together else self.measured(self.signals)
        read: Readings = signals
        if lidar_of(controller) is not None:
            read = self._with_lidar(signals, together)
        reference = self.reference
        return read if reference is None else WithDemandedPower(read, reference.at(signals["time"]), reference)

    # ---- snapshots ----

    def memory(self) -> dict[str, Any]:
        """Give what the operation is in the midst of beside the simulator, as it is; for `recall`."""
        return {name: self.__dict__[name] for name in _MEMORY}

    def recall(self, memory: dict[str, Any], wind: EpisodeWind, state: Any) -> None:
        """Continue with a memory in a wind from a state of the simulator; None: as the simulator is."""
        simulator = self._enter(wind, memory["faults"], memory["drawn"], memory["fault"])
        if state is not None:
            simulator.restore(state)
        self.__dict__.update(memory)
