"""OpenFAST behind the contract of the simulator: models from turbines, winds, the library in a process of its own."""

from wt_gym.bridges.openfast.driver import read_outputs, run_driver, write_driver_run
from wt_gym.bridges.openfast.model import write_model
from wt_gym.bridges.openfast.process import DRIVER_VARIABLE, VARIABLE, find_driver, find_library
from wt_gym.bridges.openfast.run_folder import ServedController
from wt_gym.bridges.openfast.simulator import OpenFASTSimulator
from wt_gym.bridges.openfast.wind import PointLidar

__all__ = [
    "DRIVER_VARIABLE", "VARIABLE", "OpenFASTSimulator", "PointLidar", "ServedController", "find_driver", "find_library",
    "read_outputs", "run_driver", "write_driver_run", "write_model",
]  # fmt: skip
