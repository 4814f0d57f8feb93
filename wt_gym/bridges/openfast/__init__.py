"""OpenFAST behind the contract of the simulator: models from turbines, winds, the library in a process of its own."""

from wt_gym.bridges.openfast.library import VARIABLE, find_library
from wt_gym.bridges.openfast.model_files import write_model
from wt_gym.bridges.openfast.simulator import OpenFASTSimulator

__all__ = ["VARIABLE", "OpenFASTSimulator", "find_library", "write_model"]
