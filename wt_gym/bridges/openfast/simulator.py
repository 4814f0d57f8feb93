"""OpenFAST behind the contract of `wt_gym.simulation.Simulator`."""

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from wt_gym.base.errors import ActionError, SimulationError
from wt_gym.base.quantities import Array
from wt_gym.bridges.openfast.measurement import Measurement
from wt_gym.bridges.openfast.model import steps_of, time_step_of, write_model
from wt_gym.bridges.openfast.process import OpenFASTProcess, find_library, relay_library
from wt_gym.bridges.openfast.run_folder import BentTurbine, RunTimes, ServedController, prepare_run
from wt_gym.bridges.openfast.wind import repeats
from wt_gym.hydrodynamics.waves import WaveComponents
from wt_gym.simulation import Fidelity
from wt_gym.simulation.channels import Signals, parities
from wt_gym.simulation.contract import DrivenSimulator
from wt_gym.simulation.drivetrain.drives import PITCH, TORQUE, Drives, check_damper_step, check_finite, holds_torque
from wt_gym.simulation.fidelity import choose_fidelity
from wt_gym.simulation.fidelity import fidelity as fidelity_of
from wt_gym.turbines import PitchSystem, Turbine, load_turbine
from wt_gym.turbines.openfast_text import InputFile
from wt_gym.turbines.variants import clockwise_image, with_generator
from wt_gym.wind import Inflow

COMMANDS = ("bladed", "inputs")
"""How demands get into OpenFAST."""

OPTIONS = ("openfast_library", "model", "commands", "duration", "step", "changes", "folder")
"""Arguments of `OpenFASTSimulator` that `Simulator` does not have."""


