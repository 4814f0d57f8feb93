"""The coupled simulator: flexible multibody turbine and free-wake vortex lattice marched together in time."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from wt_gym.aerodynamics.options import AerodynamicsError
from wt_gym.base.errors import ActionError, InflowError, SimulationError
from wt_gym.base.quantities import Array
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.multibody.arrays import Drift, MultibodyError
from wt_gym.multibody.system import check_state
from wt_gym.multibody.tree.point_kernels import point_motion
from wt_gym.simulation.channels import TOWER_TOP_PARITIES, Signals, parities, reflected_loads, reflected_shapes
from wt_gym.simulation.compilation import compile_ahead, compile_once, compile_step
from wt_gym.simulation.contract import DrivenSimulator, SimulatorState, WindChoice, fingerprint
from wt_gym.simulation.drivetrain.drives import Drives, GeneratorLaw, check_damper_step, check_finite
from wt_gym.simulation.drivetrain.faults import DriveFault
from wt_gym.simulation.fidelity import Fidelity, choose_fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.simulation.models import assemble
from wt_gym.simulation.start import Starter
from wt_gym.simulation.step.coupling import Coupling
from wt_gym.simulation.step.coupling_data import Measurement
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.turbines.variants import REFLECTION_6, clockwise_image, with_generator
from wt_gym.wind import Inflow

if TYPE_CHECKING:
    from wt_gym.simulation.linear_model import LinearModel, RotorPoint

_Arguments = tuple[Turbine, Inflow, Fidelity, int, GeneratorLaw, WaveComponents | None]


class Simulator(DrivenSimulator):
    """A wind turbine in the wind.

    Parameters
    ----------
    turbine : str, path or Turbine
        Name in the catalog, path of a windIO file or OpenFAST model (.fst), or a turbine.
    inflow : Inflow, path or mapping
        Undisturbed wind, or what describes it (`wt_gym.wind.files`). A turbulence box must reach around the rotor.
    fidelity : str or Fidelity, optional
        "training", "engineering", "reference" or another of `FIDELITIES`, or one of your own; by default
        "training-torsion" where the blades twist, else "training" (`wt_gym.simulation.fidelity`).
    threads : int
        Threads that share the tree code of the wake at "reference". The numbers do not depend on it.
    generator : "torque", "damper" or GeneratorLaw, optional
        What loads the rotor: a torque that is demanded, which is what most turbines have; the damper of the turbine,
        see `wt_gym.turbines.variants.with_damper`; or a law, see `wt_gym.simulation.drivetrain.drives`.
    sea : WaveComponents, optional
        Waves, where the turbine floats; by default the water is still.

    Attributes
    ----------
    inflow : Inflow
        May be exchanged before a reset.
    time_step : float
        Aerodynamic step [s]; ``advance`` takes whole numbers of it.
    coupling : Coupling
        Structure and air in their current state.
    mirrored : bool
        Whether the rotor turns counter-clockwise. Structure, lattice, coupling and drives are then those of the mirror
        image, whose rotor turns clockwise, in the mirrored wind (`wt_gym.simulation.channels`); arguments, signals
        and shapes are those of the turbine.
    faults : tuple of wt_gym.simulation.drivetrain.faults.DriveFault
        What fails, and when. As the inflow it may be exchanged before a reset, and does not belong to a snapshot.

    Examples
    --------
    >>> from wt_gym.wind import SteadyInflow
    >>> sim = Simulator("nrel_5mw", inflow=SteadyInflow(8.0))
    >>> signals = sim.reset(rotor_speed=0.96)
    >>> signals = sim.advance(0.2, pitch=(0.0, 0.0, 0.0), yaw_rate=0.0, generator_torque=19.3e3)
    """

    def __init__(
        self,
        turbine: str | Path | Turbine = "nrel_5mw",
        inflow: WindChoice | None = None,
        fidelity: str | Fidelity | None = None,
        threads: int = 1,
        generator: str | GeneratorLaw | None = None,
        sea: WaveComponents | None = None,
    ) -> None:
        turbine = turbine if isinstance(turbine, Turbine) else load_turbine(turbine)
        choice = choose_fidelity(turbine, fidelity)
        self.turbine, law = with_generator(turbine, generator)
        image = clockwise_image(self.turbine)
        self.mirrored = image is not self.turbine
        self.inflow, self.fidelity, self._threads = inflow, fidelity_of(choice), threads
        self.sea = sea
        self.drives = Drives(image, law)
        compile_once(Coupling, image, self.fidelity, partial(compile_ahead, Simulator))
        models = assemble(image, self.fidelity, threads, self.drives.generator.damping)
        self.time_step, self.structure, self.lattice = models.time_step, models.structure, models.lattice
        _check_damper(image, self.structure.shaft_flexible, self.time_step)
        self.coupling, self._azimuth_u = Coupling(models), models.structure.azimuth_u
        self._starter = Starter(self.coupling, self.drives)
        self._measurement = Measurement(image, self.structure, self.coupling.gauges)
        self._model = fingerprint(self.turbine, self.fidelity, self.drives.generator)
        self._n_steps, self._started, self._reset_here = 0, False, False
        self._compiled, self._met = False, cast("WaveComponents | None", None)

    def __getstate__(self) -> tuple[_Arguments, tuple[DriveFault, ...], SimulatorState | None, WaveComponents | None]:
        """What a copy or a pickle takes along: the arguments and the state; the rest is rebuilt from them."""
        arguments = self.turbine, self.inflow, self.fidelity, self._threads, self.drives.sound_generator, self._met
        return arguments, self._faults, self.state() if self._started else None, self._sea

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        """Build the models and continue from the state."""
        arguments, faults, state, sea = kept
        self.__init__(*arguments)  # type: ignore[misc]  # no subclass takes other arguments
        self.faults = faults
        if state is not None:
            self.restore(state)
        self.sea = sea  # one that was exchanged since the start is met from the next one on

    @property
    def signals(self) -> Signals:
        """Signals at the current time, a fresh copy."""
        self._require_start()
        values, n_blades = self._measurement.values, self.turbine.n_blades
        if self.mirrored:
            return Signals(values * parities(n_blades, self.turbine.n_lines), n_blades)
        return Signals(values.copy(), n_blades)

    def reset(  # noqa: PLR0913
        self,
        rotor_speed: float,
        pitch: ArrayLike = 0.0,
        azimuth: float = 0.0,
        yaw: float = 0.0,
        generator_torque: float | None = None,
        tower_top: ArrayLike | None = None,
        wake_thrust: float | None = None,
        motion: ArrayLike | None = None,
        platform: ArrayLike | None = None,
    ) -> Signals:
        """Start at time zero near a steady state: developed wake, deflected structure that turns with the rotor.

        Parameters
        ----------
        rotor_speed : float
            [rad/s], not negative.
        pitch : float or array (n_blades,)
            [rad].
        azimuth : float
            Of blade 1, in the sense of rotation [rad].
        yaw : float
            Nacelle yaw, counter-clockwise from above [rad].
        generator_torque : float, optional
            High-speed shaft [N m]; by default what balances the torque of the air.
        tower_top : array (4,), optional
            Displacement of the tower top, fore-aft and side-side [m], and its rates [m/s]: the tower starts amid a
            swing in its first modes. By default it stands still where its loads are in balance.
        wake_thrust : float, optional
            Mean thrust of the air on the rotor over some ten seconds before [N], in which the wake was shed. By default
            that of the start.
        motion : array (n,), optional
            Motion of the structure, as `motion` gives it of a simulator with the same turbine and fidelity, to continue
            with its velocities and accelerations; ``tower_top`` is then left aside. Modal coordinates, formulation
            "embedded" and an explicit integrator only.
        platform : array (12,), optional
            Slow motion of a floater at the start: surge, sway, heave, roll, pitch, yaw and their rates [m, rad; m/s,
            rad/s], angles from -1 to 1, by default those of the balance. The motion by the waves of the start is added.

        Raises
        ------
        ActionError
            For values that are not finite or out of range.
        SimulationError
            When no steady state is found, for example because the wind bends the blades beyond the elastic model.
        """
        limit = self.coupling.exchange.max_speed
        check_finite(rotor_speed=rotor_speed, azimuth=azimuth, yaw=yaw)
        if not 0.0 <= rotor_speed < limit:
            raise ActionError(f"rotor_speed is {rotor_speed} rad/s; must be 0 … {limit:.3f} rad/s")
        if abs(yaw) > 2.0 * np.pi:
            raise ActionError(f"yaw must be within one turn to either side, got {yaw} rad")
        tower_top = self._checked_tower_top(tower_top)
        if motion is not None:
            motion = np.asarray(motion, dtype=float)
            size = self.structure.n_motion
            if not self.takes_motion or motion.shape != (size,) or not np.isfinite(motion).all():
                raise ActionError(
                    f"motion must be {size} finite numbers, for modal coordinates, formulation 'embedded', an explicit "
                    f"integrator and a turbine on the ground; got shape {motion.shape} for {self.fidelity!r:.200}"
                )
        platform = self._checked_platform(platform)
        if wake_thrust is not None:
            check_finite(wake_thrust=wake_thrust)
        if not self._compiled:  # to look that up takes as long as half a start
            compile_step(self.coupling, self.coupling.models.turbine)
            self._compiled = True
        self.drives.start(pitch, -yaw if self.mirrored else yaw, rotor_speed, generator_torque)
        self._n_steps, self._started = 0, False
        self._meet_sea()
        try:
            self._starter.balance(
                rotor_speed, azimuth, generator_torque, self._felt, tower_top, wake_thrust, motion, platform
            )
        except (MultibodyError, AerodynamicsError, SimulationError, InflowError) as error:
            raise SimulationError(f"no start at {rotor_speed} rad/s in {self.inflow.description}: {error}") from error
        self._started = self._reset_here = True
        self._measure()
        return self.signals

    def advance(
        self,
        duration: float,
        pitch: ArrayLike,
        yaw_rate: float = 0.0,
        generator_torque: float = 0.0,
        accumulate: bool = False,
    ) -> Signals:
        """Simulate for a while with constant demands; the drives follow them within their limits.

        Parameters
        ----------
        duration : float
            A whole number of time steps [s].
        pitch : float or array (n_blades,)
            Demanded pitch [rad]; followed at no more than the pitch rate limit, within the pitch range.
        yaw_rate : float
            Demanded yaw rate [rad/s], limited to the yaw drive's rate.
        generator_torque : float
            Demanded torque on the high-speed shaft [N m]; rate-limited and kept between 0 and the generator's maximum,
            which falls to zero as the rotor stops.
        accumulate : bool
            Whether extremes and travel in the signals continue from those of the call before; otherwise, and after a
            reset, they restart.

        Returns
        -------
        Signals
            At the end.

        Raises
        ------
        ActionError
            For demands that are not finite or a duration that is not a multiple of the time step.
        SimulationError
            When the simulation diverges, or the inflow gives no wind; the simulator must then be reset.
        """
        self._require_start()
        drives, coupling = self.drives, self.coupling
        pitch = drives.pitch.vector(pitch)
        n = self._steps_in(duration, yaw_rate=yaw_rate, generator_torque=generator_torque)
        if not accumulate:
            coupling.extremes.restart()
        inputs, azimuth_u, step = coupling.integrator.inputs, self._azimuth_u, self.time_step
        inflow, yaw_rate = self._felt, -yaw_rate if self.mirrored else yaw_rate
        for _ in range(n):
            drives.follow(pitch, yaw_rate, generator_torque, step, coupling.generator_speed)
            drives.act(inputs, azimuth_u)
            try:
                coupling.step(inflow, self._n_steps * step)
            except (SimulationError, AerodynamicsError, InflowError) as error:
                self._started = False
                raise SimulationError(f"simulation failed at {self.time:.3f} s: {error}") from error
            self._n_steps += 1
        torque = drives.torque(coupling.generator_speed)
        self._measurement.complete(self._n_steps * step, torque, drives.command, coupling.extremes)
        return self.signals

    # ---- snapshots and pictures ----

    def state(self) -> SimulatorState:
        """Snapshot from which the simulation continues bit for bit."""
        self._require_start()
        return SimulatorState.take(self._state_arrays(), self._n_steps, self._fingerprint())

    def restore(self, state: SimulatorState) -> None:
        """Continue from a snapshot of a simulator with the same turbine and fidelity, in the same sea.

        Raises
        ------
        SimulationError
            When the snapshot does not fit, or its motion has no meaning.
        """
        self._started = self._reset_here = False
        self._meet_sea()
        state.put(self._state_arrays(), self._fingerprint())
        try:
            check_state(self.structure.system, self.coupling.integrator.state)
        except MultibodyError as error:
            raise SimulationError(f"the snapshot holds no state: {error}") from error
        self._n_steps = state.n_steps
        self._started = True
        self.coupling.resume()

    def root_multipliers(self) -> Array:
        """Lagrange multipliers of the constraints that hold the blades: the loads which the hub exerts on them.

        They cost nothing unless they are asked for, and need ``formulation="constrained"``. ``-multipliers[:, 4]`` is
        the channel root_flap_moment, ``-multipliers[:, 3]`` root_edge_moment, ``-multipliers[:, 5]`` root_torsion.

        Returns
        -------
        array (n_blades, 6)
            Force [N] and moment about the root [N m], in the axes of the pitched root: of its image, where the rotor
            turns counter-clockwise, as the channels of a blade.

        Raises
        ------
        SimulationError
            Without constraint equations.
        """
        self._require_start()
        return self.coupling.motion.root_multipliers()

    def ground_loads(self) -> Array:
        """Force and moment with which the turbine rests on the ground: at the sea bed on a monopile.

        Returns
        -------
        array (6,)
            Force [N] and moment [N m] about the undeflected foot of the tower or of its support, global axes. On a
            monopile it holds what the water bears (see `Support`); without one, the moments about x and y are the
            channels tower_base_moment_x and tower_base_moment_y.
        """
        self._require_start()
        values = self._measurement.values.copy()
        self._measure()  # which knows no extremes since the last sample: those stay
        self._measurement.values[:] = values
        loads = -self._measurement.gauges.wrench[self.structure.tower]
        if self.turbine.tower.support is not None:
            force, depth = loads[:3], self.turbine.tower.support.length
            loads[3] -= depth * force[1]
            loads[4] += depth * force[0]
        return reflected_loads(loads) if self.mirrored else loads

    @property
    def takes_motion(self) -> bool:
        """Whether a start may continue a motion."""
        return self.fidelity.takes_motion and self.turbine.floater is None

    def tower_top(self) -> Array:
        """Motion of the tower top as it is now, in the form that `reset` takes.

        Returns
        -------
        array (4,)
            Displacement along and across the heading of the nacelle [m] and its rates [m/s].
        """
        self._require_start()
        coupling = self.coupling
        coupling.move_lattice(coupling.integrator.state)
        work, yaw = coupling.integrator.work, self.drives.command[1]
        cos, sin = np.cos(yaw), np.sin(yaw)
        to_heading = np.array([[cos, sin], [-sin, cos]])
        top = np.concatenate([to_heading @ part for part in self.structure.tower_deflection(work)])
        return top * TOWER_TOP_PARITIES if self.mirrored else top

    def motion(self) -> Array:
        """Deformation of the structure, its rates and accelerations, array (n,), in the form of `reset`.

        The tower moves along and across the nacelle. A rotor that turns counter-clockwise has that of its image.
        """
        self._require_start()
        integrator = self.coupling.integrator
        return self.structure.motion(integrator.state, integrator.state_rate, self.drives.command[1])

    def slow_platform(self) -> Array:
        """Motion of a floater since its `reset` without its answer to the waves, array (12,), as `reset` takes it."""
        self._require_start()
        if self.turbine.floater is None or not self._reset_here:
            raise SimulationError("slow_platform must be asked of a floating turbine since its last reset")
        slow = self.structure.platform(self.coupling.integrator.state) - self._starter.wave_motion(self.time)
        return slow * np.tile(REFLECTION_6, 2) if self.mirrored else slow

    def constraint_drift(self, restart: bool = True) -> Drift:
        """How far steps have drifted off the constraint equations before they were put back onto them.

        Parameters
        ----------
        restart : bool
            Forget it after.

        Returns
        -------
        Drift
            ``norm``: largest | |q| − 1 | of a quaternion; ``position`` [m or rad] and ``velocity`` [m/s or rad/s]:
            largest residual of a constraint equation and of its rate, over all steps and passes since the last time.
            Zeros without constraint equations.
        """
        drift: Drift = self.coupling.integrator.drift
        if restart:
            self.coupling.integrator.restart_drift()
        return drift

    def _state_arrays(self) -> dict[str, NDArray[Any]]:
        """Every array that carries state, by name."""
        out: dict[str, NDArray[Any]] = self.coupling.arrays() | {
            "command": self.drives.command,
            "values": self._measurement.values,
        }
        if self.drives.generator_command.size > 1:
            out["generator_command"] = self.drives.generator_command
        return out

    def linearize(self, operating_point: RotorPoint | None = None, **options: Any) -> LinearModel:
        """Linear model about a steady operating point; see :func:`wt_gym.simulation.linearization.linearize`."""
        from wt_gym.simulation.linearization import linearize  # it builds on simulators

        return linearize(self, operating_point, **options)

    def geometry(self) -> dict[str, Array]:
        """Shapes for pictures, global coordinates [m].

        Returns
        -------
        dict
            "blades" (n_blades, n_chord + 1, n_span + 1, 3) ring nodes; "wake" (n_rows + 1, n_blades, n_span + 1, 3);
            "wake_circulation" (n_rows, n_blades, n_span) [m²/s], of a counter-clockwise rotor with the other sign;
            "tower" (n, 3) axis and "tower_radius" (n,); "hub" (3,); "nacelle" (2, 3) ends of the shaft. Of a floating
            turbine also "platform" (n, 2, 3), axes of its members, "platform_radius" (n,), "lines" (n_lines, n, 3),
            "sea" (n, m, 3), nodes of its surface.
        """
        self._require_start()
        coupling, s, y = self.coupling, self.structure, self.coupling.integrator.state
        work = coupling.integrator.work
        coupling.move_lattice(y)
        tower, velocity = np.zeros_like(s.tower_points.position), np.zeros_like(s.tower_points.position)
        frame = work.rot[s.tower], work.r[s.tower], work.v[s.tower], work.omega[s.tower]
        point_motion(*frame, *s.elastic(s.tower, y), s.tower_points, tower, velocity)
        shapes = {
            "blades": coupling.exchange.nodes.copy(),
            "wake": coupling.aero.wake_nodes.copy(),
            "wake_circulation": coupling.aero.wake_circulation.copy(),
            "tower": tower,
            "tower_radius": s.tower_radius.copy(),
            "hub": work.r[s.hub].copy(),
            "nacelle": np.array([work.r[s.hub], work.r[s.generator]]),
        }
        if coupling.platform is not None and s.floater is not None:
            segments, radius = coupling.platform.outline()
            shapes["platform"] = work.r[s.floater] + segments @ work.rot[s.floater].T
            shapes["platform_radius"], shapes["lines"] = radius, coupling.platform.line_points()
            shapes["sea"] = coupling.platform.surface(self.time, self.turbine.rotor_diameter)
        return reflected_shapes(shapes) if self.mirrored else shapes

    def _meet_sea(self) -> None:
        """Let the floater meet the waves of now."""
        if self._met is not self._sea:
            sea = self._sea.mirrored() if self.mirrored and self._sea is not None else self._sea
            self.coupling.set_sea(sea)
            self._met = self._sea

    def _fingerprint(self) -> str:
        """Fingerprint of turbine, fidelity and sea: in another sea a floater would not continue bit for bit."""
        return self._model if self._met is None else fingerprint(self._model, self._met)

    def _require_start(self) -> None:
        if not self._started:
            raise SimulationError("the simulator is not running: call reset() first, also after a failed simulation")

    def _measure(self) -> None:
        """Fill the channel values from the current state, without a past."""
        coupling, drives = self.coupling, self.drives
        torque = drives.torque(coupling.generator_speed)
        self._measurement.take(self.time, coupling.instant, torque, drives.command, self._felt, coupling.exchange.water)


def _check_damper(turbine: Turbine, flexible: bool, time_step: float) -> None:
    """Refuse a damper of a shaft that does not twist, or twists too fast for the step."""
    if turbine.drivetrain.shaft_damper is not None and not flexible:
        raise SimulationError(
            f"the shaft of {turbine.name!r} is rigid at this fidelity (Fidelity.stiffest_shaft); a shaft_damper must "
            "have a shaft that twists"
        )
    check_damper_step(turbine.drivetrain, time_step)
