"""Measure the power and thrust coefficients of a turbine in the simulator, for controllers with a wind estimate.

python scripts/studies/rotor_table.py nrel_5mw --record      # into wt_gym/turbines/records/nrel_5mw.json
python scripts/studies/rotor_table.py mine.yaml table.json
"""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import wt_gym
from wt_gym.commands.program import FIDELITIES_HELP
from wt_gym.control.design import rotor_inertia
from wt_gym.control.rotor import RotorTable, fine_pitch
from wt_gym.control.sensors import LowPass
from wt_gym.simulation import Fidelity, Simulator, TorqueCommand
from wt_gym.turbine_records import FOLDER, RECORDS
from wt_gym.turbines import Turbine, load_turbine
from wt_gym.wind import SteadyInflow

PITCH_DEG = (0.0, 1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 10.0, 12.5, 15.0, 18.0, 21.0, 24.0)
"""Pitch above fine pitch [deg]."""
TIP_SPEED_RATIO = (2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0, 7.5, 8.0, 8.5, 9.0, 9.5, 10.0, 11.0, 12.0, 13.0)
SETTLING_TURNS = 2.5
"""Turns of the rotor at each point before the mean."""
LOWEST_COEFFICIENT = -0.15
"""Power coefficient at which a row ends: no controller gets there; the row continues with its last slopes."""

_INERTIAS_PER_TURN = 1.5
"""Feedback on the speed with which the machine holds it, in inertias of the rotor a turn at rated speed: a damper of
the structure, since a torque held over a step would shake a light hub between heavy blades."""
_FEEDFORWARD_TURNS = 0.2
"""Time constant of the moment of the air that the machine takes up, in turns at rated speed: not so fast as to drive
the shaft's torsion. All times go with the turn: a small rotor takes as many steps as a large one."""


@dataclass(frozen=True)
class _Machine(TorqueCommand):
    """Generator law without limits, which can drive the rotor as well, with a damper about a commanded speed."""

    damping: float = 0.0

    def first(self, value: float, speed: float) -> NDArray[np.float64]:
        """Any torque [N m]."""
        return np.array([value])

    def balance(self, moment: float, speed: float) -> float:
        """The torque that balances the moment [N m]."""
        return (moment - self.damping * speed) / self.drivetrain.gear_ratio

    def follow(self, command: NDArray[np.float64], demand: float, dt: float, speed: float) -> None:
        """Take over the demand [N m] at once."""
        command[0] = demand


def measure_rotor(
    turbine: Turbine, fidelity: str | Fidelity | None = None, progress: Callable[[int, int], None] = lambda *_: None
) -> RotorTable:
    """Measure the coefficients of a turbine in the simulator.

    The generator is replaced by a machine that can also drive, and holds the speed. Row by row of constant pitch, the
    wind falls through the tip-speed ratios; each point settles, then the mean over about a revolution is taken. The
    rotor turns at rated speed, slower where that would need a wind far above that in which a turbine has such a pitch.

    Parameters
    ----------
    fidelity : str or Fidelity, optional
        As of the simulator.
    progress : callable
        Called with the number of rows done and of all rows.
    """
    radius, rated = turbine.rotor_diameter / 2, turbine.drivetrain.rated_rotor_speed
    pitches = fine_pitch(turbine) + np.radians(PITCH_DEG)
    simulator = Simulator(
        turbine,
        SteadyInflow(turbine.rated_wind_speed, turbine.hub_height),
        fidelity,
        generator=_Machine(turbine.drivetrain, _INERTIAS_PER_TURN * rotor_inertia(turbine) * rated / (2 * math.pi)),
    )
    power, thrust = (np.zeros((len(TIP_SPEED_RATIO), len(pitches))) for _ in range(2))
    for j, pitch in enumerate(pitches):
        # above rated, wind and pitch go together: 24 degrees belong to more than twice the rated wind speed
        strongest = turbine.rated_wind_speed * (1.1 + PITCH_DEG[j] / 20.0)
        for i, ratio in enumerate(TIP_SPEED_RATIO):
            if i > 1 and power[i - 1, j] < LOWEST_COEFFICIENT:
                for values in (power, thrust):
                    slope = (values[i - 1, j] - values[i - 2, j]) / (TIP_SPEED_RATIO[i - 1] - TIP_SPEED_RATIO[i - 2])
                    values[i, j] = values[i - 1, j] + slope * (ratio - TIP_SPEED_RATIO[i - 1])
                continue
            speed = min(rated, ratio * strongest / radius)
            wind = speed * radius / ratio
            simulator.inflow = SteadyInflow(wind, turbine.hub_height)
            if i == 0:
                simulator.reset(rotor_speed=speed, pitch=pitch)
            power[i, j], thrust[i, j] = _settled(simulator, speed, pitch)
        progress(j + 1, len(pitches))
    return RotorTable(
        turbine=turbine.name,
        radius=radius,
        air_density=turbine.air_density,
        tip_speed_ratio=np.array(TIP_SPEED_RATIO),
        pitch=pitches,
        power=power,
        thrust=thrust,
        made_by=f"wt_gym {wt_gym.__version__}, fidelity {simulator.fidelity.name!r}",
    )


def _settled(simulator: Simulator, speed: float, pitch: float) -> tuple[float, float]:
    """Power and thrust coefficient, with the rotor held at a speed [rad/s] and pitch [rad]."""
    turbine, dt = simulator.turbine, simulator.time_step
    radius, gear = turbine.rotor_diameter / 2, turbine.drivetrain.gear_ratio
    driven = simulator.drives.generator.damping * speed  # the damper holds the commanded speed, not rest
    signals = simulator.signals
    moment = LowPass(_FEEDFORWARD_TURNS * 2 * math.pi / turbine.drivetrain.rated_rotor_speed)
    moment.reset(signals["aero_torque"])
    turn = 2 * math.pi / speed
    settle, average = round(SETTLING_TURNS * turn / dt), round(turn / dt)
    rows = []
    for _ in range(settle + average):
        held = moment.update(signals["aero_torque"], dt) - driven
        signals = simulator.advance(dt, pitch=pitch, generator_torque=held / gear)
        rows.append((signals["aero_power"], signals["aero_thrust"]))
    power, thrust = np.mean(rows[settle:], axis=0)
    pressure = 0.5 * turbine.air_density * math.pi * radius**2 * simulator.inflow.mean_speed**2
    return power / (pressure * simulator.inflow.mean_speed), thrust / pressure


def main() -> None:
    """Run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("turbine", help="name in the catalog or path of a windIO file")
    places = parser.add_mutually_exclusive_group(required=True)
    places.add_argument("output", type=Path, nargs="?", help="JSON file to write")
    places.add_argument("--record", action="store_true", help="write into the record of a turbine of the catalog")
    parser.add_argument("--fidelity", help=FIDELITIES_HELP)
    arguments = parser.parse_args()
    if arguments.record and arguments.turbine not in RECORDS:
        parser.error(f"--record needs a name of the catalog ({', '.join(RECORDS)}), got {arguments.turbine!r}")
    turbine = load_turbine(arguments.turbine)
    table = measure_rotor(
        turbine, arguments.fidelity, lambda done, count: print(f"{done} of {count} pitches", flush=True)
    )
    if arguments.record:
        arguments.output = FOLDER / f"{arguments.turbine}.json"
        table.put_into(arguments.output)
    else:
        table.save(arguments.output)
    ratio, best = table.optimum
    print(f"{turbine.name}: Cp {best:.4f} at tip-speed ratio {ratio:.2f}; written to {arguments.output}")


if __name__ == "__main__":
    main()