class OpenFASTSimulator(DrivenSimulator):
    """A wind turbine in the wind, simulated by OpenFAST.

    It takes and gives what `wt_gym.simulation.Simulator` does: the same demands through the same drives, and the same
    signals, with their frames, signs and units. ElastoDyn has the structure, AeroDyn the air (blade elements with
    dynamic inflow), and this package the drives: OpenFAST's blades stand at the pitch that it is given.

    Each simulation runs in a process of its own. What OpenFAST refuses, and a crash of its library, is a
    `SimulationError` here; the simulator can be reset and used on.

    Parameters
    ----------
    turbine : str, path or Turbine
        As of `Simulator`. The path of an OpenFAST model (``.fst``) is simulated with the files of the model.
    inflow : Inflow, path or mapping
        See `wt_gym.bridges.openfast.wind.write_wind` for what becomes of it.
    fidelity : str or Fidelity
        Gives the step between demands and nothing else.
    generator : "torque", optional
        A torque that is demanded; OpenFAST takes no other here.
    openfast_library : path, optional
        Of ``libopenfastlib``, version 5; see `wt_gym.bridges.openfast.process.find_library` for the default.
    model : path, optional
        Primary file (``.fst``) to simulate instead of one that is written of the turbine. Its wind, controller and
        outputs are replaced.
    commands : {"bladed", "inputs"}
        "bladed": through a small library that OpenFAST loads as its controller, with any build of OpenFAST; it is
        compiled at the first use and needs a C compiler or the PyPI package ``ziglang``. "inputs": as inputs of the
        library, for builds whose ServoDyn accepts PCMode = VSContrl = YCMode = 4.
    duration : float
        How long waves, and a wind that does not repeat itself, must last [s]; OpenFAST reads them whole at the start.
    step : float, optional
        Of OpenFAST [s], rounded so that whole ones make a step of the simulator; by default that of the model, or 1/396
        of a turn at rated speed, at most 0.0125 s.
    changes : mapping, optional
        Further inputs by module ("OpenFAST", "ElastoDyn", "AeroDyn", "ServoDyn") and keyword, as ``{"AeroDyn":
        {"UA_Mod": 3}}``; None leaves a keyword to OpenFAST.
    sea : WaveComponents, optional
        Waves, where the turbine floats; by default the water is still.
    folder : path, optional
        Keeps the files of the model and of the last start, in a folder ``run_…`` for each simulator; by default they
        are removed.

    Attributes
    ----------
    turbine, inflow, fidelity, time_step, drives, mirrored, faults
        As of `Simulator`. A rotor that turns counter-clockwise is simulated as its mirror image.
    openfast_step : float
        [s].
    model : Path
        Primary file of the model.

    Notes
    -----
    Every signal is there. ``tip_clearance`` follows from tip deflections and the motion of the tower top; extremes are
    over OpenFAST's steps. The start bends blades and tower as a steady wind would (`BentTurbine`); ``tower_top`` has an
    effect by its displacements, its rates and the arguments ``wake_thrust`` and ``motion`` have none: OpenFAST starts
    with a steady wake and a structure at rest except for the rotor. There are no snapshots, no linearization, no
    pictures.

    Examples
    --------
    >>> from wt_gym.wind import SteadyInflow
    >>> sim = OpenFASTSimulator("nrel_5mw", inflow=SteadyInflow(8.0))   # doctest: +SKIP
    >>> signals = sim.reset(rotor_speed=0.96)                            # doctest: +SKIP
    >>> signals = sim.advance(0.2, pitch=0.0, generator_torque=19.3e3)   # doctest: +SKIP
    """

    def __init__(  # noqa: PLR0913
        self,
        turbine: str | Path | Turbine = "nrel_5mw",
        inflow: Inflow | None = None,
        fidelity: str | Fidelity | None = None,
        generator: str | None = None,
        *,
        openfast_library: str | PathLike[str] | None = None,
        model: str | PathLike[str] | None = None,
        commands: str = "bladed",
        duration: float = 600.0,
        step: float | None = None,
        changes: Mapping[str, Mapping[str, Any]] | None = None,
        folder: str | PathLike[str] | None = None,
        sea: WaveComponents | None = None,
    ):
        self._process: OpenFASTProcess | None = None
        self._temporary: TemporaryDirectory[str] | None = None
        if commands not in COMMANDS:
            raise SimulationError(f"commands must be one of {', '.join(map(repr, COMMANDS))}; got {commands!r}")
        check_finite(duration=duration)
        if not duration > 0.0:
            raise SimulationError(f"duration must be above 0 s, got {duration!r}")
        self._library = find_library(openfast_library)
        self._relay = relay_library() if commands == "bladed" else None
        if model is None and not isinstance(turbine, Turbine) and str(turbine).lower().endswith(".fst"):
            model = turbine
        turbine = turbine if isinstance(turbine, Turbine) else load_turbine(turbine)
        self.turbine, law = with_generator(turbine, generator)
        if law is not None or not self.turbine.drivetrain.takes_torque:
            raise SimulationError("with OpenFAST the generator must be one that takes a torque; got a damper")
        self._image = clockwise_image(self.turbine)
        self.mirrored = self._image is not self.turbine
        self.fidelity = fidelity_of(choose_fidelity(turbine, fidelity))
        self.time_step = self.fidelity.step_for(self.turbine.drivetrain.rated_rotor_speed)
        check_damper_step(self._image.drivetrain, self.time_step)
        self.inflow, self.sea = inflow, sea
        self.drives = Drives(self._image)
        self._duration, self._changes, self._lasts = float(duration), dict(changes or {}), math.inf
        if folder is None:
            self._temporary = TemporaryDirectory(prefix="wt_gym_openfast_", ignore_cleanup_errors=True)
            folder = self._temporary.name
        Path(folder).mkdir(parents=True, exist_ok=True)
        self._folder = Path(mkdtemp(prefix="run_", dir=folder)).absolute()
        self.model = Path(model).absolute() if model is not None else write_model(self._image, self._folder / "model")
        self._count = steps_of(self.time_step, self._longest_step(step, model is not None))
        self.openfast_step = self.time_step / self._count
        self._path = PitchPath(self._image.pitch, self.time_step, self._count)
        self._bent = BentTurbine(self._image)
        self._measurement: Measurement | None = None
        self._n_steps = 0

    def _longest_step(self, step: float | None, own_model: bool) -> float:
        """Longest step that OpenFAST may take [s]."""
        if step is not None:
            check_finite(step=step)
            if not 0.0 < step <= self.time_step:
                raise SimulationError(f"step must be above 0 and at most {self.time_step:g} s, got {step!r}")
            return step
        if own_model:
            return InputFile(self.model).number("DT")
        return time_step_of(self._image)

    @property
    def signals(self) -> Signals:
        """Signals at the current time, a fresh copy."""
        return self._running()[1].signals(
            parities(self.turbine.n_blades, self.turbine.n_lines) if self.mirrored else None
        )

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
        """Start OpenFAST at time zero.

        Parameters
        ----------
        rotor_speed, pitch, azimuth, yaw, generator_torque, tower_top
            As of `Simulator.reset`. Without a torque it is what balances the air at time zero.
        wake_thrust, motion
            Not used: OpenFAST takes no such start.

        Raises
        ------
        ActionError
            For values that are not finite or out of range.
        SimulationError
            With OpenFAST's message where it does not start.
        """
        check_finite(rotor_speed=rotor_speed, azimuth=azimuth, yaw=yaw)
        if rotor_speed < 0.0:
            raise ActionError(f"rotor_speed must be 0 rad/s or more, got {rotor_speed}")
        tower_top = self._checked_tower_top(tower_top)
        self._stop()
        yaw = -yaw if self.mirrored else yaw
        self.drives.start(pitch, yaw, rotor_speed, generator_torque)
        command = self.drives.command
        angles = command[PITCH].copy()
        displaced = None if tower_top is None else tower_top[:2]
        sea = self._sea.mirrored() if self._sea is not None and self.mirrored else self._sea
        start = self._bent.start(self.inflow, rotor_speed, angles, azimuth, yaw, displaced, sea)
        try:
            primary = prepare_run(
                self.model, self._folder, self._image, self._felt, start, RunTimes(self.openfast_step, self._duration),
                None if self._relay is None else ServedController(str(self._relay), self._relay.name), self._changes,
                sea,
            )  # fmt: skip
            demands = self._demands(angles[None, :], command[TORQUE], yaw, 0.0)
            process = OpenFASTProcess(self._library, primary, self._relay, demands[0], self._folder / "openfast.log")
        except SimulationError as error:
            raise SimulationError(f"no start at {rotor_speed} rad/s in {self.inflow.description}: {error}") from error
        measurement = Measurement(self._image, process.names)
        if abs(process.step - self.openfast_step) > 1e-9:
            raise SimulationError(f"OpenFAST takes steps of {process.step} s; {self.openfast_step} s were asked for")
        self._process, self._measurement = process, measurement
        self._path.start(angles)
        self._lasts = math.inf if repeats(self._felt) and self._sea is None else self._duration
        self._n_steps = 0
        if generator_torque is None:
            self.drives.load(measurement.aero_torque(process.outputs), rotor_speed)
        still = np.zeros(self.turbine.n_blades)
        measurement.take(0.0, process.outputs[None, :], command.item(0), command[PITCH], still, still, False)
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
        duration, pitch, yaw_rate, generator_torque, accumulate
            As of `Simulator.advance`.
        """
        process, measurement = self._running()
        drives = self.drives
        pitch = drives.pitch.vector(pitch)
        n = self._steps_in(duration, yaw_rate=yaw_rate, generator_torque=generator_torque)
        if self.time + duration > self._lasts + 1e-6:
            raise SimulationError(
                f"wind and waves were written for {self._lasts:g} s, and {self.time + duration:g} s are asked for: "
                "make the argument duration longer"
            )
        yaw_rate = -yaw_rate if self.mirrored else yaw_rate
        command = drives.command
        for k in range(n):
            torque, yaw, angle = command.item(0), command.item(1), self._path.angle
            drives.follow(pitch, yaw_rate, generator_torque, self.time_step, measurement.generator_speed)
            path = self._path.follow(command[PITCH])
            part = np.arange(1, self._count + 1) / self._count
            turning = (command.item(1) - yaw) / self.time_step
            held = holds_torque(drives.generator)
            torques = np.full(part.shape, command.item(0)) if held else torque + part * (command.item(0) - torque)
            demands = self._demands(path, torques, yaw + part * (command.item(1) - yaw), turning)
            try:
                rows = process.advance(demands)
            except SimulationError as error:
                failed_at = self.time
                self._stop()
                raise SimulationError(f"simulation failed at {failed_at:.3f} s: {error}") from error
            self._n_steps += 1
            travel = np.abs(np.diff(np.vstack([angle, path]), axis=0)).sum(axis=0)
            going_on = accumulate or k > 0 or self._n_steps == 1
            measurement.take(self.time, rows, command.item(0), command[PITCH], self._path.rate, travel, going_on)
        return self.signals

    def _demands(self, pitch: Array, torque: Array, yaw: float | Array, yaw_rate: float) -> Array:
        """Rows of demands for the process (n, 6) of angles (n, n_blades) and what goes with them."""
        rows = np.zeros((len(pitch), 6))
        rows[:, : pitch.shape[1]] = pitch
        rows[:, 3], rows[:, 4], rows[:, 5] = torque, yaw, yaw_rate
        return rows

    def tower_top(self) -> Array:
        """Displacement of the tower top along and across the nacelle [m] and, unknown here, rates of zero (4,)."""
        signals = self.signals
        return np.array([signals["tower_top_fore_aft"], signals["tower_top_side_side"], 0.0, 0.0])

    def close(self) -> None:
        """End the process and remove the temporary folder: there are no files to start from any more."""
        self._stop()
        if self._temporary is not None:
            self._temporary.cleanup()

    def __del__(self) -> None:
        self.close()

    def state(self) -> NoReturn:
        """Refused: OpenFAST gives no snapshots here."""
        raise SimulationError("OpenFAST gives no snapshots: its simulations cannot be kept, copied or gone back to")

    def restore(self, state: object) -> NoReturn:
        """Refused, see `state`."""
        self.state()

    def __getstate__(self) -> NoReturn:
        self.state()

    def linearize(self, operating_point: object = None, **options: object) -> NoReturn:
        """Refused: OpenFAST's driver linearizes models."""
        raise SimulationError(f"the simulation of OpenFAST is not linearized here; its driver does that ({self.model})")

    def geometry(self) -> NoReturn:
        """Refused: there are no shapes for pictures."""
        raise SimulationError("OpenFAST gives no shapes for pictures: render_mode and replay must be off")

    def _running(self) -> tuple[OpenFASTProcess, Measurement]:
        if self._process is None or self._measurement is None:
            raise SimulationError("the simulator is not running: call reset() first, also after a failed simulation")
        return self._process, self._measurement

    def _stop(self) -> None:
        if self._process is not None:
            self._process.close()
        self._process = self._measurement = None


