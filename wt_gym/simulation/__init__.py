"""The turbine assembled from its rooms: coupled time loop, state, signals and recording."""

from wt_gym.simulation.channels import Channel, Signals, channel_table
from wt_gym.simulation.contract import SimulatorState
from wt_gym.simulation.drivetrain.drives import LinearDamper, TorqueCommand
from wt_gym.simulation.fidelity import FIDELITIES, Fidelity
from wt_gym.simulation.recorder import Recorder
from wt_gym.simulation.simulator import Simulator

__all__ = [
    "FIDELITIES",
    "Channel",
    "Fidelity",
    "LinearDamper",
    "Recorder",
    "Signals",
    "Simulator",
    "SimulatorState",
    "TorqueCommand",
    "channel_table",
]