class PitchPath:
    """Pitch of the blades behind their commands; OpenFAST itself sets the pitch that it is given.

    An ideal drive turns at a rate that changes evenly within a step, from that of the command in the step before to
    that in this one (`wt_gym.simulation.drivetrain.drives.PitchDrives`). A servo, θ̈ = ω² (c − θ) − 2 ζ ω θ̇, follows a
    command that moves evenly; it is integrated exactly.

    Parameters
    ----------
    step : float
        Between commands [s].
    count : int
        Steps of OpenFAST in it.

    Attributes
    ----------
    angle, rate : ndarray (n_blades,)
        Now [rad], [rad/s].
    """

    def __init__(self, limits: PitchSystem, step: float, count: int):
        self._step, self._count = step, count
        self._part = np.arange(1, count + 1)[:, None] * (step / count)
        self._servo = None
        if limits.servo_frequency is not None:
            omega, damping = limits.servo_frequency, limits.servo_damping
            # states: angle, rate, command, rate of the command
            system = np.zeros((4, 4))
            system[0, 1] = system[2, 3] = 1.0
            system[1] = [-(omega**2), -2.0 * damping * omega, omega**2, 0.0]
            self._servo = expm(system * (step / count))
        self.angle = self.rate = self._command = np.zeros(0)

    def start(self, pitch: Array) -> None:
        """Stand at an angle for each blade (n_blades,) [rad]."""
        self.angle, self._command, self.rate = pitch.copy(), pitch.copy(), np.zeros(pitch.size)

    def follow(self, command: Array) -> Array:
        """Follow the commands (n_blades,) [rad] through a step; the angles (count, n_blades) at OpenFAST's steps."""
        required = (command - self._command) / self._step
        if self._servo is None:
            turn = (required - self.rate) / (2.0 * self._step)
            path = self.angle + self.rate * self._part + turn * self._part**2
            self.rate = required
        else:
            state = np.stack([self.angle, self.rate, self._command, required])
            path = np.empty((self._count, command.size))
            for k in range(self._count):
                state = self._servo @ state
                path[k] = state[0]
            self.rate = state[1]
        self.angle, self._command = path[-1].copy(), command.copy()
        return path
